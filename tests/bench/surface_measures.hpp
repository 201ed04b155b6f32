#pragma once

#include <limits>

#include "io/label_image.hpp"
#include "preprocess/surface/closed_mesh.hpp"
#include "tests/bench/surface_bodies.hpp"

namespace dimple {

/// Where a body lies on the grid: x_world = turn * x_body + centre [mm].
struct Placement {
  Mat3 turn = Mat3::Identity();
  Vec3 centre = Vec3::Zero();
};

/// The label image of a body. A voxel has label 1 if its centre is inside. Axes i, j, k are +L, +P, +S and
/// the origin of the world is a voxel centre; there are three voxels of background on all sides.
LabelImage voxelised(const ExactBody& body, const Placement& placement, const Vec3& spacing);

constexpr double not_measured = std::numeric_limits<double>::quiet_NaN();

/// Moves each vertex to its nearest point on the exact surface: the errors that remain are those of the
/// measures.
void project(TriangleMesh& mesh, const ExactBody& body, const Placement& placement);

/// Deviation of a drawn surface from the exact one, for one placement. Lengths in mm, which are voxels of the
/// finest axis. A distance is positive where the drawn surface is outside the body. Vertices are weighted by
/// their area. "Smooth" are those more than 2 mm from a sharp edge. NaN if a quantity does not exist.
struct SurfaceErrors {
  double mean = not_measured;            ///< signed distance, smooth part
  double rms = not_measured;             ///< distance, smooth part
  double largest = not_measured;         ///< distance, smooth part
  double edge_largest = not_measured;    ///< distance from the drawn surface to the exact one, near edges
  double normal_rms = not_measured;      ///< angle of vertex normals to the exact ones, smooth part [degrees]
  double normal_largest = not_measured;  ///< likewise
  double curvature_rms = not_measured;   ///< (drawn - exact) mean curvature times the local radius
  double volume = not_measured;          ///< (drawn / exact - 1) [%]
  double voxel_volume = not_measured;    ///< (voxels / exact - 1) [%]: the part that the image itself has
  double top_mean = not_measured;        ///< mean signed error of the six extreme coordinates
  double top_rms = not_measured;         ///< their root mean square
  double top_across = not_measured;      ///< the larger signed error of the two extremes along k
  double top_within = not_measured;      ///< the largest signed error of the four extremes along i and j
};

/// `mesh` is closed, in world coordinates [mm], triangles facing outwards.
SurfaceErrors errors_of(const TriangleMesh& mesh, const ExactBody& body, const Placement& placement);

}  // namespace dimple
