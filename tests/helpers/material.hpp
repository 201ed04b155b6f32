#pragma once

#include <Eigen/LU>

#include "solver/material.hpp"

namespace dimple::testing_bodies {

/// Strain energy density [J/m^3] of instantaneous loading: of distortion, and kappa/2 (J - 1)^2.
inline double strain_energy(const Material& material, const Mat3& F) {
  const double dilation = F.determinant() - 1.0;
  return distortional_energy(material, F) + 0.5 * material.kappa * dilation * dilation;
}

}  // namespace dimple::testing_bodies
