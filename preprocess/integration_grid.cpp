#include "preprocess/integration_grid.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <array>
#include <cmath>

#include "io/error.hpp"

namespace dimple {
namespace {

constexpr int lines_per_edge = 4;
constexpr double sliver = 0.1;  // of a cell

struct Cells {
  std::array<Index, 3> n{};
  Vec3 origin;
  double edge = 0.0;
  Eigen::VectorXd volume;  // [cells]
  Points moment;           // [3 x cells] integral of x
};

Cells fill(const BodySurface& body, double edge) {
  Cells cells;
  cells.edge = edge;
  // A corner of the grid is at the middle of the body's box: symmetric bodies get symmetric cells.
  const Vec3 middle = 0.5 * (body.lower() + body.upper()), half = 0.5 * (body.upper() - body.lower());
  for (int d = 0; d < 3; ++d) {
    const Index k = static_cast<Index>(std::ceil(half[d] / edge - 1e-9));
    cells.n[static_cast<std::size_t>(d)] = 2 * k;
    cells.origin[d] = middle[d] - static_cast<double>(k) * edge;
  }
  const Index total = cells.n[0] * cells.n[1] * cells.n[2];
  cells.volume = Eigen::VectorXd::Zero(total);
  cells.moment = Points::Zero(3, total);

  // Lines are spread over the part of a cell that lies in the body's box: a flat face across its end is met
  // exactly.
  const Vec3 lower = body.lower(), upper = body.upper();
  const auto strip = [&](int d, Index cell) {
    const double from = std::max(lower[d], cells.origin[d] + edge * static_cast<double>(cell));
    const double to = std::min(upper[d], cells.origin[d] + edge * static_cast<double>(cell + 1));
    return std::pair{from, (to - from) / lines_per_edge};
  };
  // One task per row of cells: rows share no cell, so the sums do not depend on the threads.
  tbb::parallel_for(Index{0}, cells.n[1] * cells.n[2], [&](Index row) {
    const Index j = row % cells.n[1], k = row / cells.n[1];
    const Index first = cells.n[0] * (j + cells.n[1] * k);
    const std::pair<double, double> in_y = strip(1, j), in_z = strip(2, k);
    const double line_area = in_y.second * in_z.second;
    for (int a = 0; a < lines_per_edge; ++a)
      for (int b = 0; b < lines_per_edge; ++b) {
        const double y = in_y.first + in_y.second * (a + 0.5), z = in_z.first + in_z.second * (b + 0.5);
        const std::vector<double> t = body.crossings(Vec3(cells.origin.x(), y, z), Vec3::UnitX());
        for (std::size_t pair = 0; pair + 1 < t.size(); pair += 2) {
          const double enter = t[pair], leave = t[pair + 1];
          const Index from =
              std::clamp<Index>(static_cast<Index>(std::floor(enter / edge)), 0, cells.n[0] - 1);
          const Index to = std::clamp<Index>(static_cast<Index>(std::floor(leave / edge)), 0, cells.n[0] - 1);
          for (Index i = from; i <= to; ++i) {
            const double begin = i == from ? enter : edge * static_cast<double>(i);
            const double end = i == to ? leave : edge * static_cast<double>(i + 1);
            const double part = line_area * (end - begin);
            cells.volume[first + i] += part;
            cells.moment.col(first + i) += part * Vec3(cells.origin.x() + 0.5 * (begin + end), y, z);
          }
        }
      }
  });
  return cells;
}

Index count_points(const Cells& cells) {
  return (cells.volume.array() >= sliver * std::pow(cells.edge, 3)).count();
}

// Gives each sliver to the face neighbour with the most tissue; one without such a neighbour stays.
void merge_slivers(Cells& cells, IntegrationGrid& grid) {
  const double small = sliver * std::pow(cells.edge, 3);
  const std::array<Index, 3> stride = {1, cells.n[0], cells.n[0] * cells.n[1]};
  for (Index c = 0; c < cells.volume.size(); ++c) {
    if (!(cells.volume[c] > 0.0) || cells.volume[c] >= small) continue;
    const std::array<Index, 3> at = {c % cells.n[0], (c / cells.n[0]) % cells.n[1], c / stride[2]};
    Index best = -1;
    for (std::size_t d = 0; d < 3; ++d)
      for (const Index side : {-1, 1}) {
        if (at[d] + side < 0 || at[d] + side >= cells.n[d]) continue;
        const Index other = c + side * stride[d];
        if (cells.volume[other] >= small && (best < 0 || cells.volume[other] > cells.volume[best]))
          best = other;
      }
    if (best < 0) continue;
    cells.volume[best] += cells.volume[c];
    cells.moment.col(best) += cells.moment.col(c);
    cells.volume[c] = 0.0;
    ++grid.merged;
  }
}

}  // namespace

IntegrationGrid make_integration_grid(const BodySurface& body, const GridOptions& options, Index node_count) {
  const double wanted = options.count > 0 ? static_cast<double>(options.count)
                                          : options.ratio * static_cast<double>(node_count);
  // Cut cells make the count larger than volume / cell; the count is then matched by a few trials.
  double edge = std::cbrt(body.volume() / wanted);
  Cells cells;
  for (int trial = 0; trial < 5; ++trial) {
    cells = fill(body, edge);
    const double error = static_cast<double>(count_points(cells)) / wanted;
    if (std::abs(error - 1.0) < 0.005) break;
    if (trial < 4) edge *= std::pow(error, 1.0 / 2.7);
  }

  IntegrationGrid grid;
  grid.cell = edge;
  merge_slivers(cells, grid);
  const double whole = std::pow(edge, 3);
  std::vector<Index> kept;
  for (Index c = 0; c < cells.volume.size(); ++c)
    if (cells.volume[c] > 1e-6 * whole) kept.push_back(c);
  if (kept.size() < 8)
    throw ModelError({.fact = fmt::format("only {} integration cells meet the body", kept.size()),
                      .where = "integration grid",
                      .why = fmt::format("the cells' edge is {:.2f} mm", edge),
                      .remedy = "ask for more points with --points"});
  grid.point.resize(3, static_cast<Index>(kept.size()));
  grid.volume.resize(static_cast<Index>(kept.size()));
  for (std::size_t q = 0; q < kept.size(); ++q) {
    const auto at = static_cast<Index>(q);
    grid.volume[at] = cells.volume[kept[q]];
    grid.point.col(at) = cells.moment.col(kept[q]) / cells.volume[kept[q]];
    if (std::abs(grid.volume[at] - whole) > 1e-9 * whole) ++grid.clipped;
  }
  return grid;
}

}  // namespace dimple
