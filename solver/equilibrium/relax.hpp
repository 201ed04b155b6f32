#pragma once

#include "io/error.hpp"
#include "solver/equilibrium/mixed_iteration.hpp"

namespace dimple {

/// Finds static equilibrium. The converging scheme uses MixedIteration, some ten force evaluations. If that
/// fails near a limit point, viscous regularisation follows at the held load, with a viscosity v and the
/// Laplacian A:
///
///     f(u+) + v A (u+ - u) = 0,
///
/// A step takes some ten evaluations; steps follow until the body is at rest. They make the linear problem
/// positive where the tangent is not, on any discretisation. Body masses instead take as many steps again, at
/// ten times the cost of each, and oscillate.
///
/// The paper's scheme, and the last resort, is dynamic relaxation, some hundreds of evaluations: fictitious
/// masses with about the same stable step at every node, damped near critically by the lowest frequency
/// found.
///
///     u+ = u + r^2 (u - u-) - c M^-1 f,
///     r = (K - 1)/(K + 1),   K = 2/(w dt),   c = ((1 + r) dt/2)^2
///
/// Source:   Papadrakakis 1981; Joldes, Wittek, Miller 2011.
/// Departs:  masses are row sums of a bound of the stiffness; the frequency is a Rayleigh quotient of the
///           change over the last iterations.
class Relaxation {
 public:
  explicit Relaxation(System& system);

  /// u [N] m holds the prescribed values and a first guess; it receives the equilibrium, and f [N] the force
  /// there. Throws SolveError: none is found; `limit-point`: viscous steps did not come to rest. `lambda`
  /// [patches]: if given, a first guess for MixedIteration, which receives its result.
  Relaxed operator()(ForceSystem::Nodal& u, ForceSystem::Nodal& f, const RelaxOptions& options = {},
                     Eigen::VectorXd* lambda = nullptr) const;
  /// Searches without dynamic relaxation, for callers that can shorten the step. Needs a model that
  /// MixedIteration serves. If not converged, `u` and `lambda` are unchanged. Past the end of the path of
  /// equilibria, a contacting tool that is clear of the body at rest may have lost contact: the body at rest
  /// is then an equilibrium.
  Relaxed from_near(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                    const RelaxOptions& options) const;
  bool has_mixed() const { return mixed_ != nullptr; }
  MixedIteration& mixed() const { return *mixed_; }  ///< only if it serves the model

 private:
  // Searches without viscosity near the end of viscous steps; success updates u, lambda and `result`.
  void find_equilibrium(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                        const RelaxOptions& options, Relaxed& result) const;
  Relaxed continue_past_limit_point(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                                    const RelaxOptions& options) const;
  Relaxed relax_dynamically(ForceSystem::Nodal& u, ForceSystem::Nodal& f, const RelaxOptions& options,
                            std::int64_t evaluations) const;

  System& system_;
  mutable Eigen::VectorXd mass_;  // made when relax_dynamically() is first needed
  mutable std::unique_ptr<MixedIteration> mixed_;
};

/// [N] N/m bound of each node's coupling to all others: sum_b |K_ab|, K the tangent at rest.
Eigen::VectorXd stiffness_row_sums(const ForceSystem& system, const Model& model);

/// Error that explains why no equilibrium was found.
SolveError no_equilibrium(const Relaxed& found, const Model& model);

}  // namespace dimple
