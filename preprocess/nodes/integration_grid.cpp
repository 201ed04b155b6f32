#include "preprocess/nodes/integration_grid.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <array>
#include <cmath>
#include <map>
#include <optional>

#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/nodes/neighbours.hpp"

namespace dimple {
namespace {

constexpr int lines_per_edge = 4;
constexpr double sliver = 0.1;  // of a cell
// Bounds, per requested point: cells of a body's whole box, and leaves.
constexpr double box_cells_per_point = 1000.0;
constexpr std::size_t leaves_per_point = 20, fewest_leaves = 20000;
constexpr int trials = 5;
constexpr double most_at_a_time = 8.0;  // largest change of the cells' volume in a trial

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

  // Lines are distributed over the part of a cell in the body's box: flat faces across its ends are exact.
  const Vec3 lower = body.lower(), upper = body.upper();
  const auto strip = [&](int d, Index cell) {
    const double from = std::max(lower[d], cells.origin[d] + edge * static_cast<double>(cell));
    const double to = std::min(upper[d], cells.origin[d] + edge * static_cast<double>(cell + 1));
    return std::pair{from, (to - from) / lines_per_edge};
  };
  // One task per row of cells: rows have no cell in common, so the sums do not depend on the threads.
  tbb::parallel_for(Index{0}, cells.n[1] * cells.n[2], [&](Index row) {
    if (row % 16 == 0) stop_if_requested();
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

// Gives each sliver to the face neighbour with the most tissue; one without such a neighbour remains.
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

void set_labels(IntegrationGrid& grid, const LabelAt& label_at) {
  grid.label = Eigen::VectorXi::Zero(grid.point.cols());
  if (label_at)
    for (Index q = 0; q < grid.point.cols(); ++q) {
      if (q % 1024 == 0) stop_if_requested();
      grid.label[q] = label_at(grid.point.col(q));
    }
}

// Part of a cell: integrals of 1, x and x x^T over it.
struct Part {
  double volume = 0.0;
  Vec3 first = Vec3::Zero();
  Mat3 second = Mat3::Zero();
  int label = 0;
};

// Adds a box of these half edges around x.
void add_box(Part& part, const Vec3& x, const Vec3& half) {
  const double volume = 8.0 * half.prod();
  part.volume += volume;
  part.first += volume * x;
  part.second += volume * (x * x.transpose());
  part.second.diagonal() += volume / 3.0 * half.cwiseAbs2();
}

Part whole(const Leaf& leaf) {
  Part part;
  add_box(part, leaf.centre, leaf.half);
  return part;
}

// Piece of a line inside the body.
struct LinePiece {
  int a, b;  // the line's indices
  double begin, end;
  std::size_t group;  // number of its first piece
};

// Joins pieces that overlap on neighbouring lines into groups.
void connect_lines(std::vector<LinePiece>& pieces) {
  for (std::size_t k = 0; k < pieces.size(); ++k)
    for (std::size_t before = 0; before < k; ++before) {
      const LinePiece &p = pieces[k], &q = pieces[before];
      if (std::abs(p.a - q.a) + std::abs(p.b - q.b) != 1 ||
          std::min(p.end, q.end) <= std::max(p.begin, q.begin))
        continue;
      const auto [kept, gone] = std::minmax({p.group, q.group});
      for (LinePiece& piece : pieces)
        if (piece.group == gone) piece.group = kept;
    }
}

// Parts of a cell inside the body, from lines along the axis most normal to the surface. If a line leaves the
// body and enters it again, pieces that no neighbouring line connects become separate parts: the two walls of
// a gap.
std::vector<Part> clip(const BodySurface& body, const Leaf& leaf) {
  const auto closest = body.closest(leaf.centre);
  // Not the triangle's normal: at an edge, rounding decides which of two triangles is the closest.
  Vec3 square = (closest.place - leaf.centre).cwiseAbs();
  if (closest.distance < 1e-6 * leaf.half.norm()) square = body.normal().col(closest.triangle).cwiseAbs();
  int axis = 0;
  for (int d = 1; d < 3; ++d)
    if (square[d] > square[axis] * (1.0 + 1e-6)) axis = d;
  const int other = (axis + 1) % 3, third = (axis + 2) % 3;
  Vec3 half = leaf.half;
  half[other] /= lines_per_edge;
  half[third] /= lines_per_edge;
  const double from = leaf.centre[axis] - leaf.half[axis], to = leaf.centre[axis] + leaf.half[axis];
  thread_local std::vector<LinePiece> pieces;
  pieces.clear();
  std::vector<Part> parts;
  bool gap = false;
  for (int a = 0; a < lines_per_edge; ++a)
    for (int b = 0; b < lines_per_edge; ++b) {
      Vec3 x = leaf.centre;
      x[other] += leaf.half[other] * ((2.0 * a + 1.0) / lines_per_edge - 1.0);
      x[third] += leaf.half[third] * ((2.0 * b + 1.0) / lines_per_edge - 1.0);
      x[axis] = from;
      const std::vector<double> t = body.chord(x, axis, to - from);
      for (std::size_t pair = 0; pair + 1 < t.size(); pair += 2) {
        const double begin = t[pair], end = t[pair + 1];
        Vec3 middle = x;
        middle[axis] = from + 0.5 * (begin + end);
        half[axis] = 0.5 * (end - begin);
        gap = gap || pair > 0;
        pieces.push_back({a, b, begin, end, pieces.size()});
        add_box(parts.emplace_back(), middle, half);
      }
    }
  if (!gap)
    for (LinePiece& piece : pieces) piece.group = 0;
  if (gap) connect_lines(pieces);
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    const std::size_t group = pieces[k].group;
    if (group == k) continue;
    parts[group].volume += parts[k].volume;
    parts[group].first += parts[k].first;
    parts[group].second += parts[k].second;
    parts[k].volume = 0.0;
  }
  std::erase_if(parts, [](const Part& part) { return !(part.volume > 0.0); });
  return parts;
}

bool has_interface(const Leaf& leaf, const LabelAt& label_at) {
  const int label = label_at(leaf.centre);
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 sign(corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0, corner & 4 ? 1.0 : -1.0);
    if (label_at(leaf.centre + sign.cwiseProduct(leaf.half)) != label) return true;
  }
  return false;
}

std::vector<Part> parts_by_label(const BodySurface& body, const Leaf& leaf, const LabelAt& label_at) {
  constexpr int samples = 6;
  std::map<int, Part> parts;
  const Vec3 half = leaf.half / samples;
  for (int i = 0; i < samples; ++i)
    for (int j = 0; j < samples; ++j)
      for (int k = 0; k < samples; ++k) {
        const Vec3 step(2 * i + 1 - samples, 2 * j + 1 - samples, 2 * k + 1 - samples);
        const Vec3 x = leaf.centre + step.cwiseProduct(half);
        if (leaf.cut && !body.contains(x)) continue;
        add_box(parts[label_at(x)], x, half);
      }
  std::vector<Part> result;
  for (auto& [label, part] : parts) {
    part.label = label;
    result.push_back(part);
  }
  return result;
}

[[noreturn]] void refuse_grid(const BodySurface& body, double requested) {
  const Vec3 size = body.upper() - body.lower();
  throw ModelError(
      {.fact = fmt::format("{:.0f} integration points cannot be laid out evenly in this body", requested),
       .where = "integration grid",
       .why = fmt::format("the body fills {} of its bounding box of {:.4g} x {:.4g} x {:.4g} mm",
                          percent(body.volume() / size.prod()), size.x(), size.y(), size.z()),
       .remedy = "use more nodes (--nodes) or points (--points), or a coarser --rim"});
}

}  // namespace

IntegrationGrid make_integration_grid(const BodySurface& body, const GridOptions& options, Index node_count,
                                      const LabelAt& label_at) {
  const double requested = options.count > 0 ? static_cast<double>(options.count)
                                             : options.ratio * static_cast<double>(node_count);
  // Cut cells make the count larger than volume / cell; a few trials match the count.
  double edge = std::cbrt(body.volume() / requested);
  Cells cells;
  const Vec3 size = body.upper() - body.lower();
  for (int trial = 0; trial < trials; ++trial) {
    if (!(((size / edge).array() + 2.0).prod() < box_cells_per_point * requested + fewest_leaves))
      refuse_grid(body, requested);
    cells = fill(body, edge);
    const double error = std::clamp(static_cast<double>(count_points(cells)) / requested,
                                    1.0 / most_at_a_time, most_at_a_time);
    if (std::abs(error - 1.0) < 0.005) break;
    if (trial + 1 < trials) edge *= std::pow(error, 1.0 / 2.7);
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
                      .remedy = "use more points with --points"});
  grid.point.resize(3, static_cast<Index>(kept.size()));
  grid.volume.resize(static_cast<Index>(kept.size()));
  for (std::size_t q = 0; q < kept.size(); ++q) {
    const auto at = static_cast<Index>(q);
    grid.volume[at] = cells.volume[kept[q]];
    grid.point.col(at) = cells.moment.col(kept[q]) / cells.volume[kept[q]];
    if (std::abs(grid.volume[at] - whole) > 1e-9 * whole) ++grid.clipped;
  }
  set_labels(grid, label_at);
  return grid;
}

namespace {

// Boxes of the graded grid, about as many as requested.
std::vector<Leaf> graded_leaves(const BodySurface& body, const PointDensity& density, Index node_count,
                                double requested, const Sizing& sizing, double far_spacing) {
  const auto cell_volume = [&](double s) {
    return std::pow(far_spacing * s, 3) / (density.far + (density.patch_edge - density.far) * (1.0 - s));
  };
  double scale = static_cast<double>(node_count) * 13.0 / requested;  // measured with 1000 to 30,000 nodes
  const std::size_t most = std::max(fewest_leaves, leaves_per_point * static_cast<std::size_t>(requested));
  std::optional<std::vector<Leaf>> found;
  for (int trial = 0; trial < trials; ++trial) {
    found = bisect(
        body, std::cbrt(scale / density.far) * far_spacing, sizing,
        [&](double s) { return scale * cell_volume(s); }, most);
    const double error = found ? std::clamp(static_cast<double>(found->size()) / requested,
                                            1.0 / most_at_a_time, most_at_a_time)
                               : most_at_a_time;
    if (std::abs(error - 1.0) < 0.03) break;
    if (trial + 1 < trials) scale *= error;
  }
  if (!found) refuse_grid(body, requested);
  return std::move(*found);
}

// Parts of each leaf inside the body, with their labels.
std::vector<std::vector<Part>> parts_of(const BodySurface& body, const std::vector<Leaf>& leaves,
                                        const LabelAt& label_at) {
  std::vector<std::vector<Part>> parts(leaves.size());
  tbb::parallel_for(std::size_t{0}, leaves.size(), [&](std::size_t k) {
    stop_if_requested();
    if (label_at && has_interface(leaves[k], label_at)) {
      parts[k] = parts_by_label(body, leaves[k], label_at);
      return;
    }
    parts[k] = leaves[k].cut ? clip(body, leaves[k]) : std::vector<Part>{whole(leaves[k])};
    if (label_at)
      for (Part& part : parts[k]) part.label = label_at(part.first / part.volume);
  });
  return parts;
}

// Merges slivers into the nearest visible cell of the same tissue; among equals within rounding, the first.
void merge_slivers(const BodySurface& body, const std::vector<Part>& slivers, std::vector<Part>& kept,
                   IntegrationGrid& grid) {
  Points centre(3, static_cast<Index>(kept.size()));
  for (std::size_t k = 0; k < kept.size(); ++k)
    centre.col(static_cast<Index>(k)) = kept[k].first / kept[k].volume;
  const Neighbours tree(centre);
  for (const Part& small : slivers) {
    if (grid.merged % 256 == 0) stop_if_requested();
    const Vec3 x = small.first / small.volume;
    Index best = -1;
    double least = 0.0;
    for (const int k : tree.nearest(x, 12)) {
      if (kept[static_cast<std::size_t>(k)].label != small.label) continue;
      const double away = (x - centre.col(k)).norm();
      if (best >= 0 && away > (1.0 + 1e-6) * least) break;
      if (!body.sees(x, centre.col(k), std::cbrt(kept[static_cast<std::size_t>(k)].volume))) continue;
      if (best < 0) least = away;
      best = best < 0 ? k : std::min<Index>(best, k);
    }
    if (best < 0) continue;  // its volume is corrected later
    Part& other = kept[static_cast<std::size_t>(best)];
    other.volume += small.volume;
    other.first += small.first;
    other.second += small.second;
    ++grid.merged;
  }
}

}  // namespace

IntegrationGrid make_graded_grid(const BodySurface& body, const GridOptions& options, Index node_count,
                                 const Sizing& sizing, double far_spacing, const LabelAt& label_at) {
  const double requested = options.count > 0 ? static_cast<double>(options.count)
                                             : options.ratio * static_cast<double>(node_count);
  const std::vector<Leaf> leaves =
      graded_leaves(body, options.density, node_count, requested, sizing, far_spacing);
  const std::vector<std::vector<Part>> parts = parts_of(body, leaves, label_at);

  IntegrationGrid grid;
  std::vector<Part> kept, slivers;
  for (std::size_t k = 0; k < leaves.size(); ++k) {
    if (k % 65536 == 0) stop_if_requested();
    for (const Part& part : parts[k]) {
      grid.cell = std::max(grid.cell, std::cbrt(leaves[k].volume()));
      if (part.volume < (1.0 - 1e-9) * leaves[k].volume()) ++grid.clipped;
      (part.volume < sliver * leaves[k].volume() ? slivers : kept).push_back(part);
    }
  }
  if (kept.size() < 8)
    throw ModelError({.fact = fmt::format("only {} integration cells meet the body", kept.size()),
                      .where = "integration grid",
                      .why = fmt::format("the largest cell's edge is {:.2f} mm", grid.cell),
                      .remedy = "use more points with --points"});
  merge_slivers(body, slivers, kept, grid);
  // Lines sample the surface; the missing volume, a few in ten thousand, is distributed evenly.
  double sum = 0.0;
  for (const Part& part : kept) sum += part.volume;
  const double correction = body.volume() / sum;

  const auto count = static_cast<Index>(kept.size());
  grid.point.resize(3, count);
  grid.volume.resize(count);
  grid.second_moments.resize(6, count);
  grid.label.resize(count);
  for (Index q = 0; q < count; ++q) {
    const Part& part = kept[static_cast<std::size_t>(q)];
    const Vec3 x = part.first / part.volume;
    const Mat3 about = part.second / part.volume - x * x.transpose();
    grid.point.col(q) = x;
    grid.volume[q] = part.volume * correction;
    set_moments(grid.second_moments, q, about);
    grid.label[q] = part.label;
  }
  return grid;
}

}  // namespace dimple
