#include "preprocess/scene/patch_place.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "io/stop.hpp"

namespace dimple {
namespace {

using Vec2 = Eigen::Vector2d;

constexpr double finest = 1.0 / 12.0;  // radii: step of a lattice
constexpr double price_of_room = 4.0;  // radii of height per radius of missing room, squared
// Price of a distance from the middle of the body. Slopes below five degrees, such as the voxels' ripples,
// decide nothing: the middle of a plateau is chosen, along the body's longest and shortest directions.
constexpr double level = 0.08;
constexpr double same_height = 0.0025;  // of the height
constexpr double thick_enough = 0.5;    // of the median thickness
// Fraction of the median thickness below which tissue that is free behind bends: vessels of a heart have 0.45
// to 0.5, the crown of a shell has 0.6.
constexpr double slender = 0.55;
constexpr double most_bending = 0.25;         // of the disc, over such tissue
constexpr double much_lower = 0.15;           // of the height: no room is worth more
constexpr double most_places = 400000.0;      // of the lattice over the whole body
constexpr std::size_t places_at_once = 4096;  // judged before the search checks if others can be better
constexpr int most_domes = 8;                 // examined closely
constexpr double infinite = std::numeric_limits<double>::infinity();

// Height map without the places where the image ends, which are no surface of the organ.
HeightMap without_image_ends(const View& view, HeightMap map) {
  for (Index j = 0; j < map.height.cols(); ++j)
    for (Index i = 0; i < map.height.rows(); ++i)
      if (std::isfinite(map.height(i, j)) &&
          view.body->at_image_end(view.at(map.place(i, j), map.height(i, j))))
        map.height(i, j) = map.thickness(i, j) = std::nan("");
  return map;
}

HeightMap map_around(const View& view, const Vec2& centre, double half, double step, bool with_image_ends) {
  const auto n = static_cast<Index>(std::ceil(half / step));
  HeightMap map =
      height_map(view, centre - Vec2::Constant(step * static_cast<double>(n)), step, 2 * n + 1, 2 * n + 1);
  return with_image_ends || view.body->image_ends().empty() ? map : without_image_ends(view, std::move(map));
}

double step_of_whole(const View& view, double radius) {
  return std::max(radius * finest, std::sqrt(Vec2(view.high - view.low).prod() / most_places));
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

// Means over discs about every place of a map with this step, by sums along its columns.
Eigen::ArrayXXd means_over_discs(const Eigen::ArrayXXd& of, double step, double radius) {
  const Index rows = of.rows(), columns = of.cols(),
              reach = static_cast<Index>(std::floor(radius / step + 1e-9));
  Eigen::ArrayXXd sum = Eigen::ArrayXXd::Zero(rows + 1, columns);
  for (Index j = 0; j < columns; ++j)
    for (Index i = 0; i < rows; ++i) sum(i + 1, j) = sum(i, j) + (std::isfinite(of(i, j)) ? of(i, j) : 0.0);
  Eigen::ArrayXXd mean(rows, columns);
  tbb::parallel_for(Index{0}, columns, [&](Index j) {
    stop_if_requested();
    for (Index i = 0; i < rows; ++i) {
      double total = 0.0, count = 0.0;
      for (Index dj = -reach; dj <= reach; ++dj) {
        if (j + dj < 0 || j + dj >= columns) continue;
        const auto half = static_cast<Index>(
            std::sqrt(std::max(0.0, std::pow(radius / step, 2) - static_cast<double>(dj * dj)) + 1e-9));
        const Index first = std::max<Index>(0, i - half), last = std::min(rows - 1, i + half);
        total += sum(last + 1, j + dj) - sum(first, j + dj);
        count += static_cast<double>(last + 1 - first);
      }
      mean(i, j) = total / count;
    }
  });
  return mean;
}

// Value of places: high, near the middle, and with the requested room.
struct Rule {
  Vec2 middle;
  double radius;
  std::optional<Vec2> half;
  std::function<bool(const Vec3&)> is_free;
  // Places that are used only if there is nothing better.
  bool with_little_room, with_thin_and_free, with_image_ends;
  bool just_fits = false;  // no surface is requested beyond the disc itself

  // Value of a place [mm]; the price of missing room exceeds any height in the end.
  double worth(double mean, const Vec2& p, double room) const {
    return mean - level * (p - middle).lpNorm<1>() - price(room);
  }
  double price(double room) const {
    const double lack = std::max(0.0, preferred_room - room / radius);
    return price_of_room * lack * lack * radius;
  }
  double thin = 0.0;  // thinner tissue bends where it is free [mm]
  bool has_room(const Room& room, double slack) const {
    return room.whole >= (just_fits ? radius : SurfaceCuts::whole_disc * radius + slack) &&
           (with_little_room || room.even >= little_room * radius);
  }
  bool allowed(const Vec2& p) const { return !half || (p - middle).dot(*half) > 0.0; }
};

struct Dome {
  Vec2 centre = Vec2::Zero();
  double worth = -infinite, room = 0.0, mean = 0.0;
};

struct Chosen {
  PatchPlace place;
  double mean;  // height over the disc [mm]
};

// 1 where tissue thinner than `thin` is free behind, and else 0.
Eigen::ArrayXXd thin_and_free(const View& view, const HeightMap& map, double thin,
                              const std::function<bool(const Vec3&)>& is_free) {
  Eigen::ArrayXXd result = Eigen::ArrayXXd::Zero(map.height.rows(), map.height.cols());
  for (Index j = 0; j < map.height.cols(); ++j)
    for (Index i = 0; i < map.height.rows(); ++i)
      if (map.thickness(i, j) < thin &&
          is_free(view.at(map.place(i, j), map.height(i, j) - map.thickness(i, j))))
        result(i, j) = 1.0;
  return result;
}

// True if more than a quarter of the disc at p is over tissue that is thin and free.
bool bends_at(const HeightMap& map, const Eigen::ArrayXXd& thin, const Rule& rule, const Vec2& p) {
  int met = 0, bending = 0;
  for (const double fraction : {0.0, 0.4, 0.7, 0.95})
    for (int k = 0; k < (fraction > 0.0 ? 12 : 1); ++k) {
      const double angle = std::numbers::pi * k / 6.0;
      const Vec2 x =
          (p + fraction * rule.radius * Vec2(std::cos(angle), std::sin(angle)) - map.corner) / map.step;
      const Index i = std::lround(x.x()), j = std::lround(x.y());
      if (i < 0 || j < 0 || i >= thin.rows() || j >= thin.cols() || !std::isfinite(map.height(i, j)))
        continue;
      ++met;
      bending += thin(i, j) > 0.0;
    }
  return bending > most_bending * met;
}

// Replaces the best dome by the place p if that is better.
bool consider(const HeightMap& map, const Eigen::ArrayXXd& thin, const SurfaceCuts& cuts, const Rule& rule,
              const Vec2& p, Dome& best) {
  if (!rule.allowed(p) || (!rule.with_thin_and_free && bends_at(map, thin, rule, p))) return false;
  const Room room = cuts.at(p);
  const double mean = mean_height(map, p, rule.radius);
  if (!rule.has_room(room, 0.0) || !std::isfinite(mean)) return false;
  const double worth = rule.worth(mean, p, room.even);
  if (!(worth > best.worth)) return false;
  best = {p, worth, room.even, mean};
  return true;
}

// Best place within reach of a centre, by pattern search on maps sampled at `step`.
Dome climb(const View& view, const Rule& rule, Vec2 centre, double step) {
  const double reach = std::max(0.5 * rule.radius, 4.0 * step);
  Dome best;
  for (int round = 0; round < 32; ++round) {
    stop_if_requested();
    const HeightMap map = map_around(view, centre, reach + (SurfaceCuts::sought + 0.2) * rule.radius, step,
                                     rule.with_image_ends);
    const SurfaceCuts cuts(map, rule.radius);
    const Eigen::ArrayXXd thin = thin_and_free(view, map, rule.thin, rule.is_free);
    best = {};
    if (!consider(map, thin, cuts, rule, centre, best)) return best;
    for (double stride = step; stride > rule.radius / 1000.0; stride *= 0.5)
      for (int moves = 0; moves < 32; ++moves) {
        const Vec2 from = best.centre;
        bool moved = false;
        for (int direction = 0; direction < 16; ++direction) {
          const double angle = std::numbers::pi * direction / 8.0;
          const Vec2 p = from + stride * Vec2(std::cos(angle), std::sin(angle));
          if ((p - centre).norm() < reach) moved = consider(map, thin, cuts, rule, p, best) || moved;
        }
        if (!moved) break;
      }
    const double moved = (best.centre - centre).norm();
    centre = best.centre;
    if (moved < reach - step) break;
  }
  return best;
}

// Best place near one that was found on a lattice of `step`: the lattice is refined, then climb().
Dome look_closely(const View& view, const Rule& rule, Vec2 centre, double step) {
  const double fine = rule.radius * finest;
  while (step > fine) {
    const double around = 1.5 * step;
    step = std::max(fine, step / 4.0);
    const HeightMap map = map_around(view, centre, around + (SurfaceCuts::sought + 0.2) * rule.radius, step,
                                     rule.with_image_ends);
    const SurfaceCuts cuts(map, rule.radius);
    const Eigen::ArrayXXd thin = thin_and_free(view, map, rule.thin, rule.is_free);
    Dome best;
    const auto n = static_cast<Index>(std::ceil(around / step));
    for (Index j = -n; j <= n; ++j)
      for (Index i = -n; i <= n; ++i)
        consider(map, thin, cuts, rule, centre + step * Vec2(static_cast<double>(i), static_cast<double>(j)),
                 best);
    if (best.worth == -infinite) return best;
    centre = best.centre;
  }
  return climb(view, rule, centre, step);
}

std::optional<double> median_thickness(const HeightMap& map) {
  std::vector<double> thicknesses;
  for (Index k = 0; k < map.thickness.size(); ++k)
    if (std::isfinite(map.thickness.data()[k])) thicknesses.push_back(map.thickness.data()[k]);
  if (thicknesses.empty()) return std::nullopt;
  std::nth_element(thicknesses.begin(),
                   thicknesses.begin() + static_cast<std::ptrdiff_t>(thicknesses.size() / 2),
                   thicknesses.end());
  return thicknesses[thicknesses.size() / 2];
}

// A place on a map, with an upper bound of its value and its value.
struct Place {
  Vec2 at;
  double most, worth;
};

// Places over thick tissue, sorted by the upper bound of their value.
std::vector<Place> possible_places(const Rule& rule, const View& view, const HeightMap& map, double thin) {
  const double radius = rule.radius;
  std::vector<Place> places;
  const Eigen::ArrayXXd mean = means_over_discs(map.height, map.step, radius),
                        bending = means_over_discs(
                            thin_and_free(view, map, rule.with_thin_and_free ? 0.0 : rule.thin, rule.is_free),
                            map.step, radius);
  for (Index j = 0; j < map.height.cols(); ++j)
    for (Index i = 0; i < map.height.rows(); ++i)
      if (const Vec2 p = map.place(i, j);
          map.thickness(i, j) > thin && rule.allowed(p) && bending(i, j) <= most_bending)
        places.push_back({p, rule.worth(mean(i, j), p, infinite), -infinite});
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.most > b.most; });
  return places;
}

// Evaluates places from the highest bound down until no other can be best; keeps those with room, sorted.
void keep_good_places(const Rule& rule, const SurfaceCuts& cuts, double slack, std::vector<Place>& places) {
  double best = -infinite;
  std::size_t judged = 0;
  while (judged < places.size() && places[judged].most >= best - slack) {
    stop_if_requested();
    const std::size_t end = std::min(judged + places_at_once, places.size());
    tbb::parallel_for(judged, end, [&](std::size_t k) {
      const Room room = cuts.at(places[k].at);
      // Twice the step, so that look_closely() does not refuse what it receives.
      if (rule.has_room(room, 2.0 * cuts.step())) places[k].worth = places[k].most - rule.price(room.even);
    });
    for (; judged < end; ++judged) best = std::max(best, places[judged].worth);
  }
  places.resize(judged);
  std::erase_if(places, [](const Place& place) { return place.worth == -infinite; });
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.worth > b.worth; });
}

// One place for each dome, the highest first, each improved by look_closely().
std::vector<Dome> domes_of(const Rule& rule, const View& view, const std::vector<Place>& places, double apart,
                           double slack, double step) {
  std::vector<Dome> domes;
  std::vector<Vec2> starts;
  double highest = -infinite;
  for (const Place& place : places) {
    if (static_cast<int>(starts.size()) == most_domes || place.worth < highest - slack) break;
    if (std::any_of(starts.begin(), starts.end(),
                    [&](const Vec2& b) { return (b - place.at).norm() < apart; }))
      continue;
    if (starts.empty()) highest = place.worth;
    starts.push_back(place.at);
    const Dome dome = look_closely(view, rule, place.at, step);
    // Two starts may end on the same dome.
    const auto same = std::find_if(domes.begin(), domes.end(),
                                   [&](const Dome& d) { return (d.centre - dome.centre).norm() < apart; });
    if (same == domes.end() && dome.worth > -infinite)
      domes.push_back(dome);
    else if (same != domes.end() && dome.worth > same->worth + 1e-3 * rule.radius)
      *same = dome;
  }
  return domes;
}

// Highest dome; among equally high ones the body's own asymmetry decides, then `prefer`.
std::pair<const Dome*, int> highest_of(const std::vector<Dome>& domes, const View& view,
                                       const Moments& moments, double height, const Vec3& prefer) {
  const double top = std::max_element(domes.begin(), domes.end(), [](const Dome& a, const Dome& b) {
                       return a.worth < b.worth;
                     })->worth;

  const Vec2 heavier = -view.flat(moments.third) / std::pow(moments.size, 3), preferred = view.flat(prefer);
  const Dome* chosen = nullptr;
  int equals = 0;
  for (const Dome& dome : domes) {
    if (dome.worth < top - same_height * height) continue;
    ++equals;
    if (!chosen) {
      chosen = &dome;
      continue;
    }
    const Vec2 direction = (dome.centre - chosen->centre).normalized();
    const double own = direction.dot(heavier);
    if (std::abs(own) > 0.01 ? own > 0.0 : direction.dot(preferred) > 0.0) chosen = &dome;
  }
  return {chosen, equals};
}

std::optional<Chosen> highest_dome_by(Rule rule, const View& view, const Moments& moments, double height,
                                      const Vec3& prefer) {
  const double radius = rule.radius, step = step_of_whole(view, radius);
  HeightMap map = height_map(view, step);
  if (!rule.with_image_ends) map = without_image_ends(view, std::move(map));
  const std::optional<double> thickness = median_thickness(map);
  if (!thickness) return std::nullopt;
  rule.thin = std::min(2.0 * radius * bending_thickness, slender * *thickness);
  const double slack = 0.01 * height + 2.0 * step;
  std::vector<Place> places = possible_places(rule, view, map, thick_enough * *thickness);
  keep_good_places(rule, SurfaceCuts(map, radius), slack, places);
  const std::vector<Dome> domes =
      domes_of(rule, view, places, std::max(2.0 * radius, 0.25 * moments.size), slack, step);
  if (domes.empty()) return std::nullopt;
  const auto [chosen, equals] = highest_of(domes, view, moments, height, prefer);
  // Rounded to a hundredth of a radius, finer than the surface's accuracy: rounding must not move the place.
  const double grid = radius / 100.0;
  const Vec2 centre = (chosen->centre / grid).array().round() * grid;
  return Chosen{{centre, chosen->room, equals}, chosen->mean};
}

}  // namespace

Room room_around(const View& view, const Vec2& centre, double radius) {
  return SurfaceCuts(map_around(view, centre, (SurfaceCuts::sought + 0.2) * radius, radius * finest, true),
                     radius)
      .at(centre);
}

std::optional<PatchPlace> highest_dome(const View& view, const Moments& moments, double radius, double height,
                                       const std::optional<Vec2>& half, const Vec3& prefer,
                                       const std::function<bool(const Vec3& leaves)>& is_free) {
  Rule rule{.middle = view.flat(view.body->centroid()),
            .radius = radius,
            .half = half,
            .is_free = is_free,
            .with_little_room = true,
            .with_thin_and_free = false,
            .with_image_ends = view.body->image_ends().empty()};
  auto found = highest_dome_by(rule, view, moments, height, prefer);
  for (bool* relaxed : {&rule.with_thin_and_free, &rule.with_image_ends, &rule.just_fits}) {
    if (found) break;
    if (*relaxed) continue;
    *relaxed = true;
    found = highest_dome_by(rule, view, moments, height, prefer);
  }
  if (!found) return std::nullopt;
  if (found->place.room >= little_room * radius) return found->place;
  rule.with_little_room = false;
  const auto roomy = highest_dome_by(rule, view, moments, height, prefer);
  return roomy && roomy->mean > found->mean - much_lower * height ? roomy->place : found->place;
}

std::vector<SurveyedPlace> survey(const View& view, double radius, double stride,
                                  const std::function<bool(const Vec3& leaves)>& is_free) {
  const HeightMap map = height_map(view, step_of_whole(view, radius));
  const SurfaceCuts cuts(map, radius);
  const Eigen::ArrayXXd height = means_over_discs(map.height, map.step, radius),
                        bending = means_over_discs(
                            thin_and_free(view, map, 2.0 * radius * bending_thickness, is_free), map.step,
                            radius);
  const auto every = std::max<Index>(1, std::lround(stride / map.step));
  std::vector<SurveyedPlace> places;
  for (Index j = 0; j < map.height.cols(); j += every)
    for (Index i = 0; i < map.height.rows(); i += every)
      if (std::isfinite(map.height(i, j)))
        places.push_back({.centre = map.place(i, j),
                          .contact = view.at(map.place(i, j), map.height(i, j)),
                          .room = {},
                          .mean_height = height(i, j),
                          .bending = bending(i, j)});
  tbb::parallel_for(std::size_t{0}, places.size(), [&](std::size_t k) {
    stop_if_requested();
    places[k].room = cuts.at(places[k].centre);
  });
  return places;
}

}  // namespace dimple
