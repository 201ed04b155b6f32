#pragma once

#include <optional>

#include "preprocess/surface/height_map.hpp"

namespace dimple {

/// What the surface is like where a circle is to be.
struct Room {
  double whole = 0.0;  ///< distance from the middle to where the surface ends or drops by a radius [mm]; from
                       ///< 1.15 radii on it may be said to be larger than it is
  double even = 0.0;   ///< to where a fold, an edge or a steep slope cuts it, at most 2.3 radii [mm]
};

/// Where a height map is cut, and how far it is to there.
class SurfaceCuts {
 public:
  static constexpr double sought = 2.3;       ///< radii: a little beyond the room that is wanted
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
  Eigen::ArrayXXi missing_before_;  // how many places (i, j) with i < row and j < column miss anything
};

}  // namespace dimple
