#pragma once

#include "solver/simulate.hpp"

namespace dimple {

/// A load that lasts so many times as long as a shear wave's way through the body is slow: inertia plays no
/// part.
constexpr double slow_load = 8.0;
/// [s] that the slowest shear wave takes through the body along the tool's push.
double shear_crossing_time(const Tissues& tissues, const Model& model);

/// As simulate(), with steps as long as the waves of the whole body allow, not those between two nodes: each
/// is an equilibrium with inertia, found by MixedIteration. The trapezoidal rule,
///
///     u+ = u + dt/2 (v + v+),   v+ = v + dt/2 (a + a+),   M (a+ + c v+) = R - f(u+),
///
/// neither damps nor makes energy. dt is a sixth of the period of the slowest shear wave across the body:
/// the lowest swings are resolved, those between neighbouring nodes, of which the tool's slow way excites
/// none, are not. Where a step does not converge it is halved until the next frame.
///
/// Source:   Newmark 1959, beta 1/4, gamma 1/2.
/// Throws:   SolveError: no convergence with a 64th of the step. `history` holds everything up to that
/// moment.
void simulate_implicitly(const ForceSystem& system, const Model& model, const Loading& loading,
                         const SolverOptions& options, const Observer& observer, History& history);

}  // namespace dimple
