#pragma once

#include "solver/march.hpp"

namespace dimple {

/// Marches without inertia: equilibria in even steps of the load, each at most options.step_radii long. The
/// first guess extrapolates the last four. Viscoelastic tissue relaxes over the loading's time between two of
/// them. An increment is halved if no equilibrium is found, down to 1/16 of a step, or if a guard refuses it,
/// at most `most_retries` times.
///
/// The number of output frames does not affect this. A frame between two steps has an equilibrium of its own,
/// started from both sides, and a force sample; energies, guards and later steps ignore it. If none is found,
/// the frame is interpolated and has no sample, as the finding `frame` reports. `ended` receives the last
/// equilibrium.
void march_quasi_statically(System& system, const Loading& loading, const SolverOptions& options,
                            const Observer& observer, History& history, const MarchState* from = nullptr,
                            EquilibriumState* ended = nullptr);

/// Result of a cut at a held pose.
struct AfterCut {
  double released = 0.0;            ///< of the stored energy [J]
  bool passed_limit_point = false;  ///< stored energy [J]
};
/// Finds the equilibrium of a body that was cut, near the state of System::go_on(), at loading.start. It is
/// added to curve, ledger and frames at `t` [s]; `ended` receives it. Throws SolveError: none is found, or a
/// guard refuses it.
AfterCut equilibrate_after_cut(System& system, const Loading& loading, double t, const SolverOptions& options,
                               const Observer& observer, History& history, EquilibriumState& ended);

/// Number of load steps, if none is shortened.
int steps_of_load(const Model& model, const Loading& loading, const SolverOptions& options);
/// Force evaluations of the mixed iteration for a step of the load, on average over a whole run.
constexpr std::int64_t evaluations_of_step = 60;
/// Most force evaluations of the mixed iteration for all equilibria of `steps` load steps together.
std::int64_t most_evaluations(int steps, const SolverOptions& options);

/// First guess of u [4xN] m after a motion of the tool by `distance` [m] along `direction`. It decays away
/// from the bonded patch and towards the base.
void first_guess(const Model& model, const Vec3& direction, double distance, ForceSystem::Nodal& u);

}  // namespace dimple
