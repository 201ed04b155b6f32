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
/// Departs:  the step is computed, and again at every output frame under load; the paper does not state its
///           choice. If a guard refuses a state, the march returns to the last output frame and takes smaller
///           steps, at most `most_retries` times.
/// Throws:   SolveError: it was refused again. `history` then holds everything up to the last output frame.
///
/// If a stop is requested (io/stop.hpp), both marches return with `history.interrupted` and the results so
/// far. `from`: a state of an earlier run with the same model, loading and options; earlier frames and
/// samples are not given to `observer` again.
void march_explicitly(System& system, const Loading& loading, const SolverOptions& options,
                      const Observer& observer, History& history, const MarchState* from = nullptr);

}  // namespace dimple
