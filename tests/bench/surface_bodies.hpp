#pragma once

#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// The point of an exact surface that is nearest to a given point.
struct Foot {
  double distance = 0.0;   ///< of the given point, negative inside [mm]
  Vec3 normal;             ///< outward unit normal
  double curvature = 0.0;  ///< mean of the principal curvatures; positive where convex [1/mm]
  double to_edge = std::numeric_limits<double>::infinity();  ///< of the given point, to a sharp edge [mm]
};

/// A body whose surface has a closed form. Lengths in mm, in the body's frame; the origin is its centre.
struct ExactBody {
  std::string name;
  double radius;  ///< nominal size; the unit of curvature errors on flat faces [mm]
  double volume;  ///< [mm^3]
  bool smooth;    ///< it has no sharp edge
  std::function<bool(const Vec3&)> contains;
  std::function<Foot(const Vec3&)> foot;
  /// Support function: the largest x . direction of all points x of the body; `direction` is a unit vector.
  std::function<double(const Vec3&)> reach;
};

ExactBody exact_ball(double radius);
/// Semi-axes radius * (1, 0.8, 0.6).
ExactBody exact_ellipsoid(double radius);
/// The half z >= 0 of a ball.
ExactBody exact_half_ball(double radius);
ExactBody exact_box(const std::string& name, const Vec3& size);
/// Axis z, flat ends.
ExactBody exact_cylinder(double radius, double height);
/// Axis z.
ExactBody exact_torus(double major, double minor);

/// A body with the placements on the grid that are measured.
struct Study {
  ExactBody body;
  int offsets, turns;  ///< the first of grid_offset() and grid_turn()
  bool quick;          ///< it is part of the quick run
};

/// All bodies. A ball is the same in each orientation and is measured in one. To save time, some large
/// bodies take 8 of the 16 offsets, and the largest (ball 60, ellipsoid 50) 4 offsets and at most 2
/// orientations.
std::vector<Study> surface_studies();

constexpr int grid_offsets = 16, grid_turns = 5;
/// Offsets of the body from the grid, in voxels along each axis, in [0, 1): the sequence R3 of Roberts
/// (2018), a low-discrepancy set.
Vec3 grid_offset(int number);
/// Rotation body frame -> grid: the identity, a tilt of 4 degrees (long terraces), and three larger ones.
Mat3 grid_turn(int number);

}  // namespace dimple
