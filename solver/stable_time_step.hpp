#pragma once

#include "solver/constraints.hpp"

namespace dimple {

/// The largest stable step of central differences at displacement u: 2 / omega_max.
struct StableStep {
  double dt = 0.0;         ///< [s]
  int iterations = 0;      ///< of the power method; each is one force evaluation
  bool converged = false;  ///< the last ten iterations changed omega by less than 0.1 %
};

/// omega_max^2 is the largest eigenvalue of M^-1 K, K the tangent at u, found by the power method on
/// differences of the internal force, M^-1 K w = M^-1 (f(u + e w) - f(u)) / e, over what is not prescribed.
///
/// `mode` [N] is the start vector and receives the last iterate: handing it back makes the next estimate
/// cheap. An empty one starts from a fixed alternating pattern. Source:   methods of estimating the step from
/// the highest frequency; Belytschko, Liu, Moran, Nonlinear Finite
///           Elements, section 6.6. The closed-form bound of Joldes et al. 2012 is safe but 3 to 6 times
///           smaller.
StableStep stable_time_step(const ForceSystem& system, const Eigen::VectorXd& mass,
                            const Constraints& constraints, const ForceSystem::Nodal& u,
                            ForceSystem::Nodal& mode);

}  // namespace dimple
