#pragma once

#include "solver/simulate.hpp"

namespace dimple {

struct RelaxOptions {
  double tolerance = 1e-4;           ///< unbalanced force / reactions
  std::int64_t evaluations = 20000;  ///< of the force, at most
};

struct Relaxed {
  std::int64_t evaluations = 0;
  double residual =
      0.0;  ///< norm of the unbalanced forces / (half the sum of all reactions' sizes + external forces)
  ForceSystem::Sweep sweep;
};

/// Finds static equilibrium by dynamic relaxation: the body, with fictitious masses that give every node
/// about the same stable step, is let swing and damped near critically, the damping following the lowest
/// frequency met.
///
///     u+ = u + r^2 (u - u-) - c M^-1 (f - external),   r = (K - 1)/(K + 1), K = 2/(w dt), c = ((1 + r)
///     dt/2)^2
///
/// Source:   Papadrakakis 1981; Joldes, Wittek, Miller 2011. Departs: masses are row sums of a bound of the
/// stiffness; the frequency is a Rayleigh quotient of the change over the last iterations.
class Relaxation {
 public:
  Relaxation(const ForceSystem& system, const Model& model, const Constraints& constraints);

  /// u [N] m holds the prescribed values and a guess of the others; afterwards the equilibrium, and f [N] the
  /// internal force there. `external` [N] N: dead loads, or empty. Throws SolveError where there is none to
  /// be found.
  Relaxed operator()(ForceSystem::Nodal& u, ForceSystem::Nodal& f, const RelaxOptions& options = {},
                     const ForceSystem::Nodal& external = {}) const;

 private:
  const ForceSystem& system_;
  const Model& model_;
  const Constraints& constraints_;
  Eigen::VectorXd mass_;
};

/// [N] for each node a bound of what it is held with by all others: sum_b |K_ab|, K the tangent at rest
/// [N/m].
Eigen::VectorXd stiffness_row_sums(const Model& model, const Tissues& tissues);

/// As simulate(), but so slowly that inertia plays no part: equilibrium at options.frames depths, each from
/// the last three. With viscoelastic tissue the time between two of them is that of the loading.
void load_slowly(const ForceSystem& system, const Model& model, const Loading& loading,
                 const SolverOptions& options, const Observer& observer, History& history);

}  // namespace dimple
