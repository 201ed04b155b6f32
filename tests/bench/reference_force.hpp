#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "preprocess/model.hpp"
#include "solver/material.hpp"

namespace dimple {

/// The converging scheme's internal force written down plainly, as one would first: one contiguous array for
/// each number, lists in compressed rows, one thread, loop after loop. What the product's kernel is measured
/// against, and an independent check of it. The energy is that of solver/terms/projected_kernel.hpp; one
/// elastic neo-Hookean tissue.
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
  /// The kernel's two choices, typed here a second time so that changing one of them there is noticed. Where
  /// strains are small neither counts, and what is left is theory.
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

/// f_x, f_y, f_z from u_x, u_y, u_z.
void evaluate(ReferenceForce<float>& reference);
void evaluate(ReferenceForce<double>& reference);

/// From and to [4xN] as ForceSystem has it.
template <class Real>
void set_displacement(ReferenceForce<Real>& reference, const Eigen::Matrix4Xd& u);
template <class Real>
Eigen::Matrix4Xd force_of(const ReferenceForce<Real>& reference);

}  // namespace dimple
