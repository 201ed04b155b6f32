#pragma once

#include <array>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Signed distances from a surface at the points of a regular grid, negative inside. Between the points: the
/// uniform cubic B-spline with these coefficients, twice continuously differentiable. It smooths: flat faces
/// stay in place, a surface of mean curvature H moves inward by step^2 H / 3, and edges are rounded by about
/// a step. SI units.
struct DistanceGrid {
  Vec3 origin = Vec3::Zero();  ///< [m] of the first point
  double step = 1.0;           ///< [m]
  std::array<Index, 3> n{};    ///< points along x, y, z; at least 4 each
  std::vector<double> value;   ///< [m] x fastest

  Index number(Index i, Index j, Index k) const { return i + n[0] * (j + n[1] * k); }
};

/// The distance at a place [m] and its gradient. Outside and below the grid the distance to the grid's box is
/// added; above it, the grid's uppermost layer continues.
struct Distance {
  double distance;
  Vec3 gradient;
};
Distance distance_in(const DistanceGrid& grid, const Vec3& x);

/// Height of the surface above x, y, from below [m]: the lowest z inside in the grid; infinite for none.
double height_over(const DistanceGrid& grid, double x, double y);

}  // namespace dimple
