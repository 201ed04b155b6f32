#include "preprocess/supports/divide_cells.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <optional>

#include "io/stop.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/surface/sight.hpp"

namespace dimple {
namespace {

constexpr int samples_per_axis = 4;      // samples of a cell along each of its axes
constexpr double least_of_cell = 0.125;  // least part of a cell
// Distances of the nodes on the faces, in spacings: from each other, from existing nodes, and from where the
// sheet ends in the tissue.
constexpr double apart = 0.7, from_others = 0.4, from_end = 0.5;

// A cell as the box that has its second moments, about its middle.
struct Box {
  Mat3 axes;  // columns
  Vec3 half;  // of its edges
};

// Requires a cell of positive size.
Box box_of(const Model& model, Index q) {
  const Mat3 about = as_matrix(model.second_moments, q);
  const double size = about.trace();
  const Eigen::SelfAdjointEigenSolver<Mat3> solver(about / size);
  return {solver.eigenvectors(), (3.0 * size * solver.eigenvalues().cwiseMax(0.0)).cwiseSqrt()};
}

// A part of a cell.
struct CellPart {
  double fraction = 0.0;
  Vec3 middle = Vec3::Zero();
  Mat3 about = Mat3::Zero();
};

// Part of a cell from some of its samples, each a box with the moments `of_sample`.
CellPart part_of(const std::vector<Vec3>& sample, const Mat3& of_sample, std::size_t all) {
  CellPart part;
  const auto count = static_cast<double>(sample.size());
  part.fraction = count / static_cast<double>(all);
  for (const Vec3& x : sample) part.middle += x / count;
  part.about = of_sample;
  for (const Vec3& x : sample) part.about += (x - part.middle) * (x - part.middle).transpose() / count;
  return part;
}

// The two parts into which a sheet divides a cell, the larger first: samples of the box with the cell's
// second moments are on the side of the first sample or on the other. Nothing: the cell remains whole.
std::optional<std::array<CellPart, 2>> parts_of(const Model& model, Index q, const Sheet& sheet) {
  const Mat3 about = as_matrix(model.second_moments, q);
  const double size = about.trace();
  const Vec3 middle = model.point.col(q);
  if (!(size > 0.0) || !sheet.reaches(middle, std::sqrt(3.0 * size))) return {};
  const Box box = box_of(model, q);
  std::array<std::vector<Vec3>, 2> sides;
  std::optional<Vec3> first;
  for (int k = 0; k < samples_per_axis * samples_per_axis * samples_per_axis; ++k) {
    const Eigen::Array3d at((k % samples_per_axis) + 0.5, (k / samples_per_axis % samples_per_axis) + 0.5,
                            (k / (samples_per_axis * samples_per_axis)) + 0.5);
    const Vec3 x = middle + box.axes * ((2.0 / samples_per_axis * at - 1.0) * box.half.array()).matrix();
    if (!first) first = x;
    sides[sheet.between(*first, x) ? 1 : 0].push_back(x);
  }
  if (sides[1].size() > sides[0].size()) sides[0].swap(sides[1]);
  const std::size_t all = sides[0].size() + sides[1].size();
  const Mat3 of_sample = about / (samples_per_axis * samples_per_axis);
  const std::array<CellPart, 2> parts = {part_of(sides[0], of_sample, all),
                                         part_of(sides[1], of_sample, all)};
  return parts[1].fraction < least_of_cell ? std::nullopt : std::optional(parts);
}

// Crossing of the sheet by the segment between the middles of a cell's parts; none if it passes by.
std::optional<Vec3> place_on_sheet(const std::array<CellPart, 2>& parts, const Sheet& sheet) {
  constexpr int halvings = 30;
  Vec3 low = parts[0].middle, high = parts[1].middle;
  if (!sheet.between(low, high)) return {};
  for (int k = 0; k < halvings; ++k) {
    const Vec3 middle = 0.5 * (low + high);
    (sheet.between(low, middle) ? high : low) = middle;
  }
  return low;
}

// Test for tissue: a place in the box of the nearest point's cell.
class Tissue {
 public:
  explicit Tissue(const Model& model) : model_(model), points_(model.point) {}
  bool holds(const Vec3& x) const {
    const Index q = points_.nearest(x, 1).front();
    const Box box = box_of(model_, q);
    const Vec3 away = box.axes.transpose() * (x - model_.point.col(q));
    return (away.cwiseAbs().array() <= 1.001 * box.half.array()).all();
  }

 private:
  const Model& model_;
  Neighbours points_;
};

double area_within(const Tissue& tissue, const Sheet& sheet) {
  double area = 0.0;
  for (const auto& t : sheet.triangles().colwise()) {
    const Vec3 a = sheet.vertex().col(t[0]), b = sheet.vertex().col(t[1]), c = sheet.vertex().col(t[2]);
    if (tissue.holds((a + b + c) / 3.0)) area += 0.5 * (b - a).cross(c - a).norm();
  }
  return area;
}

// The pieces of a sheet's border in the tissue.
std::vector<std::pair<Vec3, Vec3>> ends_of(const Sheet& sheet, const Tissue& tissue) {
  std::map<std::pair<int, int>, int> times;
  for (const auto& t : sheet.triangles().colwise())
    for (int k = 0; k < 3; ++k)
      ++times[std::minmax(static_cast<int>(t[k]), static_cast<int>(t[(k + 1) % 3]))];
  std::vector<std::pair<Vec3, Vec3>> ends;
  for (const auto& [edge, count] : times) {
    const Vec3 a = sheet.vertex().col(edge.first), b = sheet.vertex().col(edge.second);
    if (count == 1 && tissue.holds(a) && tissue.holds(b)) ends.emplace_back(a, b);
  }
  return ends;
}

double distance_to(const std::vector<std::pair<Vec3, Vec3>>& edges, const Vec3& x) {
  double least = std::numeric_limits<double>::infinity();
  for (const auto& [a, b] : edges) {
    const Vec3 edge = b - a;
    const double fraction = std::clamp((x - a).dot(edge) / edge.squaredNorm(), 0.0, 1.0);
    least = std::min(least, (x - a - fraction * edge).norm());
  }
  return least;
}

void put(Model& model, Index q, const CellPart& part, double volume) {
  model.point.col(q) = part.middle;
  model.volume[q] = part.fraction * volume;
  set_moments(model.second_moments, q, part.about);
}

// Divides the cells; the parts of each divided cell, the larger first, are appended to `halves`.
DividedCells divide(const Model& before, const Sheet& sheet, std::vector<std::array<CellPart, 2>>& halves) {
  const Index points = before.point_count();
  std::map<Index, std::array<CellPart, 2>> parts;
  for (Index q = 0; q < points && before.second_moments.cols() > 0; ++q) {
    if (q % 4096 == 0) stop_if_requested();
    if (const auto its = parts_of(before, q, sheet)) parts.emplace(q, *its);
  }
  DividedCells cut;
  static_cast<Discretisation&>(cut.model) = before;
  cut.model.scheme = before.scheme;
  cut.whole.resize(static_cast<std::size_t>(points));
  std::iota(cut.whole.begin(), cut.whole.end(), Index{0});
  for (const auto& [q, its] : parts) cut.whole.push_back(q);
  const auto all = static_cast<Index>(cut.whole.size());
  cut.count = all - points;
  Model& model = cut.model;
  model.point.conservativeResize(3, all);
  model.volume.conservativeResize(all);
  if (before.second_moments.cols() > 0) model.second_moments.conservativeResize(6, all);
  model.label = before.label(cut.whole);
  model.tissue = before.tissue(cut.whole);
  for (Index second = points; second < all; ++second) {
    const Index q = cut.whole[static_cast<std::size_t>(second)];
    const std::array<CellPart, 2>& its = parts.at(q);
    put(model, second, its[1], before.volume[q]);
    put(model, q, its[0], before.volume[q]);
    halves.push_back(its);
  }
  return cut;
}

double spacing_at(const Model& model, Index q) {
  const auto nodes = model.support.member.segment(model.support.offset[q], model.support.count(q));
  double sum = 0.0;
  for (const int a : nodes) sum += model.spacing[a];
  return sum / static_cast<double>(nodes.size());
}

// Adds nodes on both faces of the cut, behind those that are there.
void add_nodes(const Model& before, const Sheet& sheet, const std::vector<std::array<CellPart, 2>>& halves,
               DividedCells& cut) {
  if (halves.empty()) return;
  const Tissue tissue(before);
  const std::vector<std::pair<Vec3, Vec3>> ends = ends_of(sheet, tissue);
  cut.area = area_within(tissue, sheet);
  const Neighbours nodes(before.X);
  std::vector<Vec3> on_sheet, added;
  std::vector<double> spacing;
  std::vector<int> near;
  for (std::size_t k = 0; k < halves.size(); ++k) {
    const Index q = cut.whole[static_cast<std::size_t>(before.point_count()) + k];
    const double h = spacing_at(before, q);
    const std::optional<Vec3> place = place_on_sheet(halves[k], sheet);
    if (!place || distance_to(ends, *place) < from_end * h ||
        std::any_of(on_sheet.begin(), on_sheet.end(),
                    [&](const Vec3& other) { return (other - *place).norm() < apart * h; }))
      continue;
    on_sheet.push_back(*place);
    const Vec3 across = (halves[k][0].middle - halves[k][1].middle).normalized();
    for (const double side : {1.0, -1.0}) {
      const Vec3 x = *place + side * off_sheet * h * across;
      if (before.sight && !before.sight->point_sees(q, x)) continue;  // it would belong to no point
      nodes.within(*place, from_others * h, near);
      if (std::any_of(near.begin(), near.end(), [&](int a) { return !sheet.between(before.X.col(a), x); }))
        continue;
      added.push_back(x);
      spacing.push_back(h);
    }
  }
  Model& model = cut.model;
  const auto count = static_cast<Index>(added.size());
  model.X.conservativeResize(3, before.node_count() + count);
  model.spacing.conservativeResize(before.node_count() + count);
  for (Index k = 0; k < count; ++k) {
    model.X.col(before.node_count() + k) = added[static_cast<std::size_t>(k)];
    model.spacing[before.node_count() + k] = spacing[static_cast<std::size_t>(k)];
  }
}

}  // namespace

DividedCells divide_cells(const Model& before, const Sheet& sheet) {
  std::vector<std::array<CellPart, 2>> halves;
  DividedCells cut = divide(before, sheet, halves);
  add_nodes(before, sheet, halves, cut);
  return cut;
}

}  // namespace dimple
