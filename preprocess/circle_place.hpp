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

/// The highest dome with room, in the half plane `side` . x > 0 about the body's middle if it is given: where
/// the mean height over the disc is greatest, less what the place lacks of the wanted room (four radii of
/// height for a margin of none, in proportion to the square) and less a twelfth of the way from the body's
/// middle, so that of a plateau its middle is taken. Of two domes as high, within a quarter per cent of
/// `height`, the one away from the body's pointed end or, in a body that has none, towards `prefer` is taken.
/// Nothing: no place takes the whole disc.
std::optional<CirclePlace> highest_dome(const View& view, const Moments& moments, double radius,
                                        double height, const std::optional<Eigen::Vector2d>& side,
                                        const Vec3& prefer);

}  // namespace dimple
