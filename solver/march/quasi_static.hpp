#pragma once

#include "solver/march.hpp"

namespace dimple {

/// As march_explicitly(), but so slowly that inertia plays no part: equilibria in even steps of the load,
/// each at most options.step_radii long and looked for where the last four lead. With viscoelastic tissue the
/// time between two of them is that of the loading. Where there is no equilibrium to be found, or a guard
/// says that it is wrong, the way there is halved, at most `most_retries` times.
///
/// How many frames there are changes nothing of that. A frame whose depth no step ends at has an equilibrium
/// of its own, found from those on both sides, and a sample of the force; energies, guards and what follows
/// do not know of it. Where none is found the frame shows the line between the two, as the finding `frame`
/// says, without a sample. `ended` receives the last equilibrium.
void march_quasi_statically(System& system, const Loading& loading, const SolverOptions& options,
                            const Observer& observer, History& history, const MarchState* from = nullptr,
                            Rest* ended = nullptr);

/// What a cut has left at a pose that is held.
struct AfterCut {
  double released = 0.0;  ///< of the stored energy [J]
  bool gave_way = false;  ///< no equilibrium was near: viscous steps led to this one
};
/// The body has been cut while all that holds it stays: the equilibrium near that which the system was told
/// to go on from, at loading.begun. It joins curve, books and frames at `t` [s], and `ended` receives it.
/// Throws SolveError: there is none to be found, or a guard says that it is wrong.
AfterCut settle_after_cut(System& system, const Loading& loading, double t, const SolverOptions& options,
                          const Observer& observer, History& history, Rest& ended);

/// How many steps that load takes, where none is shortened.
int steps_of_load(const Model& model, const Loading& loading, const SolverOptions& options);
/// Force evaluations of the mixed iteration for a step of the load, on average over a whole run.
constexpr std::int64_t evaluations_of_step = 60;
/// Force evaluations of the mixed iteration for all equilibria of so many steps of the load together, at
/// most.
std::int64_t most_evaluations(int steps, const SolverOptions& options);

/// A first guess of the displacements u [4xN] m when the tool has moved by `way` [m] along `direction`: they
/// fade away from the circle and towards the base.
void first_guess(const Model& model, const Vec3& direction, double way, ForceSystem::Nodal& u);

}  // namespace dimple
