#include "preprocess/supports/sheet_cut.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/nodes/lumped_mass.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/supports/divide_cells.hpp"
#include "preprocess/supports/pressure_patches.hpp"
#include "preprocess/supports/support.hpp"
#include "preprocess/surface/sight.hpp"

namespace dimple {
namespace {

constexpr double farthest_grown = 2.5;  // largest growth of a support, see find_supports()

[[noreturn]] void refuse(const std::string& fact, const std::string& why, const std::string& remedy) {
  throw ModelError({.fact = fact, .where = "cut", .why = why, .remedy = remedy, .code = "cut"});
}

// Approximate extent of a point's cell from its middle.
double margin_of(const Model& model, Index q) {
  if (model.second_moments.cols() == 0) return 0.0;
  return 2.0 * std::sqrt(std::max(0.0, model.second_moments.col(q).head<3>().sum()));
}

// Distance from a cell's middle to the eight places of its mean gradients, in the body's own axes.
double farthest_place(const Model& model, Index q) {
  if (model.second_moments.cols() == 0) return 0.0;
  const Mat3 own = model.axes.transpose() * as_matrix(model.second_moments, q) * model.axes;
  const double across = std::abs(own(0, 1)) + std::abs(own(1, 2)) + std::abs(own(2, 0));
  return 1.001 * std::sqrt(std::max(0.0, own.trace() + 2.0 * across));
}

// Points whose cell is divided, that a node of theirs is hidden from, or that an added one reaches;
// ascending.
std::vector<Index> changed_points(const Model& before, const DividedCells& cut, const Sheet& sheet,
                                  Looked looked) {
  const auto all = static_cast<Index>(cut.whole.size());
  std::vector<char> changed(cut.whole.size(), 0);
  for (Index second = before.point_count(); second < all; ++second)
    changed[static_cast<std::size_t>(second)] =
        changed[static_cast<std::size_t>(cut.whole[static_cast<std::size_t>(second)])] = 1;
  const Index added = cut.model.node_count() - before.node_count();
  const Points its = cut.model.X.rightCols(added);
  const Eigen::VectorXd radius = before.scheme.support.radius_factor * cut.model.spacing.tail(added);
  const double farthest_added = added > 0 ? radius.maxCoeff() : 0.0;
  tbb::parallel_for(Index{0}, before.point_count(), [&](Index q) {
    if (q % 4096 == 0) stop_if_requested();
    if (changed[static_cast<std::size_t>(q)]) return;
    const Vec3 x = before.point.col(q);
    const double margin = farthest_place(before, q);
    const auto nodes = before.support.member.segment(before.support.offset[q], before.support.count(q));
    if (looked == Looked::near_sheet) {
      double farthest = farthest_added + margin;
      for (const int a : nodes) farthest = std::max(farthest, (before.X.col(a) - x).norm());
      if (!sheet.reaches(x, farthest + off_sheet * farthest)) return;
    }
    bool is_changed =
        std::any_of(nodes.begin(), nodes.end(), [&](int a) { return sheet.between(before.X.col(a), x); });
    for (Index k = 0; k < added && !is_changed; ++k)
      is_changed = (its.col(k) - x).norm() < radius[k] + margin && !sheet.between(its.col(k), x);
    changed[static_cast<std::size_t>(q)] = is_changed;
  });
  std::vector<Index> result;
  for (Index q = 0; q < all; ++q)
    if (changed[static_cast<std::size_t>(q)]) result.push_back(q);
  return result;
}

// Some of the points, and the nodes that their supports may use.
struct Neighbourhood {
  Model model;
  std::vector<Index> point, node;  // by their numbers in the whole, ascending
};

std::vector<Index> among(const std::vector<Index>& some, const std::vector<Index>& nodes) {
  std::vector<Index> result;
  for (const Index a : some)
    if (const auto at = std::lower_bound(nodes.begin(), nodes.end(), a); at != nodes.end() && *at == a)
      result.push_back(at - nodes.begin());
  return result;
}

Neighbourhood neighbourhood_of(const Model& model, std::vector<Index> points, Looked looked) {
  Neighbourhood near{{}, std::move(points), {}};
  const Points places = model.point(Eigen::all, near.point);
  const Vec3 lower = places.rowwise().minCoeff(), upper = places.rowwise().maxCoeff();
  double margin = 0.0;
  for (const Index q : near.point) margin = std::max(margin, margin_of(model, q));
  const double factor = farthest_grown * model.scheme.support.radius_factor;
  for (Index a = 0; a < model.node_count(); ++a) {
    const double reach = factor * model.spacing[a] + margin;
    const Vec3 x = model.X.col(a);
    const bool near_points = ((x - lower).array() >= -reach).all() && ((x - upper).array() <= reach).all();
    if (near_points || looked == Looked::everywhere) near.node.push_back(a);
  }
  Model& its = near.model;
  its.scheme = model.scheme;
  its.axes = model.axes;
  its.X = model.X(Eigen::all, near.node);
  its.spacing = model.spacing(near.node);
  its.point = places;
  its.volume = model.volume(near.point);
  if (model.second_moments.cols() > 0) its.second_moments = model.second_moments(Eigen::all, near.point);
  its.tissue = model.tissue(near.point);
  its.base = among(model.base, near.node);
  its.bonded_patch = among(model.bonded_patch, near.node);
  return near;
}

bool has(const Model& model, Index q, Index node) {
  const int* members = model.support.member.data();
  return std::binary_search(members + model.support.offset[q], members + model.support.offset[q + 1],
                            static_cast<int>(node));
}

bool contains(const std::vector<Index>& ascending, Index k) {
  return std::binary_search(ascending.begin(), ascending.end(), k);
}

// `model`: the cut one, its supports not found yet.
void find_changed(Neighbourhood& near, const Model& before, const Model& model, const Sheet& sheet,
                  const Sight& sight) {
  // A point saw its nodes before, unless it took nodes that it does not see, for want of others. The parts of
  // a cell have middles of their own.
  std::vector<char> saw_all(near.point.size());
  for (std::size_t p = 0; p < saw_all.size(); ++p)
    saw_all[p] = near.point[p] < before.point_count() &&
                 before.point.col(near.point[p]) == model.point.col(near.point[p]) &&
                 !contains(before.support_report.unconnected, near.point[p]);
  find_supports_seen(near.model, [&](int k, Index p) {
    const Index a = near.node[static_cast<std::size_t>(k)], q = near.point[static_cast<std::size_t>(p)];
    const bool known = saw_all[static_cast<std::size_t>(p)] && a < before.node_count() && has(before, q, a);
    return known ? !sheet.between(model.X.col(a), model.point.col(q)) : sight.sees(a, q);
  });
}

// Contributions of points of the body before the cut to its variance.
void find_fractions(Neighbourhood& near, const Model& before) {
  std::vector<char> looks(near.point.size());
  for (std::size_t p = 0; p < looks.size(); ++p)
    looks[p] = before.sight && contains(before.support_report.unconnected, near.point[p]);
  find_supports_seen(near.model, [&](int k, Index p) {
    const Index a = near.node[static_cast<std::size_t>(k)], q = near.point[static_cast<std::size_t>(p)];
    return looks[static_cast<std::size_t>(p)] ? before.sight->sees(a, q) : has(before, q, a);
  });
}

// Lists of which some rows are replaced: row r is row `of[r]` of `now` or, where that is negative, row
// `from[r]` of `before`. `copy`(to, from, count, is_now) copies the members' data.
template <class Copy>
CompressedRows put_together(const CompressedRows& before, const CompressedRows& now,
                            const std::vector<Index>& of, const std::vector<Index>& from, const Copy& copy) {
  CompressedRows rows;
  const auto count = static_cast<Index>(of.size());
  rows.offset.resize(count + 1);
  rows.offset[0] = 0;
  const auto source = [&](Index r) -> std::pair<const CompressedRows&, Index> {
    const auto k = static_cast<std::size_t>(r);
    if (of[k] >= 0) return {now, of[k]};
    return {before, from[k]};
  };
  for (Index r = 0; r < count; ++r) {
    const auto [rows_of, row] = source(r);
    rows.offset[r + 1] = rows.offset[r] + static_cast<int>(rows_of.count(row));
  }
  rows.member.resize(rows.offset[count]);
  copy(Index{-1}, Index{0}, Index{rows.member.size()}, false);
  tbb::parallel_for(Index{0}, count, [&](Index r) {
    const auto [rows_of, row] = source(r);
    const Index to = rows.offset[r], first = rows_of.offset[row], n = rows_of.count(row);
    const bool is_now = of[static_cast<std::size_t>(r)] >= 0;
    rows.member.segment(to, n) = rows_of.member.segment(first, n);
    copy(to, first, n, is_now);
  });
  return rows;
}

// Renames members to their numbers in the whole.
void name(CompressedRows& rows, const std::vector<Index>& node) {
  for (int& member : rows.member) member = static_cast<int>(node[static_cast<std::size_t>(member)]);
}

void take_supports(const Model& before, const Neighbourhood& near, const std::vector<Index>& whole,
                   Model& model) {
  std::vector<Index> of(whole.size(), -1);
  for (std::size_t k = 0; k < near.point.size(); ++k)
    of[static_cast<std::size_t>(near.point[k])] = static_cast<Index>(k);
  model.support = put_together(
      before.support, near.model.support, of, whole, [&](Index to, Index first, Index n, bool is_now) {
        if (to < 0)
          model.dphi.resize(3, n);
        else
          model.dphi.middleCols(to, n) = (is_now ? near.model.dphi : before.dphi).middleCols(first, n);
      });
}

const GradientVariance* of_tissue(const std::vector<GradientVariance>& all, int tissue) {
  const auto its =
      std::find_if(all.begin(), all.end(), [&](const GradientVariance& v) { return v.tissue == tissue; });
  return its == all.end() ? nullptr : &*its;
}

// A row of the variance with contributions removed and added: exact, since over_cell() rounds them.
struct Row {
  std::vector<int> member;
  std::vector<double> K;

  // `v`: of a neighbourhood in which the row's node has the number `a`, if it is in it. Entries that become
  // zero remain if they are in another cell (`is_shared`).
  template <class IsShared>
  void add(const GradientVariance* v, Index a, double sign, const IsShared& is_shared) {
    if (!v || a < 0 || v->rows.count(a) == 0) return;
    Row sum;
    sum.member.reserve(member.size() + static_cast<std::size_t>(v->rows.count(a)));
    sum.K.reserve(sum.member.capacity());
    int k = v->rows.offset[a];
    const int last = v->rows.offset[a + 1];
    for (std::size_t m = 0; m < member.size() || k < last;) {
      const bool old = m < member.size() && (k == last || member[m] <= v->rows.member[k]);
      const bool its = k < last && (m == member.size() || v->rows.member[k] <= member[m]);
      const int column = old ? member[m] : v->rows.member[k];
      double value = 0.0;
      if (old) value += K[m++];
      if (its) value += sign * v->K[k++];
      if (its && value == 0.0 && !is_shared(column)) continue;
      sum.member.push_back(column);
      sum.K.push_back(value);
    }
    *this = std::move(sum);
  }
};

// Numbers of all nodes in a neighbourhood; -1: not in it.
std::vector<Index> numbers_in(const Neighbourhood& near, Index nodes) {
  std::vector<Index> result(static_cast<std::size_t>(nodes), -1);
  for (std::size_t k = 0; k < near.node.size(); ++k)
    result[static_cast<std::size_t>(near.node[k])] = static_cast<Index>(k);
  return result;
}

// For each node of a neighbourhood, the points outside of it that it belongs to.
std::vector<std::vector<Index>> other_points(const Model& model, const Neighbourhood& near,
                                             const std::vector<Index>& number) {
  std::vector<std::vector<Index>> result(near.node.size());
  for (Index q = 0; q < model.point_count(); ++q) {
    if (contains(near.point, q)) continue;
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
      if (const Index a = number[static_cast<std::size_t>(model.support.member[k])]; a >= 0)
        result[static_cast<std::size_t>(a)].push_back(q);
  }
  return result;
}

// A row is a sum over all points of its node: the former terms of changed points are removed, the new ones
// added. `was`, `now`: their variances, members by their numbers in the whole.
void take_variance(const Model& before, const Neighbourhood& was, const Neighbourhood& now, Model& model) {
  const Index nodes = model.node_count();
  const std::vector<Index> then_number = numbers_in(was, nodes), number = numbers_in(now, nodes);
  const std::vector<std::vector<Index>> others = other_points(before, was, then_number);
  for (const GradientVariance& old : before.variance) {
    const GradientVariance *less = of_tissue(was.model.variance, old.tissue),
                           *more = of_tissue(now.model.variance, old.tissue);
    const auto old_row = [&](Index a) {
      if (a >= before.node_count()) return std::pair(Index{0}, Index{0});
      return std::pair(Index{old.rows.offset[a]}, old.rows.count(a));
    };
    std::vector<Row> row(static_cast<std::size_t>(nodes));
    GradientVariance& sum = model.variance.emplace_back();
    sum.tissue = old.tissue;
    sum.rows.offset = Eigen::VectorXi::Zero(nodes + 1);
    const auto is_changed = [&](std::size_t k) { return then_number[k] >= 0 || number[k] >= 0; };
    tbb::parallel_for(Index{0}, nodes, [&](Index a) {
      const auto k = static_cast<std::size_t>(a);
      const auto [first, n] = old_row(a);
      Row& its = row[k];
      if (is_changed(k)) {
        its.member.assign(old.rows.member.data() + first, old.rows.member.data() + first + n);
        its.K.assign(old.K.data() + first, old.K.data() + first + n);
        its.add(less, then_number[k], -1.0, [&](int b) {
          const auto& points = others[static_cast<std::size_t>(then_number[k])];
          return std::any_of(points.begin(), points.end(),
                             [&](Index q) { return before.tissue[q] == old.tissue && has(before, q, b); });
        });
        its.add(more, number[k], 1.0, [](int) { return true; });
      }
      sum.rows.offset[a + 1] =
          static_cast<int>(is_changed(k) ? its.member.size() : static_cast<std::size_t>(n));
    });
    std::partial_sum(sum.rows.offset.begin(), sum.rows.offset.end(), sum.rows.offset.begin());
    sum.rows.member.resize(sum.rows.offset[nodes]);
    sum.K.resize(sum.rows.offset[nodes]);
    tbb::parallel_for(Index{0}, nodes, [&](Index a) {
      const auto k = static_cast<std::size_t>(a);
      const Index first = old_row(a).first, n = sum.rows.count(a);
      const int* member = is_changed(k) ? row[k].member.data() : old.rows.member.data() + first;
      const double* K = is_changed(k) ? row[k].K.data() : old.K.data() + first;
      std::copy(member, member + n, sum.rows.member.data() + sum.rows.offset[a]);
      std::copy(K, K + n, sum.K.data() + sum.rows.offset[a]);
    });
  }
}

// Throws if some nodes are connected, through common points, with no held node.
void refuse_parted(const Model& model, const std::vector<Index>& held) {
  std::vector<Index> first(static_cast<std::size_t>(model.node_count()));
  std::iota(first.begin(), first.end(), Index{0});
  const auto root = [&](Index a) {
    while (first[static_cast<std::size_t>(a)] != a) {
      Index& up = first[static_cast<std::size_t>(a)];
      a = up = first[static_cast<std::size_t>(up)];
    }
    return a;
  };
  for (Index q = 0; q < model.point_count(); ++q) {
    const int at = model.support.offset[q];
    for (int k = at + 1; k < model.support.offset[q + 1]; ++k) {
      const Index a = root(model.support.member[at]), b = root(model.support.member[k]);
      first[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
    }
  }
  std::vector<char> is_held(first.size(), 0);
  for (const Index a : held) is_held[static_cast<std::size_t>(root(a))] = 1;
  Index loose = 0;
  for (Index a = 0; a < model.node_count(); ++a) loose += is_held[static_cast<std::size_t>(root(a))] ? 0 : 1;
  if (loose > 0)
    refuse(fmt::format("the blade separates {} of {} nodes from every held part", loose, model.node_count()),
           "a part that is not held has no equilibrium",
           "let the blade end in the tissue, or remove the piece with `dimple run --cut`");
}

}  // namespace

Points carried(const SheetCut& cut, const Points& u) {
  Points result(3, u.cols() + cut.added.rows.rows());
  result << u, cut.added(u);
  return result;
}

namespace {

// Vertices by position, and triangles of them.
struct Pieces {
  std::map<std::array<double, 3>, int> number;
  std::vector<Vec3> vertex;
  std::vector<std::array<int, 3>> triangle;
  void add(const std::array<Vec3, 3>& corner) {
    std::array<int, 3> its{};
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3& x = corner[k];
      const auto [at, is_new] = number.emplace(std::array{x[0], x[1], x[2]}, static_cast<int>(vertex.size()));
      if (is_new) vertex.push_back(x);
      its[k] = at->second;
    }
    triangle.push_back(its);
  }
};

// Divides a triangle into quarters, `rounds` times.
void quarter(const std::array<Vec3, 3>& t, int rounds,
             const std::function<void(const std::array<Vec3, 3>&)>& each) {
  if (rounds == 0) return each(t);
  const Vec3 ab = 0.5 * (t[0] + t[1]), bc = 0.5 * (t[1] + t[2]), ca = 0.5 * (t[2] + t[0]);
  for (const std::array<Vec3, 3>& part :
       {std::array{t[0], ab, ca}, std::array{ab, t[1], bc}, std::array{ca, bc, t[2]}, std::array{ab, bc, ca}})
    quarter(part, rounds - 1, each);
}

// The part of a sheet that does not repeat an earlier cut. Between sheets closer together than the nodes,
// cells and nodes would belong to nothing: a body cut twice at one place was stiffer than cut once, and found
// no equilibrium.
std::shared_ptr<const Sheet> not_cut_yet(const Model& before, const std::shared_ptr<const Sheet>& sheet) {
  constexpr double close = 0.25;  // spacings
  constexpr int most_rounds = 5;
  if (!before.sight || before.sight->sheets().empty()) return sheet;
  const Neighbours nodes(before.X);
  const auto spacing_at = [&](const Vec3& x) { return before.spacing[nodes.nearest(x, 1).front()]; };
  const auto is_cut = [&](const Vec3& x) {
    const double h = spacing_at(x);
    return std::any_of(before.sight->sheets().begin(), before.sight->sheets().end(),
                       [&](const auto& other) { return other->reaches(x, close * h); });
  };
  // A crossing sheet is near along a line only: a spacing away, it is near on neither side.
  const auto continues = [&](const std::array<Vec3, 3>& t) {
    const Vec3 middle = (t[0] + t[1] + t[2]) / 3.0, along = (t[1] - t[0]).normalized();
    const Vec3 across = (t[1] - t[0]).cross(t[2] - t[0]).cross(along).normalized();
    const double h = spacing_at(middle);
    return (is_cut(middle + h * along) || is_cut(middle - h * along)) &&
           (is_cut(middle + h * across) || is_cut(middle - h * across));
  };
  const auto corners = [&](Index t) {
    const auto& v = sheet->triangles();
    return std::array<Vec3, 3>{sheet->vertex().col(v(0, t)), sheet->vertex().col(v(1, t)),
                               sheet->vertex().col(v(2, t))};
  };
  double longest = 0.0;  // edge, in spacings
  for (Index t = 0; t < sheet->triangles().cols(); ++t) {
    const std::array<Vec3, 3> c = corners(t);
    for (std::size_t k = 0; k < 3; ++k)
      longest = std::max(longest, (c[k] - c[(k + 1) % 3]).norm() / spacing_at(c[k]));
  }
  const int rounds =
      std::clamp(static_cast<int>(std::ceil(std::log2(std::max(longest, 1.0)))), 0, most_rounds);
  Pieces left;
  bool goes_along = false;
  for (Index t = 0; t < sheet->triangles().cols(); ++t) {
    stop_if_requested();
    quarter(corners(t), rounds, [&](const std::array<Vec3, 3>& part) {
      const bool along = std::all_of(part.begin(), part.end(), is_cut) && continues(part);
      goes_along = goes_along || along;
      if (!along) left.add(part);
    });
  }
  if (!goes_along) return sheet;
  if (left.triangle.empty())
    refuse("the body is cut there already",
           "the whole path of the blade is within a quarter of a node spacing of an earlier cut",
           "cut elsewhere, or deeper");
  Points vertex(3, static_cast<Index>(left.vertex.size()));
  for (Index v = 0; v < vertex.cols(); ++v) vertex.col(v) = left.vertex[static_cast<std::size_t>(v)];
  Triangles triangles(3, static_cast<Index>(left.triangle.size()));
  for (Index t = 0; t < triangles.cols(); ++t) {
    const std::array<int, 3>& its = left.triangle[static_cast<std::size_t>(t)];
    triangles.col(t) << its[0], its[1], its[2];
  }
  return std::make_shared<const Sheet>(std::move(vertex), std::move(triangles));
}

}  // namespace

SheetCut cut_by_sheet(const Model& before, const std::shared_ptr<const Sheet>& blade,
                      const std::vector<double>& density, const std::vector<Index>& held, Looked looked) {
  const std::shared_ptr<const Sheet> sheet = not_cut_yet(before, blade);
  DividedCells divided = divide_cells(before, *sheet);
  const std::vector<Index> changed = changed_points(before, divided, *sheet, looked);
  SheetCut cut{.model = std::move(divided.model),
               .added = {},
               .of_patch = {},
               .divided = divided.count,
               .area = divided.area};
  Model& model = cut.model;
  cut.added = inner_interpolation(before, model.X.rightCols(model.node_count() - before.node_count()));
  cut.changed = static_cast<Index>(changed.size());
  if (changed.empty())
    refuse("the blade meets no tissue", "its path is outside of the body, or along another cut", "move it");
  const Eigen::VectorXd radius = model.scheme.support.radius_factor * model.spacing;
  const auto sight = std::make_shared<const Sight>(before.sight, sheet, model, radius, divided.whole);
  model.sight = sight;

  Neighbourhood near = neighbourhood_of(model, changed, looked);
  find_changed(near, before, model, *sheet, *sight);
  name(near.model.support, near.node);
  take_supports(before, near, divided.whole, model);
  model.support_report = before.support_report;
  model.support_report.unseen += near.model.support_report.unseen;
  std::vector<Index>& unconnected = model.support_report.unconnected;
  std::erase_if(unconnected, [&](Index q) { return contains(changed, q); });
  for (const Index p : near.model.support_report.unconnected)
    unconnected.push_back(changed[static_cast<std::size_t>(p)]);
  std::sort(unconnected.begin(), unconnected.end());
  model.consistency_report = before.consistency_report;
  refuse_parted(model, held);

  if (!before.variance.empty()) {
    const auto there = std::lower_bound(changed.begin(), changed.end(), before.point_count());
    Neighbourhood was = neighbourhood_of(before, {changed.begin(), there}, looked);
    find_fractions(was, before);
    for (GradientVariance& v : was.model.variance) name(v.rows, was.node);
    for (GradientVariance& v : near.model.variance) name(v.rows, near.node);
    take_variance(before, was, near, model);
  }
  if (before.patches.count() > 0) {
    model.patches = before.patches;
    cut.of_patch = divide_patches(model, divided.whole, changed);
  }
  Eigen::VectorXd of_point(model.point_count());
  for (Index q = 0; q < of_point.size(); ++q)
    of_point[q] = density[static_cast<std::size_t>(model.tissue[q])];
  model.mass = lumped_mass(model, of_point);
  return cut;
}

}  // namespace dimple
