#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/organ.hpp"
#include "apps/studies/shift.hpp"
#include "solver/system.hpp"

namespace dimple {

/// What the options of a shift say, in LPS mm.
struct ShiftScene {
  Eigen::Vector4d opening;  ///< x, y, z, radius
  Vec3 up;                  ///< unit vector against gravity
  std::vector<Vec3> targets;
};
/// Throws UsageError: one of them is not understood.
ShiftScene scene_of(const ShiftOptions& options);

inline constexpr const char* skull_name = "skull";
/// Of a derived skull, in mm.
double gap_of_skull(const ShiftOptions& options);

/// The brain at rest after it. Not to be moved: its parts refer to each other.
struct Shifted {
  Result result;
  std::unique_ptr<ForceSystem> tissue;
  std::unique_ptr<System> system;
  Nodal f;
  ForceSystem::Sweep sweep;
  Points surface_mm;           ///< [3xV] the shift of the surface's vertices
  Points line;                 ///< [3xL] LPS mm, from the brain's surface at the opening towards its middle
  Points line_mm, targets_mm;  ///< the shift there and at the targets that were asked for
  double solve_s = 0.0;

  const Nodal& u() const { return system->step_start().u; }
  /// The vertex within a ball that moves most; where none lies in it, the one nearest to its middle.
  Index largest_in(const Eigen::Vector4d& ball) const;
  /// The shift at the middle of the opening, where the line into the brain begins [mm].
  Vec3 at_middle(const Eigen::Vector4d& opening) const;
  /// [3 x places] mm.
  Points at(const Points& places_mm) const;
};

/// [3 x places]
Points points_of(const std::vector<Vec3>& list);

/// What else a run of one choice changed has.
struct ShiftHooks {
  RunObserver observer = {};
  std::function<void(const Discretisation&)> placed = {};
  BodyChange change = {};
};
/// `scene`: of what describe_shift() returns. Throws as simulate() does; UsageError: the opening or a target
/// is not where the brain is.
void come_to_rest(const Scene& scene, const ShiftScene& asked, const ShiftHooks& hooks, Shifted& result);

/// What nobody has said, a sentence each.
std::vector<std::string> assumptions_of(const Description& described, const ShiftOptions& options);

}  // namespace dimple
