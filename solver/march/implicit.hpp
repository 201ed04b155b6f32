#pragma once

#include "solver/march.hpp"

namespace dimple {

/// As march_explicitly(), with steps as long as the waves of the whole body allow, not those between two
/// nodes: each is an equilibrium with inertia, found by MixedIteration. Hilber, Hughes and Taylor's rule with
/// alpha -1/3,
///
///     u+ = u + dt v + dt^2 ((1/2 - beta) a + beta a+),   v+ = v + dt ((1 - gamma) a + gamma a+),
///     M (a+ + c v+) = (1 + alpha) (R - f(u+)) - alpha (R - f(u)),
///
/// damps what the step cannot resolve most, and what it does resolve too: a mode of six steps a period loses
/// 8 % of its amplitude in each period and takes 12 % longer for it, 2 % and 5 % at ten, 0.3 % and 1 % at
/// twenty. dt is a sixth of the period of the
/// slowest shear wave: for a slow load, whose modes have to die away, not to be counted. Modes between
/// neighbouring nodes, of which the tool's slow way excites none, are not resolved. A step that does not
/// converge is halved, twice; where that does not help the tissue gives way, and central differences with
/// their small steps carry the body through one long step.
///
/// Source:   Newmark 1959; Hilber, Hughes, Taylor 1977, alpha -1/3.
/// Throws:   SolveError: a number stopped being one. `history` holds everything up to that moment.
void march_implicitly(System& system, const Loading& loading, const SolverOptions& options,
                      const Observer& observer, History& history, const MarchState* from = nullptr);

}  // namespace dimple
