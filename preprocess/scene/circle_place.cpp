#include "preprocess/scene/circle_place.hpp"

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
constexpr double sought = 2.3;         // radii: a little beyond the room that is wanted
// How much a slope, or a turn of the normal within half a radius, cuts the surface: not at all up to the
// first angle, wholly from the second on. The room ends where the cuts within it, so weighed, make up this
// part of the disc's area: no single voxel ends it, and nothing jumps where a fold is about as steep as a
// limit.
constexpr double gentle_slope = 60.0, steep_slope = 80.0, gentle_turn = 25.0, sharp_turn = 60.0;  // degrees
constexpr double negligible = 0.03;
constexpr double smoothing = 0.25;        // radii: of the heights before they are judged
constexpr Index most_lattice_steps = 10;  // of the lattice of cuts, to a radius
constexpr double whole_disc = 1.05;       // radii: the disc and a little more
constexpr double half_disc = 0.5;         // radii
constexpr double price_of_room = 4.0;     // radii of height for a whole radius of margin
// Slopes less than five degrees, such as the voxels' ripples are, decide nothing: of a plateau its middle is
// taken, along the directions in which the body is longest and shortest.
constexpr double level = 0.08;
constexpr double same_height = 0.0025;  // of the height
constexpr double thick_enough = 0.5;    // of the median thickness
// Of it, where nothing is fixed behind: vessels of a heart have 0.45 to 0.5, the crown of a shell has 0.6.
constexpr double slender = 0.55;
constexpr double most_bending = 0.25;     // of the disc, over such tissue
constexpr double much_lower = 0.15;       // of the height: no room is worth that
constexpr double most_places = 400000.0;  // of the lattice over the whole body
constexpr std::size_t places_at_once =
    4096;                      // that are judged before it is asked whether others can be better
constexpr int most_domes = 8;  // that are looked at closely
constexpr double infinite = std::numeric_limits<double>::infinity();

double degrees(double radians) {
  return radians * 180.0 / std::numbers::pi;
}

// Where a height map is cut, and how far it is to there.
class Cuts {
 public:
  Cuts(const HeightMap& map, double radius);
  Room at(const Vec2& p) const;
  double step() const { return step_; }

 private:
  void grade(const HeightMap& map);
  void count_missing();
  bool any_missing(const Vec2& p, double radii) const;
  std::optional<Room> within(const Vec2& p, double radii) const;
  struct Window {
    Index first[2], last[2];
  };
  Window window(const Vec2& p, double radii) const;
  double radius_;
  Vec2 corner_;
  double step_ = 1.0;
  Eigen::ArrayXXd cut_;             // 0 ... 1
  Eigen::ArrayXXd missing_;         // 0 ... 1
  Eigen::ArrayXXi missing_before_;  // how many places (i, j) with i < row and j < column miss anything
};

Cuts::Cuts(const HeightMap& map, double radius) : radius_(radius), corner_(map.corner), step_(map.step) {
  grade(map);
  // Of a lattice that is finer than the question needs the mean of several places.
  const Index merge = static_cast<Index>(radius / static_cast<double>(most_lattice_steps) / map.step);
  if (merge < 2) {
    count_missing();
    return;
  }
  const auto coarse = [&](const Eigen::ArrayXXd& fine) {
    Eigen::ArrayXXd result((fine.rows() + merge - 1) / merge, (fine.cols() + merge - 1) / merge);
    for (Index j = 0; j < result.cols(); ++j)
      for (Index i = 0; i < result.rows(); ++i)
        result(i, j) = fine.block(i * merge, j * merge, std::min(merge, fine.rows() - i * merge),
                                  std::min(merge, fine.cols() - j * merge))
                           .mean();
    return result;
  };
  cut_ = coarse(cut_);
  missing_ = coarse(missing_);
  corner_ += Vec2::Constant(0.5 * static_cast<double>(merge - 1) * step_);
  step_ *= static_cast<double>(merge);
  count_missing();
}

void Cuts::count_missing() {
  missing_before_ = Eigen::ArrayXXi::Zero(missing_.rows() + 1, missing_.cols() + 1);
  for (Index j = 0; j < missing_.cols(); ++j)
    for (Index i = 0; i < missing_.rows(); ++i)
      missing_before_(i + 1, j + 1) = missing_before_(i + 1, j) + missing_before_(i, j + 1) -
                                      missing_before_(i, j) + (missing_(i, j) > 0.0 ? 1 : 0);
}

// The places of the lattice in a square about p.
Cuts::Window Cuts::window(const Vec2& p, double radii) const {
  const Vec2 middle = (p - corner_) / step_;
  const double reach = radii * radius_ / step_;
  Window result;
  for (const int d : {0, 1}) {
    const Index count = d == 0 ? cut_.rows() : cut_.cols();
    result.first[d] = std::max<Index>(0, static_cast<Index>(std::ceil(middle[d] - reach)));
    result.last[d] = std::min(count - 1, static_cast<Index>(std::floor(middle[d] + reach)));
  }
  return result;
}

bool Cuts::any_missing(const Vec2& p, double radii) const {
  const auto [first, last] = window(p, radii);
  if (first[0] > last[0] || first[1] > last[1]) return false;
  const auto before = [&](Index i, Index j) { return missing_before_(i, j); };
  return before(last[0] + 1, last[1] + 1) - before(first[0], last[1] + 1) - before(last[0] + 1, first[1]) +
             before(first[0], first[1]) >
         0;
}

// Heights without the voxels' ripples: means weighed by a Gaussian, of the places where the body is.
Eigen::ArrayXXd smoothed(const Eigen::ArrayXXd& height, double sigma) {
  if (sigma < 0.5) return height;
  const auto reach = static_cast<Index>(std::ceil(2.5 * sigma));
  Eigen::ArrayXd weight(reach + 1);
  for (Index k = 0; k <= reach; ++k) weight[k] = std::exp(-0.5 * std::pow(static_cast<double>(k) / sigma, 2));
  // Down the columns of an array and of what counts; the transposed result is smoothed once more.
  const auto along = [&](const Eigen::ArrayXXd& from) {
    Eigen::ArrayXXd to = Eigen::ArrayXXd::Zero(from.rows(), from.cols());
    tbb::parallel_for(Index{0}, from.cols(), [&](Index j) {
      stop_if_asked();
      to.col(j) = weight[0] * from.col(j);
      for (Index k = 1; k <= std::min(reach, from.rows() - 1); ++k) {
        const Index n = from.rows() - k;
        to.col(j).head(n) += weight[k] * from.col(j).tail(n);
        to.col(j).tail(n) += weight[k] * from.col(j).head(n);
      }
    });
    return to;
  };
  const auto both = [&](const Eigen::ArrayXXd& from) -> Eigen::ArrayXXd {
    return along(along(from).transpose()).transpose();
  };
  const auto there = height.isFinite();
  return there.select(both(there.select(height, 0.0)) / both(there.cast<double>()), height);
}

void Cuts::grade(const HeightMap& map) {
  const Eigen::ArrayXXd smooth = smoothed(map.height, smoothing * radius_ / map.step);
  const auto steps = [&](double length) { return std::max<Index>(1, std::lround(length / map.step)); };
  const Index rows = map.height.rows(), columns = map.height.cols(), slope = steps(radius_ / 8.0),
              aside = steps(radius_ / 4.0), aslant = steps(radius_ / 4.0 / std::numbers::sqrt2);
  const double drop = std::max(radius_, 3.0 * map.step);
  const auto height = [&](Index i, Index j) {
    return i < 0 || j < 0 || i >= rows || j >= columns ? std::nan("") : smooth(i, j);
  };
  // Rise per length, from both sides where there are two.
  const auto rise = [&](Index i, Index j, Index di, Index dj) {
    const double before = height(i - di * slope, j - dj * slope),
                 after = height(i + di * slope, j + dj * slope), here = height(i, j),
                 length = static_cast<double>(slope) * map.step;
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
  const auto normal = [&](Index i, Index j) { return Vec3(gu(i, j), gv(i, j), -1.0).normalized(); };
  const auto between = [](double angle, double first, double last) {
    return std::clamp((degrees(angle) - first) / (last - first), 0.0, 1.0);
  };
  cut_ = missing_ = Eigen::ArrayXXd::Zero(rows, columns);
  tbb::parallel_for(Index{0}, columns, [&](Index j) {
    stop_if_asked();
    for (Index i = 0; i < rows; ++i) {
      const double here = map.height(i, j);
      bool whole = std::isfinite(here);
      for (const auto& [di, dj] : {std::pair<Index, Index>{1, 0}, {-1, 0}, {0, 1}, {0, -1}})
        if (i + di >= 0 && j + dj >= 0 && i + di < rows && j + dj < columns)
          whole = whole && !(std::abs(map.height(i + di, j + dj) - here) > drop);
      if (!whole) {
        cut_(i, j) = missing_(i, j) = 1.0;
        continue;
      }
      double turn = 1.0;  // cosine
      for (const auto& [di, dj] :
           {std::pair<Index, Index>{aside, 0}, {0, aside}, {aslant, aslant}, {aslant, -aslant}})
        if (std::isfinite(height(i - di, j - dj)) && std::isfinite(height(i + di, j + dj)))
          turn = std::min(turn, normal(i - di, j - dj).dot(normal(i + di, j + dj)));
      cut_(i, j) = std::max(between(std::atan(std::hypot(gu(i, j), gv(i, j))), gentle_slope, steep_slope),
                            between(std::acos(std::max(turn, -1.0)), gentle_turn, sharp_turn));
    }
  });
}

Room Cuts::at(const Vec2& p) const {
  // Where a fold is near, as it is at most places of a brain, no one needs to look farther; and where all of
  // the disc is there, not even as far as its edge.
  if (const double nearer = std::max(0.5 * sought, whole_disc + 2.0 * step_ / radius_); nearer < sought) {
    std::optional<Room> room;
    if (!any_missing(p, nearer)) room = within(p, half_disc);
    if (!room) room = within(p, nearer);
    if (room) return *room;
  }
  return within(p, sought).value_or(Room{});
}

// Nothing: what lies within so many radii does not tell.
std::optional<Room> Cuts::within(const Vec2& p, double radii) const {
  // What is cut by distance, in rings; of what is missing the nearest place.
  constexpr int rings = 46;
  constexpr double width = sought / rings;  // radii
  std::array<double, rings> cut{};
  Room room{.whole = infinite, .even = sought * radius_};
  const double reach = radii * radius_;
  const Vec2 middle = (p - corner_) / step_;
  const auto [first, last] = window(p, radii);
  for (Index j = first[1]; j <= last[1]; ++j)
    for (Index i = first[0]; i <= last[0]; ++i) {
      if (cut_(i, j) <= 0.0) continue;
      const double r = (Vec2(static_cast<double>(i), static_cast<double>(j)) - middle).norm() * step_;
      if (missing_(i, j) > 0.0) room.whole = std::min(room.whole, r);
      if (r >= reach) continue;
      // Shared between the two rings that it lies between: nothing jumps as the place moves.
      const double ring = r / (width * radius_);
      const auto k = static_cast<std::size_t>(ring);
      const double outer = ring - std::floor(ring);
      cut[k] += (1.0 - outer) * cut_(i, j);
      if (k + 1 < rings) cut[k + 1] += outer * cut_(i, j);
    }
  const double enough = negligible * std::numbers::pi * radius_ * radius_ / (step_ * step_);
  const bool all = radii >= sought;
  const auto known = all ? std::size_t{rings} : static_cast<std::size_t>(radii / width);  // rings seen whole
  double sum = 0.0;
  for (std::size_t k = 0; k < known; ++k) {
    if (sum + cut[k] >= enough) {
      room.even = (static_cast<double>(k) + (enough - sum) / cut[k]) * width * radius_;
      return room;
    }
    sum += cut[k];
  }
  return all ? std::optional(room) : std::nullopt;
}

// Where the image ends is no surface of the organ.
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
    stop_if_asked();
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

// The rule's weighing of places: high, near the middle, and with the room that is asked for.
struct Rule {
  Vec2 middle;
  double radius;
  std::optional<Vec2> half;
  std::function<bool(const Vec3&)> is_free;
  // What is taken only where there is nothing better.
  bool with_little_room, with_thin_and_free, with_image_ends;
  bool just_fits = false;  // nothing of a surface is asked for beyond the disc itself

  // A place that lacks room is worth less, in the end more than any height could make good.
  double worth(double mean, const Vec2& p, double room) const {
    return mean - level * (p - middle).lpNorm<1>() - price(room);
  }
  double price(double room) const {
    const double lack = std::max(0.0, wanted_room - room / radius);
    return price_of_room * lack * lack * radius;
  }
  double thin = 0.0;  // less tissue than that is bent away where it is free [mm]
  bool has_room(const Room& room, double slack) const {
    return room.whole >= (just_fits ? radius : whole_disc * radius + slack) &&
           (with_little_room || room.even >= little_room * radius);
  }
  bool allowed(const Vec2& p) const { return !half || (p - middle).dot(*half) > 0.0; }
};

struct Dome {
  Vec2 centre = Vec2::Zero();
  double worth = -infinite, room = 0.0, mean = 0.0;
};

struct Chosen {
  CirclePlace place;
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

// Whether too much of what lies beneath a circle at p is thin and free.
bool bends_at(const HeightMap& map, const Eigen::ArrayXXd& thin, const Rule& rule, const Vec2& p) {
  int met = 0, bending = 0;
  for (const double share : {0.0, 0.4, 0.7, 0.95})
    for (int k = 0; k < (share > 0.0 ? 12 : 1); ++k) {
      const double angle = std::numbers::pi * k / 6.0;
      const Vec2 x =
          (p + share * rule.radius * Vec2(std::cos(angle), std::sin(angle)) - map.corner) / map.step;
      const Index i = std::lround(x.x()), j = std::lround(x.y());
      if (i < 0 || j < 0 || i >= thin.rows() || j >= thin.cols() || !std::isfinite(map.height(i, j)))
        continue;
      ++met;
      bending += thin(i, j) > 0.0;
    }
  return bending > most_bending * met;
}

// Keeps the better one of a dome and what is at p.
bool consider(const HeightMap& map, const Eigen::ArrayXXd& thin, const Cuts& cuts, const Rule& rule,
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

// The best place within reach of one whose surroundings were sampled at `step`.
Dome settle(const View& view, const Rule& rule, Vec2 centre, double step) {
  const double reach = std::max(0.5 * rule.radius, 4.0 * step);
  Dome best;
  for (int round = 0; round < 32; ++round) {
    stop_if_asked();
    const HeightMap map =
        map_around(view, centre, reach + (sought + 0.2) * rule.radius, step, rule.with_image_ends);
    const Cuts cuts(map, rule.radius);
    const Eigen::ArrayXXd thin = thin_and_free(view, map, rule.thin, rule.is_free);
    best = {};
    if (!consider(map, thin, cuts, rule, centre, best)) return best;
    for (double stride = step; stride > rule.radius / 1000.0; stride *= 0.5)
      for (int moves = 0; moves < 32; ++moves) {
        const Vec2 from = best.centre;
        bool moved = false;
        for (int way = 0; way < 16; ++way) {
          const double angle = std::numbers::pi * way / 8.0;
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

// The best place near one that was found on a lattice of `step`, which is refined.
Dome look_closely(const View& view, const Rule& rule, Vec2 centre, double step) {
  const double fine = rule.radius * finest;
  while (step > fine) {
    const double around = 1.5 * step;
    step = std::max(fine, step / 4.0);
    const HeightMap map =
        map_around(view, centre, around + (sought + 0.2) * rule.radius, step, rule.with_image_ends);
    const Cuts cuts(map, rule.radius);
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
  return settle(view, rule, centre, step);
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

// A place on a map, and what it is worth: its height at most.
struct Place {
  Vec2 at;
  double most, worth;
};

// Those that are thick enough, by what they may be worth.
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

// From the highest down, until no other can be as good as the best: those with room, the best first.
void keep_good_places(const Rule& rule, const Cuts& cuts, double slack, std::vector<Place>& places) {
  double best = -infinite;
  std::size_t judged = 0;
  while (judged < places.size() && places[judged].most >= best - slack) {
    stop_if_asked();
    const std::size_t end = std::min(judged + places_at_once, places.size());
    tbb::parallel_for(judged, end, [&](std::size_t k) {
      const Room room = cuts.at(places[k].at);
      // A little more than looking closely asks for, so that it does not refuse what it is given.
      if (rule.has_room(room, 2.0 * cuts.step())) places[k].worth = places[k].most - rule.price(room.even);
    });
    for (; judged < end; ++judged) best = std::max(best, places[judged].worth);
  }
  places.resize(judged);
  std::erase_if(places, [](const Place& place) { return place.worth == -infinite; });
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.worth > b.worth; });
}

// One place for each dome, the highest first; what the lattice's step may hide is decided by a closer look.
std::vector<Dome> domes_of(const Rule& rule, const View& view, const std::vector<Place>& places, double apart,
                           double slack, double step) {
  std::vector<Dome> domes;
  std::vector<Vec2> begun;
  double highest = -infinite;
  for (const Place& place : places) {
    if (static_cast<int>(begun.size()) == most_domes || place.worth < highest - slack) break;
    if (std::any_of(begun.begin(), begun.end(), [&](const Vec2& b) { return (b - place.at).norm() < apart; }))
      continue;
    if (begun.empty()) highest = place.worth;
    begun.push_back(place.at);
    const Dome dome = look_closely(view, rule, place.at, step);
    // Two beginnings may end on the same dome.
    const auto same = std::find_if(domes.begin(), domes.end(),
                                   [&](const Dome& d) { return (d.centre - dome.centre).norm() < apart; });
    if (same == domes.end() && dome.worth > -infinite)
      domes.push_back(dome);
    else if (same != domes.end() && dome.worth > same->worth + 1e-3 * rule.radius)
      *same = dome;
  }
  return domes;
}

// Of domes that are equally high the body's own lopsidedness decides before anything outside of it does.
std::pair<const Dome*, int> highest_of(const std::vector<Dome>& domes, const View& view,
                                       const Moments& moments, double height, const Vec3& prefer) {
  const double top = std::max_element(domes.begin(), domes.end(), [](const Dome& a, const Dome& b) {
                       return a.worth < b.worth;
                     })->worth;

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
  keep_good_places(rule, Cuts(map, radius), slack, places);
  const std::vector<Dome> domes =
      domes_of(rule, view, places, std::max(2.0 * radius, 0.25 * moments.size), slack, step);
  if (domes.empty()) return std::nullopt;
  const auto [chosen, equals] = highest_of(domes, view, moments, height, prefer);
  // A hundredth of a radius is more than the surface knows: places that differ by rounding become one.
  const double grid = radius / 100.0;
  const Vec2 centre = (chosen->centre / grid).array().round() * grid;
  return Chosen{{centre, chosen->room, equals}, chosen->mean};
}

}  // namespace

Room room_around(const View& view, const Vec2& centre, double radius) {
  return Cuts(map_around(view, centre, (sought + 0.2) * radius, radius * finest, true), radius).at(centre);
}

std::optional<CirclePlace> highest_dome(const View& view, const Moments& moments, double radius,
                                        double height, const std::optional<Vec2>& half, const Vec3& prefer,
                                        const std::function<bool(const Vec3& leaves)>& is_free) {
  Rule rule{.middle = view.flat(view.body->centroid()),
            .radius = radius,
            .half = half,
            .is_free = is_free,
            .with_little_room = true,
            .with_thin_and_free = false,
            .with_image_ends = view.body->image_ends().empty()};
  auto found = highest_dome_by(rule, view, moments, height, prefer);
  for (bool* rest : {&rule.with_thin_and_free, &rule.with_image_ends, &rule.just_fits}) {
    if (found) break;
    if (*rest) continue;
    *rest = true;
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
  const Cuts cuts(map, radius);
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
                          .touch = view.at(map.place(i, j), map.height(i, j)),
                          .room = {},
                          .mean_height = height(i, j),
                          .bending = bending(i, j)});
  tbb::parallel_for(std::size_t{0}, places.size(), [&](std::size_t k) {
    stop_if_asked();
    places[k].room = cuts.at(places[k].centre);
  });
  return places;
}

}  // namespace dimple
