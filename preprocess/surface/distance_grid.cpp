#include "preprocess/surface/distance_grid.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dimple {
namespace {

// Weights of the four points around a place at the fraction `t` of the second of their three intervals.
struct Weights {
  std::array<double, 4> value, slope;
};

Weights weights_at(double t) {
  const double s = 1.0 - t;
  return {{s * s * s / 6.0, (4.0 + t * t * (3.0 * t - 6.0)) / 6.0, (4.0 + s * s * (3.0 * s - 6.0)) / 6.0,
           t * t * t / 6.0},
          {-0.5 * s * s, 0.5 * t * (3.0 * t - 4.0), -0.5 * s * (3.0 * s - 4.0), 0.5 * t * t}};
}

}  // namespace

Distance distance_in(const DistanceGrid& grid, const Vec3& x) {
  std::array<Weights, 3> w;
  std::array<Index, 3> first;
  Vec3 beyond;
  for (Index d = 0; d < 3; ++d) {
    const auto axis = static_cast<std::size_t>(d);
    const double last = static_cast<double>(grid.n[axis] - 2);
    const double requested = (x[d] - grid.origin[d]) / grid.step, at = std::clamp(requested, 1.0, last);
    const double cell = std::min(std::floor(at), last - 1.0);
    first[axis] = static_cast<Index>(cell) - 1;
    w[axis] = weights_at(at - cell);
    beyond[d] = grid.step * (requested - at);
  }
  Distance result{0.0, Vec3::Zero()};
  for (Index k = 0; k < 4; ++k)
    for (Index j = 0; j < 4; ++j) {
      const double* row = grid.value.data() + grid.number(first[0], first[1] + j, first[2] + k);
      double sum = 0.0, slope = 0.0;
      for (std::size_t i = 0; i < 4; ++i) {
        sum += w[0].value[i] * row[i];
        slope += w[0].slope[i] * row[i];
      }
      const auto jj = static_cast<std::size_t>(j), kk = static_cast<std::size_t>(k);
      result.distance += w[1].value[jj] * w[2].value[kk] * sum;
      result.gradient[0] += w[1].value[jj] * w[2].value[kk] * slope;
      result.gradient[1] += w[1].slope[jj] * w[2].value[kk] * sum;
      result.gradient[2] += w[1].value[jj] * w[2].slope[kk] * sum;
    }
  result.gradient /= grid.step;
  beyond[2] = std::min(beyond[2], 0.0);
  if (const double away = beyond.norm(); away > 0.0) {
    result.distance += away;
    result.gradient = beyond / away;
  }
  return result;
}

double height_over(const DistanceGrid& grid, double x, double y) {
  const auto inside = [&](double z) { return distance_in(grid, {x, y, z}).distance <= 0.0; };
  const double below = grid.origin[2] + grid.step, step = 0.5 * grid.step;
  for (Index k = 1; k <= 2 * (grid.n[2] - 3); ++k) {
    double high = below + step * static_cast<double>(k), low = high - step;
    if (!inside(high)) continue;
    for (int halving = 0; halving < 40; ++halving) {
      const double middle = 0.5 * (low + high);
      (inside(middle) ? high : low) = middle;
    }
    return high;
  }
  return std::numeric_limits<double>::infinity();
}

}  // namespace dimple
