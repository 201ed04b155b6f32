#pragma once

#include <string>
#include <vector>

#include "preprocess/scene/boundary_conditions.hpp"

namespace dimple {

/// A sentence each for base and tool where they are on a large flat face that runs along one plane of the
/// image's voxels, inside the image: the segmentation may end there, and the organ not. Where the image
/// itself ends find_boundary() warns.
std::vector<std::string> faces_along_voxels(const BodySurface& body, const Boundary& boundary, bool has_tool);

}  // namespace dimple
