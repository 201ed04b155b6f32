#include "preprocess/circle_place.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "io/stop.hpp"
#include "preprocess/neighbours.hpp"

namespace dimple {
namespace {

using Vec2 = Eigen::Vector2d;

constexpr double sought = 2.3;           // radii: a little beyond the room that is wanted
constexpr double steepest = 1.7320508;   // tan 60 degrees
constexpr double sharpest = 0.70710678;  // cos 45 degrees: how far a normal may turn within half a radius
constexpr double whole_disc = 1.1;       // radii: the disc and a little more
constexpr double nearly_most = 0.9;      // of the most room: places with so much are as good
constexpr double same_height = 0.0025;   // of the height
constexpr double thick_enough = 0.5;     // of the median thickness
constexpr double most_places = 60000.0;  // of the lattice over the whole body
constexpr int most_domes = 8;            // that are looked at closely
constexpr double infinite = std::numeric_limits<double>::infinity();

// Where a height map is cut.
struct Cuts {
  std::vector<Vec3> missing, fold, crease;  // (u, v, 0)
  double crease_reach = 0.0;                // a crease shows this far to either side of it
};

Cuts find_cuts(const HeightMap& map, double radius) {
  const auto steps = [&](double length) {
    return std::max<Index>(1, std::lround(length / map.step));
  };
  const Index rows = map.height.rows(), columns = map.height.cols(), slope = steps(radius / 10.0),
              aside = steps(radius / 4.0);
  const double drop = std::max(radius, 3.0 * map.step);
  const auto height = [&](Index i, Index j) {
    return i < 0 || j < 0 || i >= rows || j >= columns ? std::nan("") : map.height(i, j);
  };
  // Rise per length, from both sides where there are two.
  const auto rise = [&](Index i, Index j, Index di, Index dj) {
    const double before = height(i - di * slope, j - dj * slope), after = height(i + di * slope, j + dj * slope),
                 here = height(i, j), length = static_cast<double>(slope) * map.step;
    if (std::isfinite(before) && std::isfinite(after)) return (after - before) / (2.0 * length);
    if (std::isfinite(after)) return (after - here) / length;
    if (std::isfinite(before)) return (here - before) / length;
    return 0.0;
  };
  Eigen::ArrayXXd gu(rows, columns), gv(rows, columns);
  tbb::parallel_for(Index{0}, columns, [&](Index j) {
    for (Index i = 0; i < rows; ++i) {
      gu(i, j) = rise(i, j, 1, 0);
      gv(i, j) = rise(i, j, 0, 1);
    }
  });
  enum Kind : char { clear, missing, fold, crease };
  std::vector<Kind> kind(static_cast<std::size_t>(rows * columns), clear);
  tbb::parallel_for(Index{0}, columns, [&](Index j) {
    for (Index i = 0; i < rows; ++i) {
      Kind& k = kind[static_cast<std::size_t>(i + rows * j)];
      const double here = map.height(i, j);
      if (!std::isfinite(here)) {
        k = missing;
        continue;
      }
      const bool drops = std::abs(height(i + 1, j) - here) > drop || std::abs(height(i, j + 1) - here) > drop ||
                         std::abs(height(i - 1, j) - here) > drop || std::abs(height(i, j - 1) - here) > drop;
      if (drops)
        k = missing;
      else if (std::hypot(gu(i, j), gv(i, j)) > steepest)
        k = fold;
      else
        for (const auto& [di, dj] : {std::pair<Index, Index>{1, 0}, {0, 1}, {1, 1}, {1, -1}}) {
          const Index a = di && dj ? steps(radius / 4.0 / std::numbers::sqrt2) : aside;
          const Index i0 = i - a * di, j0 = j - a * dj, i1 = i + a * di, j1 = j + a * dj;
          if (!std::isfinite(height(i0, j0)) || !std::isfinite(height(i1, j1))) continue;
          const Vec3 n0 = Vec3(gu(i0, j0), gv(i0, j0), -1.0).normalized(),
                     n1 = Vec3(gu(i1, j1), gv(i1, j1), -1.0).normalized();
          if (n0.dot(n1) < sharpest) k = crease;
        }
    }
  });
  Cuts cuts;
  cuts.crease_reach = static_cast<double>(aside) * map.step;
  for (Index j = 0; j < columns; ++j)
    for (Index i = 0; i < rows; ++i) {
      const Vec2 p = map.place(i, j);
      const Vec3 x(p.x(), p.y(), 0.0);
      switch (kind[static_cast<std::size_t>(i + rows * j)]) {
        case clear:
          break;
        case missing:
          cuts.missing.push_back(x);
          break;
        case fold:
          cuts.fold.push_back(x);
          break;
        case crease:
          cuts.crease.push_back(x);
          break;
      }
    }
  return cuts;
}

Points as_points(const std::vector<Vec3>& places) {
  Points result(3, static_cast<Index>(places.size()));
  for (std::size_t k = 0; k < places.size(); ++k) result.col(static_cast<Index>(k)) = places[k];
  return result;
}

// How far it is to the cuts of a map.
class Distances {
 public:
  Distances(const HeightMap& map, double radius) : Distances(find_cuts(map, radius), radius) {}
  Room at(const Vec2& p) const {
    const Vec3 x(p.x(), p.y(), 0.0);
    const auto distance = [&](const std::optional<Neighbours>& tree) {
      return tree ? tree->distance_to_nearest(x) : infinite;
    };
    Room room{.whole = distance(missing_), .even = 0.0, .sought = limit_};
    room.even = std::min({room.whole, distance(fold_), distance(crease_) + crease_reach_, limit_});
    return room;
  }

 private:
  Distances(const Cuts& cuts, double radius) : crease_reach_(cuts.crease_reach), limit_(sought * radius) {
    if (!cuts.missing.empty()) missing_.emplace(as_points(cuts.missing));
    if (!cuts.fold.empty()) fold_.emplace(as_points(cuts.fold));
    if (!cuts.crease.empty()) crease_.emplace(as_points(cuts.crease));
  }
  std::optional<Neighbours> missing_, fold_, crease_;
  double crease_reach_ = 0.0, limit_ = 0.0;
};

HeightMap map_around(const View& view, const Vec2& centre, double half, double step) {
  const auto n = static_cast<Index>(std::ceil(half / step));
  return height_map(view, centre - Vec2::Constant(step * static_cast<double>(n)), step, 2 * n + 1, 2 * n + 1);
}

// Mean height over the disc; not a number where a part of it misses the body.
double mean_height(const HeightMap& map, const Vec2& centre, double radius) {
  constexpr int rings = 6, sectors = 16;
  double sum = 0.0;
  for (int ring = 0; ring < rings; ++ring) {
    const double r = radius * std::sqrt((ring + 0.5) / rings);
    for (int sector = 0; sector < sectors; ++sector) {
      const double angle = 2.0 * std::numbers::pi * (sector + 0.5 * (ring % 2)) / sectors;
      sum += map.between(centre + r * Vec2(std::cos(angle), std::sin(angle)));
    }
  }
  return sum / (rings * sectors);
}

// Mean heights over discs about every place of the map, by sums along its columns.
Eigen::ArrayXXd mean_heights(const HeightMap& map, double radius) {
  const Index rows = map.height.rows(), columns = map.height.cols(),
              reach = static_cast<Index>(std::floor(radius / map.step + 1e-9));
  Eigen::ArrayXXd sum = Eigen::ArrayXXd::Zero(rows + 1, columns);
  for (Index j = 0; j < columns; ++j)
    for (Index i = 0; i < rows; ++i)
      sum(i + 1, j) = sum(i, j) + (std::isfinite(map.height(i, j)) ? map.height(i, j) : 0.0);
  Eigen::ArrayXXd mean(rows, columns);
  tbb::parallel_for(Index{0}, columns, [&](Index j) {
    stop_if_asked();
    for (Index i = 0; i < rows; ++i) {
      double total = 0.0, count = 0.0;
      for (Index dj = -reach; dj <= reach; ++dj) {
        if (j + dj < 0 || j + dj >= columns) continue;
        const auto half = static_cast<Index>(
            std::sqrt(std::max(0.0, std::pow(radius / map.step, 2) - static_cast<double>(dj * dj)) + 1e-9));
        const Index first = std::max<Index>(0, i - half), last = std::min(rows - 1, i + half);
        total += sum(last + 1, j + dj) - sum(first, j + dj);
        count += static_cast<double>(last + 1 - first);
      }
      mean(i, j) = total / count;
    }
  });
  return mean;
}

// The rule's weighing of places: high, near the middle, and with the room that is asked for.
struct Rule {
  Vec2 middle;
  double bend;      // a plateau counts as bent by 1 / this, so that its middle is its highest place [mm]
  double radius, required;
  std::optional<Vec2> side;

  double worth(double mean, const Vec2& p) const {
    return mean - (p - middle).squaredNorm() / (2.0 * bend);
  }
  bool allowed(const Vec2& p) const { return !side || (p - middle).dot(*side) > 0.0; }
  // A place without its room is worth less the more it lacks: more than any slope could win.
  double worth(const HeightMap& map, const Distances& distances, const Vec2& p) const {
    if (!allowed(p)) return -infinite;
    const Room room = distances.at(p);
    const double mean = mean_height(map, p, radius);
    if (room.whole < whole_disc * radius || !std::isfinite(mean)) return -infinite;
    return worth(mean, p) - 4.0 * std::max(0.0, required - room.even);
  }
};

struct Dome {
  Vec2 centre;
  double worth, room;
};

// The best place near one that was found on a lattice of `step`.
Dome look_closely(const View& view, const Rule& rule, Vec2 centre, double step) {
  const double fine = rule.radius / 12.0;
  Dome best{centre, -infinite, 0.0};
  while (true) {
    const double around = 1.5 * step;
    if (step > fine) step = std::max(fine, step / 4.0);
    const HeightMap map = map_around(view, centre, around + (sought + 0.2) * rule.radius, step);
    const Distances distances(map, rule.radius);
    best.worth = -infinite;
    const auto n = static_cast<Index>(std::ceil(around / step));
    const auto consider = [&](const Vec2& p) {
      const double worth = rule.worth(map, distances, p);
      if (!(worth > best.worth)) return false;
      best = {p, worth, distances.at(p).even};
      return true;
    };
    for (Index j = -n; j <= n; ++j)
      for (Index i = -n; i <= n; ++i)
        consider(centre + step * Vec2(static_cast<double>(i), static_cast<double>(j)));
    if (best.worth == -infinite) return best;
    centre = best.centre;
    if (step > fine * (1.0 + 1e-9)) continue;
    for (double stride = 0.5 * step; stride > rule.radius / 1000.0; stride *= 0.5)
      for (int moves = 0; moves < 32; ++moves) {
        const Vec2 from = best.centre;
        bool moved = false;
        for (int way = 0; way < 16; ++way) {
          const double angle = std::numbers::pi * way / 8.0;
          moved = consider(from + stride * Vec2(std::cos(angle), std::sin(angle))) || moved;
        }
        if (!moved) break;
      }
    return best;
  }
}

}  // namespace

Room room_around(const View& view, const Vec2& centre, double radius) {
  return Distances(map_around(view, centre, (sought + 0.2) * radius, radius / 12.0), radius).at(centre);
}

std::optional<CirclePlace> highest_dome(const View& view, double radius, double height,
                                        const std::optional<Vec2>& side, const Vec3& prefer) {
  const Moments moments = moments_of(*view.body);
  const Vec2 extent = view.high - view.low;
  const double step = std::max(std::min(radius / 6.0, extent.maxCoeff() / 150.0),
                               std::sqrt(extent.prod() / most_places));
  const HeightMap map = height_map(view, step);
  const Distances distances(map, radius);
  Rule rule{.middle = view.flat(view.body->centroid()),
            .bend = 10.0 * moments.size,
            .radius = radius,
            .required = 0.0,
            .side = side};

  std::vector<double> thicknesses;
  for (Index k = 0; k < map.thickness.size(); ++k)
    if (std::isfinite(map.thickness.data()[k])) thicknesses.push_back(map.thickness.data()[k]);
  if (thicknesses.empty()) return std::nullopt;
  std::nth_element(thicknesses.begin(), thicknesses.begin() + static_cast<std::ptrdiff_t>(thicknesses.size() / 2),
                   thicknesses.end());
  const double thin = thick_enough * thicknesses[thicknesses.size() / 2];

  struct Place {
    Vec2 at;
    double worth, room;
  };
  std::vector<std::vector<Place>> found(static_cast<std::size_t>(map.height.cols()));
  const Eigen::ArrayXXd mean = mean_heights(map, radius);
  tbb::parallel_for(Index{0}, map.height.cols(), [&](Index j) {
    stop_if_asked();
    for (Index i = 0; i < map.height.rows(); ++i) {
      const Vec2 p = map.place(i, j);
      if (!(map.thickness(i, j) > thin) || !rule.allowed(p)) continue;
      const Room room = distances.at(p);
      if (room.whole < whole_disc * radius) continue;
      found[static_cast<std::size_t>(j)].push_back({p, rule.worth(mean(i, j), p), room.even});
    }
  });
  std::vector<Place> places;
  for (const auto& column : found) places.insert(places.end(), column.begin(), column.end());
  if (places.empty()) return std::nullopt;
  const double most = std::max_element(places.begin(), places.end(), [](const Place& a, const Place& b) {
                        return a.room < b.room;
                      })->room;
  rule.required = std::min(wanted_room * radius, nearly_most * most);

  // One place for each dome, the highest first; what the lattice's step may hide is not yet decided.
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.worth > b.worth; });
  const double apart = std::max(2.0 * radius, 0.25 * moments.size), slack = 0.01 * height + 2.0 * step;
  std::vector<Dome> domes;
  std::vector<Vec2> begun;
  double highest = -infinite;
  for (const Place& place : places) {
    if (static_cast<int>(begun.size()) == most_domes || place.worth < highest - slack) break;
    if (place.room < rule.required - 0.5 * step) continue;
    if (std::any_of(begun.begin(), begun.end(), [&](const Vec2& b) { return (b - place.at).norm() < apart; }))
      continue;
    if (begun.empty()) highest = place.worth;
    begun.push_back(place.at);
    const Dome dome = look_closely(view, rule, place.at, step);
    if (dome.worth > -infinite) domes.push_back(dome);
  }
  if (domes.empty()) return std::nullopt;
  const double top = std::max_element(domes.begin(), domes.end(), [](const Dome& a, const Dome& b) {
                       return a.worth < b.worth;
                     })->worth;

  // Equal domes: the body's own lopsidedness decides before anything outside of it does.
  const Vec2 heavier = -view.flat(moments.third) / std::pow(moments.size, 3), beside = view.flat(prefer);
  const Dome* chosen = nullptr;
  int equals = 0;
  for (const Dome& dome : domes) {
    if (dome.worth < top - same_height * height) continue;
    ++equals;
    if (!chosen) {
      chosen = &dome;
      continue;
    }
    const Vec2 way = (dome.centre - chosen->centre).normalized();
    const double own = way.dot(heavier);
    if (std::abs(own) > 0.01 ? own > 0.0 : way.dot(beside) > 0.0) chosen = &dome;
  }
  // A hundredth of a radius is more than the surface knows: places that differ by rounding become one.
  const double grid = radius / 100.0;
  const Vec2 centre = (chosen->centre / grid).array().round() * grid;
  return CirclePlace{centre, chosen->room, equals};
}

}  // namespace dimple
