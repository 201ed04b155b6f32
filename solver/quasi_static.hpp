#pragma once

#include "solver/march.hpp"

namespace dimple {

/// As march_explicitly(), but so slowly that inertia plays no part: equilibrium at options.frames depths, each from
/// the last three. With viscoelastic tissue the time between two of them is that of the loading. Where there
/// is no equilibrium to be found, or a guard says that it is wrong, the way there is halved, at most
/// `most_retries` times.
void march_quasi_statically(const ForceSystem& system, const Model& model, const Loading& loading,
                            const SolverOptions& options, const Observer& observer, History& history,
                            const State* from = nullptr);

/// A first guess of the displacements u [4xN] m when the tool has moved by `depth` [m] from rest: they fade away
/// from the circle and towards the base.
void first_guess(const Model& model, double depth, ForceSystem::Nodal& u);

}  // namespace dimple
