#pragma once

#include <string>

#include "preprocess/scene/boundary_conditions.hpp"

namespace dimple {

/// Names of base and tool sides that are large flat faces along a plane of the image's voxels, inside the
/// image: the segmentation may end there, and the organ not. Empty: no such face. find_boundary() warns of
/// the ends of the image itself.
struct FacesAlongVoxels {
  std::string base, tool;
};
FacesAlongVoxels faces_along_voxels(const BodySurface& body, const Boundary& boundary);

}  // namespace dimple
