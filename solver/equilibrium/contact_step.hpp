#pragma once

#include "io/types.hpp"

namespace dimple {

/// Change of the contact forces in one step of an iteration. It solves the linear problem in which a force at
/// one sample moves another by K, and neither forces nor gaps are negative,
///
///     lambda >= 0,   gap + K (lambda - lambda_before) >= 0,   one of both zero at every sample.
///
/// `compliance` [MxM] m/N: displacement of one sample by a unit force at another, equal in all directions,
/// positive definite; `normal` [3xM] of the forces, K_st = compliance_st n_s.n_t; `gap` [M] m before the
/// step; `before` [M] N, not negative. Returns the change [M] N.
///
/// Source:   primal-dual active set strategy: Hintermueller, Ito, Kunisch, SIAM J. Optim. 13, 2002. Where its
///           sets repeat, as they may for matrices that are no M-matrices, projected Gauss-Seidel sweeps,
///           which converge for every positive definite one (Cryer, SIAM J. Control 9, 1971).
Eigen::VectorXd contact_step(const Eigen::MatrixXd& compliance, const Points& normal,
                             const Eigen::VectorXd& gap, const Eigen::VectorXd& before);

}  // namespace dimple
