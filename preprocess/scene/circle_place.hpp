#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "preprocess/scene/surface_cuts.hpp"

namespace dimple {

/// A disc of the circle's size and a margin of a radius around it: what the rule for its place asks for.
constexpr double wanted_room = 2.0;   // radii
constexpr double little_room = 1.75;  // radii: less is warned of

Room room_around(const View& view, const Eigen::Vector2d& centre, double radius);

struct CirclePlace {
  Eigen::Vector2d centre;
  double room = 0.0;  ///< from the middle to the nearest fold or edge, at most 2.3 radii [mm]
  int equals = 1;     ///< domes as high as this one, this one included
};

/// The highest dome with room, in the half plane `half` . x > 0 about the body's middle if it is given: where
/// the mean height over the disc is greatest, less what the place lacks of the wanted room (four radii of
/// height for a margin of none, in proportion to the square) and less a twelfth of the way from the body's
/// middle, so that of a plateau its middle is taken. Of two domes as high, within a quarter per cent of
/// `height`, the one away from the body's pointed end or, in a body that has none, towards `prefer` is taken.
/// Places over thin tissue that is free behind (`is_free` of where the push leaves it), and then those where
/// the image ends, and at last those that the disc just fits, are taken only if there is no other; one with
/// little room only if all others are lower by 15 % of `height`. Nothing: no place takes the whole disc.
std::optional<CirclePlace> highest_dome(const View& view, const Moments& moments, double radius,
                                        double height, const std::optional<Eigen::Vector2d>& half,
                                        const Vec3& prefer,
                                        const std::function<bool(const Vec3& leaves)>& is_free);

/// Tissue that is thinner than this many diameters of the circle, and free where the push leaves it, is bent
/// away.
constexpr double bending_thickness = 3.0;

/// What a circle would meet at a place.
struct SurveyedPlace {
  Eigen::Vector2d centre;
  Vec3 touch;  ///< where the push through its centre first meets the body [mm]
  Room room;
  double mean_height = 0.0;  ///< over the disc [mm]
  double bending = 0.0;      ///< share of the disc beneath which tissue is thin and free
};

/// Places all over the body, about `stride` [mm] apart.
std::vector<SurveyedPlace> survey(const View& view, double radius, double stride,
                                  const std::function<bool(const Vec3& leaves)>& is_free);

}  // namespace dimple
