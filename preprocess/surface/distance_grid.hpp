#pragma once

#include <array>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Signed distances from a surface at the points of a regular grid, negative inside. Between them: cubic
/// convolution (Keys, IEEE Trans. ASSP 29 (1981) 1153), which is continuous with its gradient and exact for
/// quadratic functions. SI units.
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

}  // namespace dimple
