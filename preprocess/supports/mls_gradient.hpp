#pragma once

#include <span>

#include "io/types.hpp"
#include "preprocess/scheme.hpp"

namespace dimple {

/// Moving least squares at one place.
struct MlsResult {
  /// Smallest over largest pivot of the scaled moment matrix; near 0 where the nodes do not span the basis.
  double pivot_ratio = 0.0;
  bool ok() const { return pivot_ratio > 1e-5; }
};

/// Shape functions phi [n] and their gradients dphi [3xn, 1/m] at `x` from n nodes at X with radii `radius`.
///
///     w_a = w(|x - X_a| / R_a),  p = [1, y],  y = (X_a - x)/R,  A = sum_a w_a p_a p_a^T
///     phi_a = w_a p_a . A^-1 p(0)
///     d phi_a/dx_r = dw_a/dx_r p_a . c + w_a p_a . d c/dx_r,   c = A^-1 p(x)
///
/// Every linear field is reproduced exactly; this is checked for every point of every model built.
/// w is the quartic spline 1 - 6 s^2 + 8 s^3 - 3 s^4.
/// Source:   Horton et al. 2007, section 2.1 (theory of Lancaster & Salkauskas).
/// Departs:  the basis is centred at x and scaled by the mean radius, so that conditioning does not depend on
///           the unit of length.
/// Returns:  how well the moment matrix is conditioned; phi and dphi are meaningful only if ok().
/// `pinned` [N]: 1 at prescribed nodes; empty: none.
MlsResult mls_shape_functions(const Vec3& x, const Points& X, std::span<const int> nodes,
                              const Eigen::VectorXd& radius, double growth, const SupportOptions& options,
                              std::span<const char> pinned, Eigen::VectorXd& phi, Points& dphi);

}  // namespace dimple
