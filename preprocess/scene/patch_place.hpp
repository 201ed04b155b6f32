#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "preprocess/scene/surface_cuts.hpp"

namespace dimple {

/// Requested room of a patch: its disc and a margin of a radius around it.
constexpr double preferred_room = 2.0;  // radii
constexpr double little_room = 1.75;    // radii: less gives a warning

Room room_around(const View& view, const Eigen::Vector2d& centre, double radius);

struct PatchPlace {
  Eigen::Vector2d centre;
  double room = 0.0;  ///< from the middle to the nearest fold or edge, at most 2.3 radii [mm]
  int equals = 1;     ///< number of domes of this height, including this one
};

/// Highest dome with room, optionally in the half plane `half` . x > 0 about the body's middle. A rule of
/// this project.
/// 1. Height map along the approach direction, with a step of a twelfth of the radius. Places: over tissue of
///    at least half the median thickness, and at most 25 % of the disc over thin tissue that is free behind
///    (`is_free`).
/// 2. Value of a place = mean height over the disc - 4 a max(0, 2 - room/a)^2 - 0.08 |distance from the
///    body's middle|_1, with the radius a.
/// 3. Places are evaluated in order of their bound, the value with full room, until no other can be the best.
/// 4. From the best place of each of up to eight domes: finer maps, then a pattern search to a/1000.
/// 5. Of domes within 0.25 % of `height`: the one away from the body's pointed end; without such an end,
///    towards `prefer`.
/// 6. If none is found, in this order: allow thin and free tissue, ends of the image, discs that just fit.
/// 7. A dome with less than 1.75 a of room yields to one with more, less than 15 % of `height` lower.
///
/// Nothing: no place takes the whole disc.
std::optional<PatchPlace> highest_dome(const View& view, const Moments& moments, double radius, double height,
                                       const std::optional<Eigen::Vector2d>& half, const Vec3& prefer,
                                       const std::function<bool(const Vec3& leaves)>& is_free);

/// Tissue thinner than this many diameters of the patch bends where it is free behind.
constexpr double bending_thickness = 3.0;

/// Properties of a place for the patch.
struct SurveyedPlace {
  Eigen::Vector2d centre;
  Vec3 contact;  ///< where the approach through its centre first meets the body [mm]
  Room room;
  double mean_height = 0.0;  ///< over the disc [mm]
  double bending = 0.0;      ///< fraction of the disc over thin and free tissue
};

/// Places all over the body, about `stride` [mm] apart.
std::vector<SurveyedPlace> survey(const View& view, double radius, double stride,
                                  const std::function<bool(const Vec3& leaves)>& is_free);

}  // namespace dimple
