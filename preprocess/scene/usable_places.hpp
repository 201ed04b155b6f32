#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/scene/boundary_conditions.hpp"

namespace dimple {

/// Tissue beneath a contact patch, along the approach direction.
struct Beneath {
  double thickness_mm = 0.0;  ///< of the tissue along the approach direction, mean over the disc
  double bending = 0.0;  ///< fraction of the disc over tissue thinner than three diameters and free behind
  double tilt_degrees = 0.0;  ///< between the approach direction and the mean inward normal of the surface
};
Beneath beneath(const BodySurface& body, const Boundary& boundary);

/// True if most of the tissue beneath the patch is bent away rather than indented.
inline bool will_bend(double bending) {
  return bending > 0.5;
}

/// A place for the contact patch; lengths in mm, LPS.
struct UsablePlace {
  std::string from;  ///< the patient's side that the tool comes from
  Vec3 centre = Vec3::Zero(), approach = Vec3::Zero();
  std::string base;  ///< the side of the base for this place
  double room_mm = 0.0;
  Beneath beneath;
  enum class Verdict { good, doubtful, refused } verdict = Verdict::good;  ///< doubtful: a run warns
  std::string reason;  ///< against it; empty: it is good. `room_mm` is 0 for a side that takes no patch
};
const char* word_of(UsablePlace::Verdict verdict);

/// Possible places of the contact patch.
struct UsablePlaces {
  std::vector<UsablePlace> sides;  ///< the highest place of each of the patient's sides, the tool's own first
  std::vector<UsablePlace>
      others;         ///< on the tool's own side, far apart: the good ones first, the highest first
  int looked_at = 0;  ///< places there, at least half a patch's diameter apart
  std::map<std::string, int> against;  ///< reason against some of those -> how many
};

/// Places under the options' base, patch and direction; `most`: of `others`. Throws UsageError as
/// find_boundary() does, and its ModelError where no side takes the patch.
UsablePlaces usable_places(const BodySurface& body, const BoundaryOptions& options, int most = 8);

/// The highest good place of the side that the tool comes from, at least two diameters away.
std::optional<UsablePlace> next_better_place(const BodySurface& body, const Boundary& than);

}  // namespace dimple
