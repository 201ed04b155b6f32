#pragma once

#include "io/types.hpp"

namespace dimple {

/// The change of the friction forces in one step of an iteration, of the same nearby linear problem as
/// contact_step(), with the normal forces known: each force t_s lies in the tangent plane at its sample, is
/// no larger than its bound, and
///
///     slip_s + P_s sum_t compliance_st (t_t - before_t) = 0   where |t_s| < bound_s (it sticks),
///     opposite to t_s                                         where |t_s| = bound_s (it slips).
///
/// `compliance` [MxM] m/N, positive definite; `normal` [3xM] unit vectors, P_s = 1 - n n'; `slip` [3xM] m: in
/// the tangent planes, where nothing changes; `before` [3xM] N; `bound` [M] N: Coulomb's coefficient x the
/// normal force, zero: no friction. Returns the change [3xM] N. Sample after sample is
/// set to where its own force puts it and brought back into the cone, many times over: t_s from any start
/// within the cones comes closer with each.
///
/// Source:   Wriggers, Computational Contact Mechanics, 2006, sections 4.2 and 5.2 (Coulomb's law, return to
/// the cone); projected Gauss-Seidel iteration: Jourdan, Alart, Jean, Comput. Methods Appl. Mech. Engrg. 155,
/// 1998.
Points friction_step(const Eigen::MatrixXd& compliance, const Points& normal, const Points& slip,
                     const Points& before, const Eigen::VectorXd& bound);

}  // namespace dimple
