#pragma once

#include <string>

#include "preprocess/supports/surface_patch.hpp"
#include "solver/terms/force_term.hpp"

namespace dimple {

/// A thin film that is bonded to a part of a body's surface: incompressible neo-Hookean tissue in plane
/// stress, without bending.
struct Membrane {
  std::string name = {};
  SurfacePatch patch;
  double thickness = 0.0;      ///< at rest [m]
  double shear_modulus = 0.0;  ///< [Pa]
  /// It bears no compression, but wrinkles finer than any node. If it does bear compression it buckles
  /// between the nodes, beyond 2 / pi mu_tissue x spacing [N/m], and the result depends on the nodes.
  bool wrinkles = true;
  double tension = 0.0;  ///< in all directions at rest [N/m]; the tissue there is free of stress
};

/// Membrane. Its energy, over the area A at rest of each triangle of the patch, which moves with the body's
/// nodes:
///
///     A (h mu/2 (tr C + 1/det C - 3) + T/2 (tr C - 2)),   C = F^T F,  F [3x2] of the triangle's plane
///
/// A wrinkling membrane has the least energy of ever finer wrinkles. With l1 the larger stretch it is that of
/// a strip free across, if l2 is below the strip's, and none if the strip is slack.
///
/// Source:   Pipkin, The relaxed energy density for isotropic elastic membranes, IMA J. Appl. Math. 36, 1986.
///
/// The preconditioner uses its shear stiffness at rest, h mu + T.
std::unique_ptr<ForceTerm> membrane(Membrane film);

}  // namespace dimple
