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
  /// It bears no compression, but folds into wrinkles finer than any node. One that does bear it buckles
  /// between the nodes instead, beyond a compression of 2 / pi mu_tissue x spacing [N/m], and then hangs on
  /// where they are.
  bool wrinkles = true;
  double tension = 0.0;  ///< in all directions at rest [N/m], which the rest of the body does not feel there
};

/// Its energy, over the area A at rest of each triangle of the patch, which moves with the body's nodes:
///
///     A (h mu/2 (tr C + 1/det C - 3) + T/2 (tr C - 2)),   C = F^T F,  F [3x2] of the triangle's plane
///
/// One that wrinkles has the least energy that finer and finer wrinkles reach: with l1 the larger stretch,
/// that of a strip, which is free across, where l2 is below the strip's, and none where l1 is too.
///
/// Source:   Pipkin, The relaxed energy density for isotropic elastic membranes, IMA J. Appl. Math. 36, 1986.
///
/// For the preconditioner it is as stiff as its shear at rest, h mu + T.
std::unique_ptr<ForceTerm> membrane(Membrane film);

}  // namespace dimple
