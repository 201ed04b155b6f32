#include "preprocess/scene/wall_field.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "io/stop.hpp"

namespace dimple {
namespace {

constexpr double target_points = 700e3;

}  // namespace

DistanceGrid wall_field(const BodySurface& wall, bool hollow, const Vec3& low, const Vec3& high,
                        double finest_mm, double margin_mm) {
  const Vec3 size = high - low;
  DistanceGrid grid{.origin = 1e-3 * low,
                    .step = std::max(finest_mm, std::cbrt(size.prod() / target_points)),
                    .n = {},
                    .value = {}};
  for (Index d = 0; d < 3; ++d)
    grid.n[static_cast<std::size_t>(d)] =
        std::max<Index>(4, static_cast<Index>(std::ceil(size[d] / grid.step)) + 1);
  grid.value.resize(static_cast<std::size_t>(grid.n[0] * grid.n[1] * grid.n[2]));
  const Eigen::Isometry3d to_wall = wall.to_world().inverse();
  tbb::parallel_for(Index{0}, grid.n[1] * grid.n[2], [&](Index row) {
    stop_if_requested();
    const Index j = row % grid.n[1], k = row / grid.n[1];
    for (Index i = 0; i < grid.n[0]; ++i) {
      const Vec3 x = to_wall * (low + grid.step * Vec3(static_cast<double>(i), static_cast<double>(j),
                                                       static_cast<double>(k)));
      const double away = wall.farther(x, margin_mm) ? margin_mm : wall.closest(x).distance;
      const bool solid = wall.contains(x) != hollow;
      grid.value[static_cast<std::size_t>(grid.number(i, j, k))] = 1e-3 * (solid ? -away : away);
    }
  });
  grid.step *= 1e-3;
  return grid;
}

}  // namespace dimple
