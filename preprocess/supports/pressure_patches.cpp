#include "preprocess/supports/pressure_patches.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numeric>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/side_by_side.hpp"

namespace dimple {
namespace {

constexpr double reach = 1.3;  // of a patch, in patch spacings
constexpr int lloyd_sweeps = 4;
constexpr double largest_growth = 1e4;  // for points in far corners
constexpr double far_corner = 3.0;      // from this growth on the nearest patch is used, connected or not
constexpr double coarse = 0.75;         // least spacing, of the largest, of points with few patches in reach
constexpr double snap =
    1e-8;  // [m] coordinates that differ by less are ties, broken by number; and a small fraction

struct PointPlaces {
  Points x;               // in the image's axes, [m]
  Eigen::VectorXd h;      // spacing of the nodes around
  Eigen::VectorXd worth;  // V / h^3
  double largest_h = 0.0;
};

using Groups = std::vector<std::vector<int>>;

// Halves `group` into `count` groups of equal worth, each time across its longest side.
Groups split(const PointPlaces& places, std::vector<int> group, Index count) {
  stop_if_requested();
  if (count <= 1 || group.size() < 2) return {std::move(group)};
  Vec3 lower = Vec3::Constant(std::numeric_limits<double>::infinity()), upper = -lower;
  double worth = 0.0;
  for (const int q : group) {
    lower = lower.cwiseMin(places.x.col(q));
    upper = upper.cwiseMax(places.x.col(q));
    worth += places.worth[q];
  }
  const Vec3 side = upper - lower;
  int axis = 0;
  for (int d = 1; d < 3; ++d)
    if (side[d] > side[axis] + snap) axis = d;
  std::vector<std::pair<double, int>> along;
  for (const int q : group) along.emplace_back(places.x(axis, q), q);
  std::sort(along.begin(), along.end());
  for (std::size_t k = 0; k < group.size(); ++k) group[k] = along[k].second;
  for (std::size_t from = 0; from < group.size();) {  // ties within rounding: layers of a grid
    std::size_t to = from + 1;
    while (to < group.size() && along[to].first - along[to - 1].first < snap) ++to;
    std::sort(group.begin() + static_cast<std::ptrdiff_t>(from),
              group.begin() + static_cast<std::ptrdiff_t>(to));
    from = to;
  }
  const Index below = count / 2;
  const double requested = worth * static_cast<double>(below) / static_cast<double>(count);
  std::size_t at = 0;
  for (double sum = 0.0;
       at + 1 < group.size() && sum + 0.5 * places.worth[group[at]] < (1.0 - snap) * requested; ++at)
    sum += places.worth[group[at]];
  at = std::max<std::size_t>(at, 1);
  const auto middle = group.begin() + static_cast<std::ptrdiff_t>(at);
  Groups first, second;
  side_by_side(
      [&] {
        first = split(places, {group.begin(), middle}, below);
      },
      [&] {
        second = split(places, {middle, group.end()}, count - below);
      });
  std::move(second.begin(), second.end(), std::back_inserter(first));
  return first;
}

struct Patches {
  Points centre;
  Eigen::VectorXd radius;
  std::vector<int> middle;  // the point nearest to each centre
};

// True if two points have a node in common. On opposing walls of a gap they have none.
bool have_common_node(const CompressedRows& support, int p, int q) {
  int i = support.offset[p], j = support.offset[q];
  while (i < support.offset[p + 1] && j < support.offset[q + 1]) {
    if (support.member[i] == support.member[j]) return true;
    ++(support.member[i] < support.member[j] ? i : j);
  }
  return false;
}

// Groups divided into parts whose points are connected through common nodes.
Groups connected(const CompressedRows& support, const Groups& groups) {
  std::vector<Groups> parts(groups.size());
  tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t g) {
    stop_if_requested();
    std::vector<int> left = groups[g];
    while (!left.empty()) {
      std::vector<int>& part = parts[g].emplace_back();
      part.push_back(left.front());
      left.erase(left.begin());
      for (std::size_t k = 0; k < part.size() && !left.empty(); ++k) {
        const auto remaining = std::stable_partition(
            left.begin(), left.end(), [&](int q) { return !have_common_node(support, part[k], q); });
        part.insert(part.end(), remaining, left.end());
        left.erase(remaining, left.end());
      }
    }
  });
  Groups result;
  for (Groups& list : parts) std::move(list.begin(), list.end(), std::back_inserter(result));
  return result;
}

Patches patches_of(const PointPlaces& places, const std::vector<int>& points, Index count, double worth,
                   const CompressedRows* support) {
  Groups groups = split(places, points, count);
  const auto whole = static_cast<double>(groups.size());
  Patches result;
  const auto centroids = [&] {
    result.centre.resize(3, static_cast<Index>(groups.size()));
    result.radius.resize(static_cast<Index>(groups.size()));
    tbb::parallel_for(std::size_t{0}, groups.size(), [&](std::size_t b) {
      Vec3 sum = Vec3::Zero();
      double total = 0.0, h = 0.0;
      for (const int q : groups[b]) {
        sum += places.worth[q] * places.x.col(q);
        h += places.worth[q] * places.h[q];
        total += places.worth[q];
      }
      result.centre.col(static_cast<Index>(b)) = sum / total;
      result.radius[static_cast<Index>(b)] = reach * std::cbrt(worth / whole) * h / total;
    });
  };
  centroids();
  std::vector<int> owner(static_cast<std::size_t>(places.x.cols()));
  for (int sweep = 0; sweep < lloyd_sweeps; ++sweep) {
    const Neighbours tree(result.centre);
    for (std::size_t b = 0; b < groups.size(); ++b)
      for (const int q : groups[b]) owner[static_cast<std::size_t>(q)] = static_cast<int>(b);
    tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t k) {
      if (k % 256 == 0) stop_if_requested();
      const Vec3 x = places.x.col(points[k]);
      const auto distance = [&](int b) { return (x - result.centre.col(b)).norm(); };
      int& mine = owner[static_cast<std::size_t>(points[k])];
      // None is nearer than those as near as the last owner: usually one or two.
      thread_local std::vector<int> near;
      tree.within_unordered(x, distance(mine) * (1.0 + 2e-6), near);
      if (near.empty() || near.size() > 4) near = tree.nearest(x, 4);
      std::pair<double, int> first{distance(near.front()), near.front()};
      for (const int b : near) first = std::min(first, std::pair{distance(b), b});
      mine = first.second;
      for (const int b : near)  // among equally near ones within rounding, the first
        if (distance(b) < (1.0 + 1e-6) * first.first) mine = std::min(mine, b);
    });
    for (auto& group : groups) group.clear();
    for (const int q : points)
      groups[static_cast<std::size_t>(owner[static_cast<std::size_t>(q)])].push_back(q);
    std::erase_if(groups, [](const auto& group) { return group.empty(); });
    centroids();
  }
  if (!support) return result;
  groups = connected(*support, groups);
  centroids();
  for (std::size_t b = 0; b < groups.size(); ++b)
    result.middle.push_back(*std::min_element(groups[b].begin(), groups[b].end(), [&](int p, int q) {
      const auto away = [&](int k) {
        return (places.x.col(k) - result.centre.col(static_cast<Index>(b))).norm();
      };
      return away(p) < away(q) * (1.0 - 1e-9);
    }));
  return result;
}

using Fraction = std::vector<std::pair<int, double>>;  // patches that a point belongs to, with weights

PointPlaces places_of(const Model& model) {
  const Index count = model.point_count();
  PointPlaces places;
  places.x = model.axes.transpose() * model.point;
  places.h.resize(count);
  places.worth.resize(count);
  tbb::parallel_for(Index{0}, count, [&](Index q) {
    double sum = 0.0;
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
      sum += model.spacing[model.support.member[k]];
    places.h[q] = sum / static_cast<double>(model.support.count(q));
    places.worth[q] = model.volume[q] / std::pow(places.h[q], 3);
  });
  places.largest_h = places.h.maxCoeff();
  return places;
}

// The patches of one tissue, with a search tree.
struct Nearby {
  const Patches& patches;
  Neighbours tree{patches.centre};
  double largest_radius = patches.radius.maxCoeff();
};

// Weights of the patches at point q, numbered from `first` on. `folded`: only of those with common nodes.
Fraction fraction_of(const Model& model, const PointPlaces& places, const Nearby& nearby, int q, int first,
                     bool folded) {
  const auto& [patches, tree, largest_radius] = nearby;
  const int most = static_cast<int>(std::min<Index>(40, patches.centre.cols())), few = std::min(most, 20);
  // Half of them usually reach far enough, except where the nodes are finer than elsewhere.
  const bool fine = places.h[q] < coarse * places.largest_h;
  std::vector<int> near = tree.nearest(places.x.col(q), fine ? most : few);
  if (!fine && (places.x.col(q) - patches.centre.col(near.back())).norm() < largest_radius)
    near = tree.nearest(places.x.col(q), most);
  Fraction list;
  // A point in a far corner may be out of reach: radii grow until two patches, or the only one, are met.
  const std::size_t enough = std::min<std::size_t>(2, near.size());
  double sum = 0.0;
  for (double grown = 1.0; list.size() < enough; grown *= 1.1) {
    if (grown > largest_growth)
      throw ModelError(
          {.fact = fmt::format("integration point {} is out of reach of all pressure patches", q),
           .where = "pressure patches",
           .why = fmt::format("it is more than {:.0f} times their radius away", largest_growth),
           .remedy = "use more nodes (--nodes) or a smaller --spacing"});
    if (grown > 1.0 && static_cast<int>(near.size()) < most) near = tree.nearest(places.x.col(q), most);
    list.clear();
    sum = 0.0;
    for (const int b : near) {
      const double s = (places.x.col(q) - patches.centre.col(b)).norm() / (grown * patches.radius[b]);
      if (s >= 1.0) continue;
      if (folded && grown < far_corner &&
          !have_common_node(model.support, q, patches.middle[static_cast<std::size_t>(b)]))
        continue;
      const double w = 1.0 + s * s * (-6.0 + s * (8.0 - 3.0 * s));
      if (w <= 0.0) continue;
      list.push_back({first + b, w});
      sum += w;
    }
  }
  for (auto& [b, w] : list) w /= sum;
  std::sort(list.begin(), list.end());
  return list;
}

// `patches`: their number.
PressurePatches in_rows(const std::vector<Fraction>& fraction, const Eigen::VectorXd& volume, Index patches) {
  const auto count = static_cast<Index>(fraction.size());
  PressurePatches result;
  result.of_point.offset.resize(count + 1);
  result.of_point.offset[0] = 0;
  for (Index q = 0; q < count; ++q)
    result.of_point.offset[q + 1] =
        result.of_point.offset[q] + static_cast<int>(fraction[static_cast<std::size_t>(q)].size());
  result.of_point.member.resize(result.of_point.offset[count]);
  result.psi.resize(result.of_point.offset[count]);
  result.volume = Eigen::VectorXd::Zero(patches);
  for (Index q = 0; q < count; ++q) {
    int at = result.of_point.offset[q];
    for (const auto& [b, psi] : fraction[static_cast<std::size_t>(q)]) {
      result.of_point.member[at] = b;
      result.psi[at++] = psi;
      result.volume[b] += psi * volume[q];
    }
  }
  return result;
}

struct PartOfPatch {
  std::vector<int> points;  // ascending
  double volume = 0.0;      // sum of psi V
  int patch = -1;           // its number after the cut
};

double psi_of(const Fraction& fraction, int patch) {
  const auto at = std::lower_bound(fraction.begin(), fraction.end(), std::pair{patch, 0.0});
  return at->second;
}

// Parts of a patch whose points are connected through common nodes, the largest first.
std::vector<PartOfPatch> parts_of(const Model& model, const std::vector<Fraction>& fraction, int patch,
                                  const std::vector<int>& points) {
  // Union-find: each point, and each node by its first point, leads to an earlier point of its part.
  std::vector<int> first(points.size());
  std::iota(first.begin(), first.end(), 0);
  const auto root = [&](int k) {
    while (first[static_cast<std::size_t>(k)] != k) k = first[static_cast<std::size_t>(k)];
    return k;
  };
  thread_local std::vector<int> met;  // all negative between calls
  met.resize(std::max(met.size(), static_cast<std::size_t>(model.node_count())), -1);
  std::vector<int> nodes;
  for (int k = 0; k < static_cast<int>(points.size()); ++k)
    for (int at = model.support.offset[points[static_cast<std::size_t>(k)]];
         at < model.support.offset[points[static_cast<std::size_t>(k)] + 1]; ++at) {
      int& first_met = met[static_cast<std::size_t>(model.support.member[at])];
      if (first_met < 0) first_met = k, nodes.push_back(model.support.member[at]);
      const int a = root(first_met), b = root(k);
      first[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
    }
  for (const int a : nodes) met[static_cast<std::size_t>(a)] = -1;
  std::map<int, PartOfPatch> of_root;
  for (int k = 0; k < static_cast<int>(points.size()); ++k) {
    const int q = points[static_cast<std::size_t>(k)];
    PartOfPatch& part = of_root[root(k)];
    part.points.push_back(q);
    part.volume += psi_of(fraction[static_cast<std::size_t>(q)], patch) * model.volume[q];
  }
  std::vector<PartOfPatch> parts;
  for (auto& [k, part] : of_root) parts.push_back(std::move(part));
  std::stable_sort(parts.begin(), parts.end(),
                   [](const PartOfPatch& a, const PartOfPatch& b) { return a.volume > b.volume; });
  return parts;
}

// Weights of the patches at each point, where q is a part of point whole[q]; and each patch's points.
std::vector<Fraction> fractions_of(const PressurePatches& patches, const std::vector<Index>& whole,
                                   std::vector<std::vector<int>>& of_patch) {
  std::vector<Fraction> fraction(whole.size());
  of_patch.resize(static_cast<std::size_t>(patches.count()));
  for (std::size_t q = 0; q < whole.size(); ++q) {
    const int first = patches.of_point.offset[whole[q]], last = patches.of_point.offset[whole[q] + 1];
    fraction[q].reserve(static_cast<std::size_t>(last - first));
    for (int k = first; k < last; ++k) {
      fraction[q].push_back({patches.of_point.member[k], patches.psi[k]});
      of_patch[static_cast<std::size_t>(patches.of_point.member[k])].push_back(static_cast<int>(q));
    }
  }
  return fraction;
}

constexpr double least_part = 0.25;  // of a patch of seven nodes: less than two
constexpr int none = -1;             // no patch

}  // namespace

std::vector<Index> divide_patches(Model& model, const std::vector<Index>& whole,
                                  const std::vector<Index>& changed) {
  const PressurePatches& before = model.patches;
  std::vector<std::vector<int>> of_patch;
  const std::vector<Fraction> fraction = fractions_of(before, whole, of_patch);
  std::vector<char> visited(of_patch.size(), 0);
  for (const Index q : changed)
    for (const auto& [b, psi] : fraction[static_cast<std::size_t>(q)])
      visited[static_cast<std::size_t>(b)] = 1;
  std::vector<std::vector<PartOfPatch>> parts(of_patch.size());
  tbb::parallel_for(std::size_t{0}, of_patch.size(), [&](std::size_t b) {
    if (visited[b]) parts[b] = parts_of(model, fraction, static_cast<int>(b), of_patch[b]);
  });

  std::vector<Index> from(of_patch.size());
  std::iota(from.begin(), from.end(), Index{0});
  std::vector<Fraction> now = fraction;
  const auto rename = [&](PartOfPatch& part, int b, int patch) {
    part.patch = patch;
    for (const int q : part.points) {
      const auto k = static_cast<std::size_t>(q);
      const auto at = std::lower_bound(fraction[k].begin(), fraction[k].end(), std::pair{b, 0.0});
      now[k][static_cast<std::size_t>(at - fraction[k].begin())].first = patch;
    }
  };
  const auto make_own = [&](PartOfPatch& part, int b) {
    rename(part, b, static_cast<int>(from.size()));
    from.push_back(b);
  };
  const auto each_small = [&](const auto& act) {
    for (std::size_t b = 0; b < parts.size(); ++b)
      for (std::size_t k = 1; k < parts[b].size(); ++k)
        if (parts[b][k].volume < least_part * before.volume[static_cast<Index>(b)])
          act(parts[b][k], static_cast<int>(b));
  };
  for (std::size_t b = 0; b < parts.size(); ++b)
    for (std::size_t k = 1; k < parts[b].size(); ++k)
      if (parts[b][k].volume >= least_part * before.volume[static_cast<Index>(b)])
        make_own(parts[b][k], static_cast<int>(b));
  each_small([&](PartOfPatch& part, int b) { rename(part, b, none); });
  // A small part remains a patch where no other patch is.
  each_small([&](PartOfPatch& part, int b) {
    if (std::any_of(part.points.begin(), part.points.end(), [&](int q) {
          const Fraction& its = now[static_cast<std::size_t>(q)];
          return std::all_of(its.begin(), its.end(), [](const auto& one) { return one.first == none; });
        }))
      make_own(part, b);
  });
  for (Fraction& list : now) {
    const bool lost = std::erase_if(list, [](const auto& one) { return one.first == none; }) > 0;
    double sum = 0.0;
    for (const auto& one : list) sum += one.second;
    if (lost)
      for (auto& one : list) one.second /= sum;
    std::sort(list.begin(), list.end());
  }
  model.patches = in_rows(now, model.volume, static_cast<Index>(from.size()));
  return from;
}

void make_pressure_patches(Model& model, bool folded, double nodes_per_patch) {
  const Index count = model.point_count();
  const PointPlaces places = places_of(model);
  const double nodes_per_worth = static_cast<double>(model.node_count()) / places.worth.sum();

  std::map<int, std::vector<int>> of_tissue;
  for (Index q = 0; q < count; ++q) of_tissue[model.tissue[q]].push_back(static_cast<int>(q));
  std::vector<Fraction> fraction(static_cast<std::size_t>(count));
  Index first = 0;
  for (const auto& tissue : of_tissue) {
    const std::vector<int>& points = tissue.second;
    double worth = 0.0;
    for (const int q : points) worth += places.worth[q];
    const Index requested = std::max<Index>(1, std::lround(worth * nodes_per_worth / nodes_per_patch));
    const Patches patches = patches_of(places, points, requested, worth, folded ? &model.support : nullptr);
    const Nearby nearby{patches};
    tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t k) {
      const int q = points[k];
      if (k % 256 == 0) stop_if_requested();
      fraction[static_cast<std::size_t>(q)] =
          fraction_of(model, places, nearby, q, static_cast<int>(first), folded);
    });
    first += patches.centre.cols();
  }
  model.patches = in_rows(fraction, model.volume, first);
}

}  // namespace dimple
