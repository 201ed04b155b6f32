#pragma once

#include <functional>
#include <limits>
#include <optional>

#include "solver/march/quasi_static.hpp"

namespace dimple {

/// Part of a scene between two changes of the body, such as cuts: its steps, and the state that one body
/// passes to the next.
struct ScenePart {
  std::size_t first = 0,
              end = std::numeric_limits<std::size_t>::max();  ///< range of Loading::steps
  /// First guess for a body just cut, on its own nodes; the march places held nodes, and contact forces may
  /// be missing. Empty: the scene begins with this body.
  std::optional<EquilibriumState> near = {};
  double later = 0.0;         ///< [s] after the last step: the cut on the curve
  int cuts = 0;               ///< number of cuts so far, with this one
  bool path_matters = false;  ///< viscoelastic tissue: steps may not be repeated on the cut body

  /// Equilibrium at the end, and System::least_reactions() there; the next part begins with both.
  EquilibriumState ended = {};
  double least_reactions = 0.0;
  AfterCut cut = {};
  std::function<void()> has_joined = {};  ///< called when the cut has joined the curve
  bool done_again = false;  ///< none was found from `near`: the steps before were repeated from rest
};

/// Marches the steps of a scene one after the other, each quasi-statically from the equilibrium of the last
/// one; history, time and frames continue. Each step has frames in proportion to its length, at least one.
/// Needs: steps of positive length, and their sets in loading.further. `part`: of the scene, with this body.
void march_in_steps(System& system, const Loading& loading, const SolverOptions& options,
                    const Observer& observer, History& history, const MarchState* from = nullptr,
                    ScenePart* part = nullptr);

/// Number of frames of each step, of `frames` in all or of one for each step.
std::vector<int> frames_of_steps(const std::vector<Step>& steps, int frames);

/// Displacement of a set (empty: the tool, without its rotation) after `travelled` [m] of the path of all
/// steps; and at a time [s], with `rate` [m/s] for steps without a duration.
Vec3 moved(const std::vector<Step>& steps, std::string_view name, double travelled);
Vec3 moved_at(double time_s, const std::vector<Step>& steps, double rate, std::string_view name);

/// Motion of the tool in a step that begins at `before`, its tip first at `tip` [m]; and its pose at the end.
RigidMotion motion_in(const Step& step, const RigidMotion& before, const Vec3& tip);
RigidMotion after(const Step& step, const RigidMotion& before, const Vec3& tip);

}  // namespace dimple
