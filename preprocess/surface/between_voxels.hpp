#pragma once

#include "preprocess/image/voxel_set.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

/// Lengths in mm.
struct BetweenVoxels {
  double step_mm = 0.0;     ///< of the contour's lattice
  double reach_mm = 0.0;    ///< that relaxation may move a vertex
  double outward_mm = 0.0;  ///< that the contour lies outside of the boundary
  double volume_mm3 = 0.0;  ///< to enclose
};

/// Moves a body's contour to where the voxels' boundary faces place the surface: it is made even, fitted
/// (fit_to_boundary_faces()), relaxed where no fit determines it, and moved, first at edges, until it
/// encloses the volume. `body`, `voxel_to_local`: as of fit_to_boundary_faces().
void place_between_voxels(TriangleMesh& surface, const VoxelSet& body, const Mat3& voxel_to_local,
                          const BetweenVoxels& how);

}  // namespace dimple
