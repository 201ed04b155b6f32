#pragma once

#include <functional>
#include <limits>
#include <optional>

#include "solver/march/quasi_static.hpp"

namespace dimple {

/// Where the body changes between two steps of a scene, as it is cut there: what one body sees of the scene,
/// and what it hands to the next.
struct ScenePart {
  std::size_t first = 0,
              end = std::numeric_limits<std::size_t>::max();  ///< of Loading::steps, those to march
  /// The body has just been cut: about where it then is, on its own nodes. What is held is put to its place,
  /// contact forces may be left out. Nothing: the scene begins with this body.
  std::optional<Rest> near = {};
  double later = 0.0;         ///< [s] after the last step: when the cut joins the curve
  int cuts = 0;               ///< so many until then, with this one
  bool path_matters = false;  ///< of viscoelastic tissue: the steps may not be done again on the cut body

  /// Where it ends, and System::least_reactions() there, which it also begins with.
  Rest ended = {};
  double least_reactions = 0.0;
  AfterCut cut = {};
  std::function<void()> has_settled = {};  ///< called when the cut has joined the curve
  bool done_again = false;  ///< from `near` there was no equilibrium: the steps before led to it from rest
};

/// The steps of a scene one after the other, each marched quasi-statically from the equilibrium that the last
/// one ended at: history, time and frames go on. Frames are shared out by the steps' ways, at least one for
/// each. Needs: loading.steps, all of them with a way, and what they name among loading.further. `part`: of
/// that scene this body's alone.
void march_in_steps(System& system, const Loading& loading, const SolverOptions& options,
                    const Observer& observer, History& history, const MarchState* from = nullptr,
                    ScenePart* part = nullptr);

/// The frames of each step, of `frames` in all or as many as there are steps.
std::vector<int> frames_of_steps(const std::vector<Step>& steps, int frames);

/// How far the set of that name (empty: the tool, which does not turn) has come, after `come` [m] of all
/// steps' ways; and at a time [s], where steps go at `rate` [m/s] that do not say how long they last.
Vec3 moved(const std::vector<Step>& steps, std::string_view name, double come);
Vec3 moved_at(double time_s, const std::vector<Step>& steps, double rate, std::string_view name);

/// How the tool goes on in a step that begins where it has gone by `before`, from where its tip was at `tip`
/// [m]; and where it is when that step has ended.
RigidWay way_in(const Step& step, const RigidWay& before, const Vec3& tip);
RigidWay after(const Step& step, const RigidWay& before, const Vec3& tip);

}  // namespace dimple
