#pragma once

#include "io/types.hpp"

namespace dimple {

/// The change of contact forces in one step of an iteration: of the nearby linear problem in which a force at
/// one sample moves another by K, and the forces are never negative and the gaps neither,
///
///     lambda >= 0,   gap + K (lambda - lambda_before) >= 0,   one of both zero at every sample.
///
/// `compliance` [MxM] m/N: how far a unit force at one place moves another, for each direction alike,
/// positive definite; `normal` [3xM]: of the forces, K_st = compliance_st n_s.n_t; `gap` [M] m: where nothing
/// changes; `before` [M] N, not negative. Returns the change [M] N.
///
/// Source:   primal-dual active set strategy: Hintermueller, Ito, Kunisch, SIAM J. Optim. 13, 2002. Where its
///           sets repeat, as they may for matrices that are no M-matrices, projected Gauss-Seidel sweeps,
///           which converge for every positive definite one (Cryer, SIAM J. Control 9, 1971).
Eigen::VectorXd contact_step(const Eigen::MatrixXd& compliance, const Points& normal,
                             const Eigen::VectorXd& gap, const Eigen::VectorXd& before);

}  // namespace dimple
