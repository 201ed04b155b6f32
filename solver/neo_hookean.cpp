#include "solver/neo_hookean.hpp"

#include <Eigen/LU>
#include <cmath>

namespace dimple {

NeoHookean neo_hookean(double mu, double nu, double density, bool as_printed) {
  const double lambda = 2.0 * mu * nu / (1.0 - 2.0 * nu);
  return {.mu = mu, .kappa = lambda + 2.0 / 3.0 * mu, .density = density, .as_printed = as_printed};
}

double strain_energy(const NeoHookean& m, const Mat3& F) {
  const double J = F.determinant();
  return 0.5 * m.mu * (std::pow(J, -2.0 / 3.0) * F.squaredNorm() - 3.0) +
         0.5 * m.kappa * (J - 1.0) * (J - 1.0);
}

Mat3 pk1_stress(const NeoHookean& m, const Mat3& F) {
  const double J = F.determinant();
  const double shear = m.mu * std::pow(J, -2.0 / 3.0);
  const Mat3 cofactor = J * F.inverse().transpose();
  if (m.as_printed) return shear * F + (m.kappa - 2.0 / 3.0 * m.mu) * (J - 1.0) * cofactor;
  return shear * F + (m.kappa * (J - 1.0) - shear * F.squaredNorm() / (3.0 * J)) * cofactor;
}

Mat3 cauchy_stress(const NeoHookean& m, const Mat3& F) {
  return pk1_stress(m, F) * F.transpose() / F.determinant();
}

double pressure_wave_speed(const NeoHookean& m) {
  return std::sqrt((m.kappa + 4.0 / 3.0 * m.mu) / m.density);
}
double shear_wave_speed(const NeoHookean& m) {
  return std::sqrt(m.mu / m.density);
}

}  // namespace dimple
