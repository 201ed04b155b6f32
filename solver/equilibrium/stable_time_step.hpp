#pragma once

#include "solver/system.hpp"

namespace dimple {

/// The largest stable step of central differences at displacement u: 2 / omega_max.
struct StableStep {
  double dt = 0.0;         ///< [s]; 0 if nothing is free to move
  int iterations = 0;      ///< each is one force evaluation
  bool converged = false;  ///< omega_max is known to 0.1 %
};

/// omega_max^2 is the largest eigenvalue of M^-1/2 K M^-1/2, K the tangent at u, by the Lanczos iteration
/// over free components, with K w = (f(u + e w) - f(u)) / e from differences of the force.
///
/// The start consists of the press direction and of the directions from the tool: a rotated model gives the
/// same step. The remainder of the iteration is added to the eigenvalue, so that the step errs to the short
/// side.
///
/// Source:   Golub & Van Loan, Matrix Computations, section 10.1. The closed-form bound of Joldes et al. 2012
///           is safe too, but its step is 3 to 6 times smaller.
StableStep stable_time_step(System& system, const Eigen::VectorXd& mass, const ForceSystem::Nodal& u);

/// Shear-wave crossings of the body above which a load is slow, so that inertia is negligible.
constexpr double slow_load = 8.0;
/// Time of the slowest shear wave through the body along the press direction [s].
double shear_crossing_time(const Tissues& tissues, const Model& model);

}  // namespace dimple
