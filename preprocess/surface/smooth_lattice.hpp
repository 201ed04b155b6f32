#pragma once

#include <vector>

#include "preprocess/image/voxel_set.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

/// A smoothed indicator (1 inside, 0 outside) on a regular lattice along the voxel axes.
struct Lattice {
  Vec3 origin, step;  ///< in voxels of the image
  std::array<int, 3> n{};
  std::vector<float> value;  ///< [n[0]*n[1]*n[2]], i fastest; 0 on the border
};

/// The indicator of the voxels, smoothed by a discrete Gaussian of sigma [voxels] along each axis, at lattice
/// points `step` [voxels] apart. Between voxel centres it is linear. One axis after the other and directly
/// from the stretches: no array of all voxels is made, however fine they are.
Lattice smoothed(const VoxelSet& set, const Vec3& sigma, const Vec3& step);

/// The contour of a lattice at a level, facing outward, in lattice coordinates: flying edges by VTK. Needs
/// values below the level on the border.
TriangleMesh contour(const Lattice& lattice, double level);

}  // namespace dimple
