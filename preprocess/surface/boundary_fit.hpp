#pragma once

#include <vector>

#include "preprocess/image/voxel_set.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

/// Moves the vertices of a body's contour onto smooth surfaces fitted to the boundary faces of its voxels.
///
/// A boundary face separates a voxel of the body from one outside: the true surface passes somewhere between
/// the two voxel centres, so the face's centre is off by up to half a voxel along one axis, without bias.
/// On a dome of radius R (in voxels) the faces form terraces that are sqrt(2 R) wide. What lies within one
/// terrace says nothing about the height there; the terrace's edge does.
///
/// 1. Seeds are spread over the contour, one in each cell that no fit covers yet; the cells become smaller.
/// 2. At each seed a quadric, height over the tangent plane, is fitted to the faces within a window. Weights
///    are (1 - (r / window)^2)^2 / (a^2 + floor^2), where a is the voxel's edge along the face's axis as seen
///    along the surface's normal: a face whose axis is nearly tangential fixes the height best.
/// 3. The window grows while the faces agree with the quadric: each within half a voxel and the slack, in the
///    mean as the rounding to voxels lets expect, and nearly all of those on this side of the body. It
///    therefore follows the curvature and ends at edges, without either being estimated.
/// 4. Each vertex moves along the normal by the weighted mean over the fits that reach it and agree with it.
///
/// Sources: partition of unity of local quadrics, Ohtake et al., Multi-level partition of unity implicits
/// (SIGGRAPH 2003); windows as large as the data admit, Lepskii, Theory Probab. Appl. 35 (1990) 454. The
/// weights by each face's own precision are ours, since rounding to voxels has a known distribution.
///
/// `body`: the voxels. `voxel_to_local`: from voxel indices to the coordinates of `surface` [mm]. `step`: the
/// edge of the contour's lattice [mm]; where half of it is longer than a voxel, windows are measured in half
/// steps and only a part of the faces is used. `outward`: the contour and the surface lie that far outside of
/// the boundary [mm]. Returns for each vertex, in [0, 1], how far fits determine its position; at 0 it has
/// not moved. The result does not depend on the number of threads.
std::vector<double> fit_to_boundary_faces(TriangleMesh& surface, const VoxelSet& body,
                                          const Mat3& voxel_to_local, double step, double outward);

}  // namespace dimple
