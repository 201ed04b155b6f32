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

/// Opening, direction and targets of a shift, in LPS mm.
struct ShiftScene {
  Eigen::Vector4d opening;  ///< x, y, z, radius
  Vec3 up;                  ///< unit vector against gravity
  std::vector<Vec3> targets;
};
/// Reads the options. Throws UsageError: one of them is not understood.
ShiftScene scene_of(const ShiftOptions& options);

inline constexpr const char* skull_name = "skull";
/// Gap of a derived skull [mm].
double gap_of_skull(const ShiftOptions& options);

/// Brain in equilibrium after the shift. It must not be moved in memory: its parts refer to each other.
struct Shifted {
  Result result;
  std::unique_ptr<ForceSystem> tissue;
  std::unique_ptr<System> system;
  Nodal f;
  ForceSystem::Sweep sweep;
  Points surface_mm;           ///< [3xV] displacement of the surface's vertices
  Points line;                 ///< [3xL] LPS mm, from the brain's surface at the opening to its centre
  Points line_mm, targets_mm;  ///< displacement there and at the requested targets
  double solve_s = 0.0;

  const Nodal& u() const { return system->step_start().u; }
  /// Vertex with the largest displacement in a ball; if it contains none, the vertex closest to its centre.
  Index largest_in(const Eigen::Vector4d& ball) const;
  /// Displacement at the centre of the opening, where the line into the brain begins [mm].
  Vec3 at_middle(const Eigen::Vector4d& opening) const;
  /// Displacement at points [3 x places] mm.
  Points at(const Points& places_mm) const;
};

/// Points of a list [3 x places].
Points points_of(const std::vector<Vec3>& list);

/// Observers and changes of a run with one choice changed.
struct ShiftHooks {
  RunObserver observer = {};
  std::function<void(const Discretisation&)> placed = {};
  BodyModification change = {};
};
/// Computes the equilibrium. `scene`: of describe_shift(). Throws as simulate() does; UsageError: the opening
/// or a target is outside the brain.
void find_equilibrium(const Scene& scene, const ShiftScene& requested, const ShiftHooks& hooks,
                      Shifted& result);

/// Assumptions for options that were not given, a sentence each.
std::vector<std::string> assumptions_of(const Description& described, const ShiftOptions& options);

}  // namespace dimple
