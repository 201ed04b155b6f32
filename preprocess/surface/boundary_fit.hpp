#pragma once

#include <vector>

#include "preprocess/image/voxel_set.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

/// Moves the vertices of a body's contour onto smooth surfaces fitted to the boundary faces of its voxels.
///
/// A boundary face separates a voxel of the body from one outside. The true surface passes between the two
/// voxel centres: the face's centre is off by up to half a voxel along one axis, without bias. On a dome of
/// radius R (in voxels) the faces form terraces that are sqrt(2 R) wide. Only the edge of a terrace
/// determines the height there, not its inside.
///
/// 1. Seeds are spread over the contour, one in each cell that no fit covers yet; the cells become smaller.
/// 2. At each seed a quadric, height over the tangent plane, is fitted to the faces within a window. Weights
///    are (1 - (r / window)^2)^2 / (a^2 + floor^2), a the voxel's edge along the face's axis, projected onto
///    the surface's normal. So a face whose axis is nearly tangential determines the height best.
/// 3. The window grows while the faces on this side of the body agree with the quadric: nearly all within
///    half a voxel and the slack, and their mean square as rounding to voxels predicts. It therefore follows
///    the curvature and ends at edges, without an estimate of either.
/// 4. Each vertex moves along the normal by the weighted mean over the fits that reach it and agree with it.
///
/// Sources: partition of unity of local quadrics, Ohtake et al., Multi-level partition of unity implicits
/// (SIGGRAPH 2003); windows as large as the data admit, Lepskii, Theory Probab. Appl. 35 (1990) 454. The
/// weights by each face's own precision are ours, since rounding to voxels has a known distribution.
///
/// `body`: the voxels. `voxel_to_local`: from voxel indices to the coordinates of `surface` [mm]. `step`: the
/// edge of the contour's lattice [mm]; where half of it is longer than a voxel, windows are measured in half
/// steps and fewer faces are used. `outward`: distance of contour and surface outside of the boundary [mm].
/// Returns for each vertex, in [0, 1], how far fits determine its position; 0: it has not moved. The result
/// does not depend on the number of threads.
std::vector<double> fit_to_boundary_faces(TriangleMesh& surface, const VoxelSet& body,
                                          const Mat3& voxel_to_local, double step, double outward);

}  // namespace dimple
