#pragma once

#include <optional>

#include "preprocess/height_map.hpp"

namespace dimple {

/// What the surface is like where a circle is to be.
struct Room {
  double whole = 0.0;  ///< distance from the middle to where the surface ends or drops by a radius [mm]
  double even = 0.0;   ///< to where a fold, an edge or a steep slope cuts it, at most 2.3 radii [mm]
};

/// A disc of the circle's size and a margin of a radius around it: what the rule for its place asks for.
constexpr double wanted_room = 2.0;  // radii

Room room_around(const View& view, const Eigen::Vector2d& centre, double radius);

struct CirclePlace {
  Eigen::Vector2d centre;
  double room = 0.0;  ///< from the middle to the nearest fold or edge, at most 2.3 radii [mm]
  int equals = 1;     ///< domes as high as this one, this one included
};

/// The highest dome with room: where the mean height over the disc is greatest, of all places (in the half plane
/// `side` . x > 0 about the body's middle, if it is given) with room, or, if there is none, of those that have
/// at least nine tenths of the most. Of two domes as high, within a quarter per cent of `height`, the one towards
/// the body's heavier end or, in a body that has none, towards `prefer` is taken; on a plateau the place nearest
/// to the body's middle. Nothing: no place takes the whole disc.
std::optional<CirclePlace> highest_dome(const View& view, double radius, double height,
                                        const std::optional<Eigen::Vector2d>& side, const Vec3& prefer);

}  // namespace dimple
