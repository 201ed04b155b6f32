#pragma once

#include <array>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Signed distances from a surface at the points of a regular grid, negative inside. Between them: the
/// uniform cubic B-spline with these as coefficients, twice continuously differentiable. It smooths: flat
/// faces stay where they are, a surface of mean curvature H moves inward by step^2 H / 3, and edges are
/// rounded by about a step. SI units.
struct DistanceGrid {
  Vec3 origin = Vec3::Zero();  ///< [m] of the first point
  double step = 1.0;           ///< [m]
  std::array<Index, 3> n{};    ///< points along x, y, z; at least 4 each
  std::vector<double> value;   ///< [m] x fastest

  Index number(Index i, Index j, Index k) const { return i + n[0] * (j + n[1] * k); }
};

/// The distance at a place [m] and its gradient. Beside and below the grid the distance to the grid's box is
/// added; above it, the grid's uppermost layer goes on.
struct Distance {
  double distance;
  Vec3 gradient;
};
Distance distance_in(const DistanceGrid& grid, const Vec3& x);

/// How high the surface is above x, y, seen from below [m]: the lowest z within the grid that is inside;
/// infinite where none is.
double height_over(const DistanceGrid& grid, double x, double y);

}  // namespace dimple
