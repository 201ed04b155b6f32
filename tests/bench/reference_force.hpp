#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "preprocess/model.hpp"
#include "solver/material.hpp"

namespace dimple {

/// Plain implementation of the converging scheme's internal force: one contiguous array for each number,
/// lists in compressed rows, one thread, loop after loop. The product's kernel is measured and independently
/// checked against it. The energy is that of solver/terms/projected_kernel.hpp, for one elastic neo-Hookean
/// tissue.
///
///     ReferenceForce<double> reference(model, material);
///     set_displacement(reference, u);
///     evaluate(reference);
///     f = force_of(reference);
template <class Real>
struct ReferenceForce {
  struct Rows {
    std::vector<std::int32_t> offset, member;
    std::vector<Real> weight;
  };

  ReferenceForce(const Model& model, const Material& material);

  Real mu, ks, bulk;  // [Pa]; bulk = kappa - ks
  /// The kernel's two chosen constants, repeated here so that a change of one there is noticed. At small
  /// strains neither has an effect, and only theory remains.
  Real beta = Real(1), smallest_J = Real(0.05);
  std::vector<std::int32_t> offset, node;    // row q: the nodes of point q
  std::vector<Real> dphi_x, dphi_y, dphi_z;  // [pairs] 1/m
  std::vector<Real> volume;                  // [Q] m^3
  Rows of_point;                             // row q: patches, psi
  Rows of_patch;                             // row b: points, psi V / V_b
  Rows variance;                             // row a: nodes, K [m]

  std::vector<Real> u_x, u_y, u_z;  // [N] m
  std::vector<Real> f_x, f_y, f_z;  // [N] N

  std::array<std::vector<Real>, 9> H, VP;              // [Q] F - I and V P [N m], row by row
  std::vector<Real> dilation, pressure, unresolved;    // [Q]
  std::vector<Real> patch_dilation, patch_unresolved;  // [patches]
};

/// Computes f_x, f_y, f_z from u_x, u_y, u_z.
void evaluate(ReferenceForce<float>& reference);
void evaluate(ReferenceForce<double>& reference);

/// Conversions from and to [4xN] as in ForceSystem.
template <class Real>
void set_displacement(ReferenceForce<Real>& reference, const Eigen::Matrix4Xd& u);
template <class Real>
Eigen::Matrix4Xd force_of(const ReferenceForce<Real>& reference);

}  // namespace dimple
