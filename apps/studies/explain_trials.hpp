#pragma once

#include <string>
#include <vector>

#include "apps/run/simulate.hpp"
#include "apps/studies/explain.hpp"

namespace dimple {

// Choices that an explanation changes, one at a time.

/// Case with one choice changed.
struct Trial {
  std::string what, instead, all;
  Alternative::Kind kind;
  Case given;
  bool linear = false;  ///< run at one small depth; the force is proportional to the depth
};

/// Reference of the trials: the case, the case with its positions as numbers, and its result.
struct Unchanged {
  const Scene& scene;
  const Scene& held;
  const Result& found;
  Vec3 down;

  const RigidBody* indenter() const { return found.loading.indenter.get(); }
  std::string tool_name() const { return indenter() ? "tool" : "circle"; }
  double radius_mm() const { return 1e3 * (indenter() ? indenter()->shape.radius : found.model.tool.radius); }
};

/// Scene with the positions that were found, as numbers, so that a change of the body does not move the tool.
Scene pinned(Scene scene, const LoadedModel& found, const Vec3& down);

/// All trials, in the order in which they are run.
std::vector<Trial> trials_of(const Unchanged& unchanged);

/// Reason to leave a trial out: the change had no effect on the case. Empty: it had one.
std::string left_out(const Trial& trial, const LoadedModel& now, const LoadedModel& found);

}  // namespace dimple
