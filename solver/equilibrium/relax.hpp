#pragma once

#include "io/error.hpp"
#include "solver/equilibrium/mixed_iteration.hpp"

namespace dimple {

/// Finds static equilibrium: of the converging scheme by MixedIteration, some ten evaluations of the force.
/// Where that does not converge, since the tissue is about to give way, it is let go at the held load as if
/// in honey: viscous forces like those of the Laplacian A that the iteration knows how to invert slow it
/// down,
///
///     f(u+) + share A (u+ - u) = 0,
///
/// each such step some ten evaluations, until it comes to rest. They make the nearby linear problem positive
/// where the tangent is not, however fine the cloud. Body masses in their place take as many steps again, at
/// ten times the cost of each, and momentum makes it oscillate.
///
/// For the paper's scheme, and as a last resort, by dynamic relaxation, some hundreds of evaluations: the
/// body, with fictitious masses that give every node about the same stable step, is let vibrate and damped
/// near critically, the damping following the lowest frequency met.
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

  /// u [N] m holds the prescribed values and a guess of the others; afterwards the equilibrium, and f [N] the
  /// force there. Throws SolveError where there is none to be found; `limit-point`, where the tissue gave way
  /// and did not come to rest. `lambda` [patches]: if given, a guess of what MixedIteration calls so;
  /// afterwards what was found.
  Relaxed operator()(ForceSystem::Nodal& u, ForceSystem::Nodal& f, const RelaxOptions& options = {},
                     Eigen::VectorXd* lambda = nullptr) const;
  /// The same without the last resort, for a caller who can come nearer: not converged where there is none to
  /// be found, `u` and `lambda` then as they were. For models that MixedIteration serves. Where the path of
  /// equilibria ends under a tool that touches and is outside of the body at rest, it may have left it: the
  /// body at rest is an equilibrium there.
  Relaxed from_near(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                    const RelaxOptions& options) const;
  bool has_mixed() const { return mixed_ != nullptr; }
  MixedIteration& mixed() const { return *mixed_; }  ///< of models that it serves

 private:
  // From where viscous steps have led: takes an equilibrium near u if there is one, and says so in `result`.
  void come_to_rest(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                    const RelaxOptions& options, Relaxed& result) const;
  Relaxed give_way(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                   const RelaxOptions& options) const;
  Relaxed relax_dynamically(ForceSystem::Nodal& u, ForceSystem::Nodal& f, const RelaxOptions& options,
                            std::int64_t evaluations) const;

  System& system_;
  mutable Eigen::VectorXd mass_;  // made when relax_dynamically() is first needed
  mutable std::unique_ptr<MixedIteration> mixed_;
};

/// [N] for each node a bound of what it is held with by all others: sum_b |K_ab|, K the tangent at rest
/// [N/m].
Eigen::VectorXd stiffness_row_sums(const ForceSystem& system, const Model& model);

/// Why there is none, in words.
SolveError no_equilibrium(const Relaxed& found, const Model& model);

}  // namespace dimple
