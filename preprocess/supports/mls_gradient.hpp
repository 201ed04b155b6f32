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
/// 1. Radii R_a times `growth`; scale R = mean of them. Basis p = [1, y], y = (X_a - x) / R.
/// 2. Weights w_a = w(|x - X_a| / R_a), w(s) = 1 - 6 s^2 + 8 s^3 - 3 s^4; sharper at prescribed nodes
///    (SupportOptions::interpolation).
/// 3. A = sum_a w_a p_a p_a^T, factorised as L D L^T; stops unless all pivots are positive.
/// 4. c = A^-1 p(x);   phi_a = w_a p_a . c
/// 5. dc/dx_r = A^-1 (dp/dx_r - dA/dx_r c);   dphi_a/dx_r = dw_a/dx_r p_a . c + w_a p_a . dc/dx_r
///
/// Every linear field is reproduced exactly; this is checked for every point of every model built. Source:
/// Horton et al. 2007, section 2.1 (theory of Lancaster & Salkauskas). Departs: the basis is centred at x and
/// scaled by the mean radius, so that conditioning does not depend on the unit of length. Returns the
/// conditioning of the moment matrix; phi and dphi are meaningful only if ok().
/// `pinned` [N]: 1 at prescribed nodes; empty: none.
MlsResult mls_shape_functions(const Vec3& x, const Points& X, std::span<const int> nodes,
                              const Eigen::VectorXd& radius, double growth, const SupportOptions& options,
                              std::span<const char> pinned, Eigen::VectorXd& phi, Points& dphi);

}  // namespace dimple
