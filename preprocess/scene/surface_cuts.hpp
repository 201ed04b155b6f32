#pragma once

#include <optional>

#include "preprocess/surface/height_map.hpp"

namespace dimple {

/// Room of the surface around a place for the contact patch.
struct Room {
  double whole = 0.0;  ///< distance from the middle to where the surface ends or drops by a radius [mm];
                       ///< beyond 1.15 radii it may be overestimated
  double even = 0.0;   ///< to where a fold, an edge or a steep slope cuts it, at most 2.3 radii [mm]
};

/// Cuts in the surface of a height map, and the distance to them from a place. a: radius of the patch. A
/// method of this project.
///
/// 1. Heights smoothed by a Gaussian of a/4; slopes by differences over a/8 to each side.
/// 2. Missing (cut = 1): no surface, or a drop of more than a (at least three steps) to a neighbour.
/// 3. Else cut = the larger of two ramps from 0 to 1: of the slope, from 60 to 80 degrees, and of the turn of
///    the normal, from 25 to 60 degrees. The turn is between places a/4 to each side, in four directions.
/// 4. Room::whole at a place: distance of the nearest missing point of the lattice.
/// 5. Room::even: the radius within which the sum of the cuts reaches 3 % of the disc's area, at most 2.3 a.
class SurfaceCuts {
 public:
  static constexpr double sought = 2.3;       ///< radii: a little more than the requested room
  static constexpr double whole_disc = 1.05;  ///< radii: the disc and a little more

  SurfaceCuts(const HeightMap& map, double radius);
  Room at(const Eigen::Vector2d& p) const;
  double step() const { return step_; }

 private:
  void grade(const HeightMap& map);
  void count_missing();
  bool any_missing(const Eigen::Vector2d& p, double radii) const;
  std::optional<Room> within(const Eigen::Vector2d& p, double radii) const;
  struct Window {
    Index first[2], last[2];
  };
  Window window(const Eigen::Vector2d& p, double radii) const;
  double radius_;
  Eigen::Vector2d corner_;
  double step_ = 1.0;
  Eigen::ArrayXXd cut_;             // 0 ... 1
  Eigen::ArrayXXd missing_;         // 0 ... 1
  Eigen::ArrayXXi missing_before_;  // number of incomplete places (i, j) with i < row and j < column
};

}  // namespace dimple
