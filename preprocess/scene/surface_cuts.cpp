#include "preprocess/scene/surface_cuts.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "io/stop.hpp"

namespace dimple {
namespace {

// Weight by which a slope, or a turn of the normal within half a radius, cuts the surface: 0 up to the first
// angle, 1 from the second on. The room ends where weighted cuts reach this fraction of the disc's area. So
// no single voxel ends it, and it is continuous where a fold is about as steep as a limit.
constexpr double gentle_slope = 60.0, steep_slope = 80.0, gentle_turn = 25.0, sharp_turn = 60.0;  // degrees
constexpr double negligible = 0.03;
constexpr double smoothing = 0.25;        // radii: smoothing of the heights before they are judged
constexpr Index most_lattice_steps = 10;  // of the lattice of cuts, to a radius
constexpr double half_disc = 0.5;         // radii

double degrees(double radians) {
  return radians * 180.0 / std::numbers::pi;
}

// Heights without the voxels' ripples: Gaussian means over the places where the body is.
Eigen::ArrayXXd smoothed(const Eigen::ArrayXXd& height, double sigma) {
  if (sigma < 0.5) return height;
  const auto reach = static_cast<Index>(std::ceil(2.5 * sigma));
  Eigen::ArrayXd weight(reach + 1);
  for (Index k = 0; k <= reach; ++k) weight[k] = std::exp(-0.5 * std::pow(static_cast<double>(k) / sigma, 2));
  // Smooths along columns, with weights; the transposed result is smoothed once more.
  const auto along = [&](const Eigen::ArrayXXd& from) {
    Eigen::ArrayXXd to = Eigen::ArrayXXd::Zero(from.rows(), from.cols());
    tbb::parallel_for(Index{0}, from.cols(), [&](Index j) {
      stop_if_requested();
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

}  // namespace

SurfaceCuts::SurfaceCuts(const HeightMap& map, double radius)
    : radius_(radius), corner_(map.corner), step_(map.step) {
  grade(map);
  // Averages several places where the lattice is finer than necessary.
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
  corner_ += Eigen::Vector2d::Constant(0.5 * static_cast<double>(merge - 1) * step_);
  step_ *= static_cast<double>(merge);
  count_missing();
}

void SurfaceCuts::count_missing() {
  missing_before_ = Eigen::ArrayXXi::Zero(missing_.rows() + 1, missing_.cols() + 1);
  for (Index j = 0; j < missing_.cols(); ++j)
    for (Index i = 0; i < missing_.rows(); ++i)
      missing_before_(i + 1, j + 1) = missing_before_(i + 1, j) + missing_before_(i, j + 1) -
                                      missing_before_(i, j) + (missing_(i, j) > 0.0 ? 1 : 0);
}

// Places of the lattice in a square about p.
SurfaceCuts::Window SurfaceCuts::window(const Eigen::Vector2d& p, double radii) const {
  const Eigen::Vector2d middle = (p - corner_) / step_;
  const double reach = radii * radius_ / step_;
  Window result;
  for (const int d : {0, 1}) {
    const Index count = d == 0 ? cut_.rows() : cut_.cols();
    result.first[d] = std::max<Index>(0, static_cast<Index>(std::ceil(middle[d] - reach)));
    result.last[d] = std::min(count - 1, static_cast<Index>(std::floor(middle[d] + reach)));
  }
  return result;
}

bool SurfaceCuts::any_missing(const Eigen::Vector2d& p, double radii) const {
  const auto [first, last] = window(p, radii);
  if (first[0] > last[0] || first[1] > last[1]) return false;
  const auto before = [&](Index i, Index j) { return missing_before_(i, j); };
  return before(last[0] + 1, last[1] + 1) - before(first[0], last[1] + 1) - before(last[0] + 1, first[1]) +
             before(first[0], first[1]) >
         0;
}

void SurfaceCuts::grade(const HeightMap& map) {
  const Eigen::ArrayXXd smooth = smoothed(map.height, smoothing * radius_ / map.step);
  const auto steps = [&](double length) { return std::max<Index>(1, std::lround(length / map.step)); };
  const Index rows = map.height.rows(), columns = map.height.cols(), slope = steps(radius_ / 8.0),
              aside = steps(radius_ / 4.0), aslant = steps(radius_ / 4.0 / std::numbers::sqrt2);
  const double drop = std::max(radius_, 3.0 * map.step);
  const auto height = [&](Index i, Index j) {
    return i < 0 || j < 0 || i >= rows || j >= columns ? std::nan("") : smooth(i, j);
  };
  // Rise per length, central where both sides exist.
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
    stop_if_requested();
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

Room SurfaceCuts::at(const Eigen::Vector2d& p) const {
  // Searches near first: at most places of a brain a fold is near. If the disc is complete, half of it is
  // first.
  if (const double nearer = std::max(0.5 * sought, whole_disc + 2.0 * step_ / radius_); nearer < sought) {
    std::optional<Room> room;
    if (!any_missing(p, nearer)) room = within(p, half_disc);
    if (!room) room = within(p, nearer);
    if (room) return *room;
  }
  return within(p, sought).value_or(Room{});
}

// Room from what is within so many radii; nothing if that does not determine it.
std::optional<Room> SurfaceCuts::within(const Eigen::Vector2d& p, double radii) const {
  // Cut area in rings by distance, and the nearest missing place.
  constexpr int rings = 46;
  constexpr double width = sought / rings;  // radii
  std::array<double, rings> cut{};
  Room room{.whole = std::numeric_limits<double>::infinity(), .even = sought * radius_};
  const double reach = radii * radius_;
  const Eigen::Vector2d middle = (p - corner_) / step_;
  const auto [first, last] = window(p, radii);
  for (Index j = first[1]; j <= last[1]; ++j)
    for (Index i = first[0]; i <= last[0]; ++i) {
      if (cut_(i, j) <= 0.0) continue;
      const double r =
          (Eigen::Vector2d(static_cast<double>(i), static_cast<double>(j)) - middle).norm() * step_;
      if (missing_(i, j) > 0.0) room.whole = std::min(room.whole, r);
      if (r >= reach) continue;
      // Divided between the two nearest rings, so that the result is continuous in the place.
      const double ring = r / (width * radius_);
      const auto k = static_cast<std::size_t>(ring);
      const double outer = ring - std::floor(ring);
      cut[k] += (1.0 - outer) * cut_(i, j);
      if (k + 1 < rings) cut[k + 1] += outer * cut_(i, j);
    }
  const double enough = negligible * std::numbers::pi * radius_ * radius_ / (step_ * step_);
  const bool all = radii >= sought;
  const auto known = all ? std::size_t{rings} : static_cast<std::size_t>(radii / width);  // complete rings
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

}  // namespace dimple
