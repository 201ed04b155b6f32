#pragma once

#include "io/types.hpp"

namespace dimple {

/// Isotropic, nearly incompressible neo-Hookean solid.
struct NeoHookean {
  double mu = 210.0;        ///< shear modulus [Pa], > 0
  double kappa = 104930.0;  ///< bulk modulus [Pa], > 0
  double density = 1000.0;  ///< at rest [kg/m^3]
  /// The stress exactly as Horton et al. 2007 print it, for comparison: not zero at rest.
  bool as_printed = false;
};

/// kappa = lambda + 2/3 mu with lambda = 2 mu nu / (1 - 2 nu).
NeoHookean neo_hookean(double mu, double nu, double density, bool as_printed = false);

/// Stored energy per reference volume [J/m^3] at deformation gradient F.
///
///     W = mu/2 (J^(-2/3) tr C - 3) + kappa/2 (J - 1)^2        C = F^T F, J = det F
///
/// Needs: det F > 0.
double strain_energy(const NeoHookean& material, const Mat3& F);

/// First Piola-Kirchhoff stress P = F S [Pa], S the second.
///
///     S = 2 dW/dC = mu J^(-2/3) (I - tr(C)/3 C^-1) + kappa J (J - 1) C^-1
///     P = F S     = mu J^(-2/3) F + [kappa (J - 1) - mu J^(-2/3) tr(C) / (3 J)] cof F,   cof F = J F^-T
///
/// Source:   Horton et al. 2007, section 3.3.
/// Departs:  the paper prints W with lambda (J - 1)^2, and S = lambda J (J - 1) C^-1 + mu J^(-2/3) I. That S
/// equals
///           mu I at F = I, so a body at rest would be under stress, and it is not 2 dW/dC of the printed W,
///           nor of any W. We take the stress of the W above; `as_printed` gives the paper's.
/// Needs:    det F > 0. internal_force() reports a point where it is not; this does not test.
/// Checked:  against finite differences of W.
Mat3 pk1_stress(const NeoHookean& material, const Mat3& F);

/// Cauchy stress sigma = P F^T / J [Pa].
Mat3 cauchy_stress(const NeoHookean& material, const Mat3& F);

/// sqrt((kappa + 4/3 mu) / density) and sqrt(mu / density) [m/s].
double pressure_wave_speed(const NeoHookean& material);
double shear_wave_speed(const NeoHookean& material);

}  // namespace dimple
