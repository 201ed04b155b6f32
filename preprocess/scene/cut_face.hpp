#pragma once

#include <string>

#include "preprocess/scene/boundary_conditions.hpp"

namespace dimple {

/// In words, what base and tool are on where that is a large flat face along one plane of the image's voxels,
/// inside the image: the segmentation may end there, and the organ not. Empty: it is no such face. Where the
/// image itself ends find_boundary() warns.
struct FacesAlongVoxels {
  std::string base, tool;
};
FacesAlongVoxels faces_along_voxels(const BodySurface& body, const Boundary& boundary);

}  // namespace dimple
