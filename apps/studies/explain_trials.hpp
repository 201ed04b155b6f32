#pragma once

#include <string>
#include <vector>

#include "apps/run/simulate.hpp"
#include "apps/studies/explain.hpp"

namespace dimple {

// The choices that an explanation changes, one at a time.

/// A case with one choice changed.
struct Trial {
  std::string what, instead, all;
  Alternative::Kind kind;
  Case given;
  bool linear = false;  ///< its force is that of one small depth, and proportional to the depth
};

/// What trials are made from: the case, the same with its places as numbers, and what was found with it.
struct Unchanged {
  const Scene& scene;
  const Scene& held;
  const Result& found;
  Vec3 down;

  const Touch* touch() const { return found.loading.touch.get(); }
  std::string tool_name() const { return touch() ? "tool" : "circle"; }
  double radius_mm() const { return 1e3 * (touch() ? touch()->shape.radius : found.model.tool.radius); }
};

/// The scene as it was found, with its places as numbers: a change of the body does not move the tool.
Scene pinned(Scene scene, const LoadedModel& found, const Vec3& down);

/// All trials, in the order in which they are run.
std::vector<Trial> trials_of(const Unchanged& unchanged);

/// Why a trial has nothing to say: its change has changed nothing. Empty: it has.
std::string left_out(const Trial& trial, const LoadedModel& now, const LoadedModel& found);

}  // namespace dimple
