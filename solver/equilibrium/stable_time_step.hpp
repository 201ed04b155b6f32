#pragma once

#include "solver/system.hpp"

namespace dimple {

/// The largest stable step of central differences at displacement u: 2 / omega_max.
struct StableStep {
  double dt = 0.0;         ///< [s]; 0 if nothing is free to move
  int iterations = 0;      ///< each is one force evaluation
  bool converged = false;  ///< omega_max is known to 0.1 %
};

/// omega_max^2 is the largest eigenvalue of M^-1/2 K M^-1/2, K the tangent at u, found by the Lanczos
/// iteration over what is not prescribed, with K w = (f(u + e w) - f(u)) / e from differences of the force.
///
/// The start is made of the push and of the directions from the tool: a turned model gives the same step.
/// The remainder of the iteration is added to the eigenvalue, so that the step errs to the short side.
/// Source:   Golub & Van Loan, Matrix Computations, section 10.1. The closed-form bound of Joldes et al. 2012
/// is safe
///           too, but the step is then 3 to 6 times smaller.
StableStep stable_time_step(System& system, const Eigen::VectorXd& mass, const ForceSystem::Nodal& u);

/// A load that lasts so many times as long as a shear wave's way through the body is slow: inertia plays no
/// part.
constexpr double slow_load = 8.0;
/// [s] that the slowest shear wave takes through the body along the tool's push.
double shear_crossing_time(const Tissues& tissues, const Model& model);

}  // namespace dimple
