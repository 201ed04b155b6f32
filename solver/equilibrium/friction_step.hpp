#pragma once

#include "io/types.hpp"

namespace dimple {

/// Change of the friction forces in one step of an iteration, in the linear problem of contact_step() with
/// known normal forces. Each force t_s is in the tangent plane at its sample, is no larger than its bound,
/// and
///
///     slip_s + P_s sum_t compliance_st (t_t - before_t) = 0   where |t_s| < bound_s (no slip),
///     opposite to t_s                                         where |t_s| = bound_s (slip).
///
/// `compliance` [MxM] m/N, positive definite; `normal` [3xM] unit vectors, P_s = 1 - n n'; `slip` [3xM] m in
/// the tangent planes, before the step; `before` [3xM] N; `bound` [M] N: Coulomb's coefficient x the normal
/// force, zero without friction. Returns the change [3xM] N. Every round over the samples brings t_s closer,
/// from any start within the cones.
///
/// Source:   Wriggers, Computational Contact Mechanics, 2006, sections 4.2 and 5.2 (Coulomb's law, projection
///           onto the cone); Jourdan, Alart, Jean, Comput. Methods Appl. Mech. Engrg. 155, 1998 (projected
///           Gauss-Seidel iteration).
Points friction_step(const Eigen::MatrixXd& compliance, const Points& normal, const Points& slip,
                     const Points& before, const Eigen::VectorXd& bound);

}  // namespace dimple
