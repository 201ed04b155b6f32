#pragma once

#include "solver/march.hpp"

namespace dimple {

/// Marches the paper's explicit scheme: central differences in leapfrog form,
///
///     v(t + dt/2) = v(t - dt/2) + dt M^-1 (R - f(u(t))),   u(t + dt) = u(t) + dt v(t + dt/2),
///
/// then the prescribed displacements are put in place. Eliminating v gives the printed form
/// u(t + dt) = dt^2 M^-1 (R - f) + 2 u(t) - u(t - dt); stored velocities keep more digits and let dt change.
///
/// Source:   Horton et al. 2007, sections 2.3 and 3.2.
/// Departs:  the step is computed, and again at every frame under load; the paper does not say how it chose
///           its own. Where a guard says that the number would be wrong, the march goes back to the last
///           frame and takes smaller steps from there on; at most `most_retries` times.
/// Throws:   SolveError: it came again. `history` then holds everything up to the last frame.
///
/// Asked to stop (io/stop.hpp), this and every other way of marching returns with `history.interrupted` and
/// what there is. `from`: a state of an earlier run with the same model, loading and options; frames and
/// samples before it are not given to `observer` again.
void march_explicitly(System& system, const Loading& loading, const SolverOptions& options,
                      const Observer& observer, History& history, const MarchState* from = nullptr);

}  // namespace dimple
