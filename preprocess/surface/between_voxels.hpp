#pragma once

#include "preprocess/image/voxel_set.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

/// Lengths in mm.
struct BetweenVoxels {
  double step_mm = 0.0;     ///< of the contour's lattice
  double reach_mm = 0.0;    ///< largest motion of a vertex in relaxation
  double outward_mm = 0.0;  ///< distance of the contour outside the boundary
  double volume_mm3 = 0.0;  ///< that the result encloses
};

/// Moves a body's contour to the surface that the voxels' boundary faces define.
/// 1. Relax all vertices: 10 sweeps of averaging with the shrinkage taken back (Gibson 1998).
/// 2. Fit quadrics to the boundary faces: fit_to_boundary_faces() returns how far fits determine a vertex.
/// 3. Relax the rest, edges, folds and noise, by 40 sweeps.
/// 4. Move along the normals, first the rest, then everything, until the volume is enclosed.
///
/// `body`, `voxel_to_local`: as of fit_to_boundary_faces().
void place_between_voxels(TriangleMesh& surface, const VoxelSet& body, const Mat3& voxel_to_local,
                          const BetweenVoxels& how);

}  // namespace dimple
