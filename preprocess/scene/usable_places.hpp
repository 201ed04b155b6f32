#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/scene/boundary_conditions.hpp"

namespace dimple {

/// What lies beneath a circle, along the push.
struct Beneath {
  double thickness_mm = 0.0;  ///< of the tissue to where the push first leaves it, mean over the disc
  double bending = 0.0;       ///< share of the disc beneath which it is thinner than three diameters and free
  double tilt_degrees = 0.0;  ///< between the push and the mean inward normal of the surface
};
Beneath beneath(const BodySurface& body, const Boundary& boundary);

/// Whether most of what lies beneath the circle will be bent away rather than indented.
inline bool will_bend(double bending) {
  return bending > 0.5;
}

/// A place for the circle; lengths in mm, LPS.
struct UsablePlace {
  std::string from;  ///< the patient's side that the tool comes from
  Vec3 centre = Vec3::Zero(), push = Vec3::Zero();
  std::string base;  ///< the side that the organ rests on then
  double room_mm = 0.0;
  Beneath beneath;
  enum class Verdict { good, doubtful, refused } verdict = Verdict::good;  ///< doubtful: a run warns of it
  std::string reason;  ///< against it; empty: it is good. Of a side that takes no circle `room_mm` is 0
};
const char* word_of(UsablePlace::Verdict verdict);

/// Where the circle may stand.
struct UsablePlaces {
  std::vector<UsablePlace> sides;  ///< the highest place of each of the patient's sides, the tool's own first
  std::vector<UsablePlace>
      others;         ///< on the tool's own side, far apart: the good ones first, the highest first
  int looked_at = 0;  ///< places there, half a circle's diameter apart or more
  std::map<std::string, int> against;  ///< reason against some of those -> how many
};

/// Under the options' base, circle and push; `most`: of `others`. Throws UsageError as find_boundary()
/// does, and its ModelError where no side takes the circle.
UsablePlaces usable_places(const BodySurface& body, const BoundaryOptions& options, int most = 8);

/// The highest good place of the side that the tool comes from, two diameters away or more.
std::optional<UsablePlace> next_better_place(const BodySurface& body, const Boundary& than);

}  // namespace dimple
