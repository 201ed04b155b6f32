#include "solver/stable_time_step.hpp"

#include <algorithm>
#include <cmath>

namespace dimple {

StableStep stable_time_step(const ForceSystem& system, const Eigen::VectorXd& mass,
                            const Constraints& constraints, const ForceSystem::Nodal& u,
                            ForceSystem::Nodal& mode) {
  const Index n = u.cols();
  const bool warm = mode.cols() == n;
  if (!warm) {
    // The stiffest modes alternate from node to node; the pattern only has to be in general position.
    mode.resize(4, n);
    for (Index a = 0; a < n; ++a) {
      const double s = std::sin(1.0 + 12.9898 * static_cast<double>(a)),
                   c = std::cos(2.0 + 78.233 * static_cast<double>(a));
      mode.col(a) << s, c, s * c, 0.0;
    }
  }
  for (Index a = 0; a < n; ++a) mode.col(a) = constraints.project(a, mode.col(a));

  ForceSystem::Nodal f0(4, n), f(4, n), moved(4, n);
  system.internal_force(u, f0);

  StableStep result;
  double omega2 = 0.0, before = 0.0;
  const int most = warm ? 60 : 400;
  int settled = 0;
  while (result.iterations < most && !result.converged) {
    ++result.iterations;
    const double largest = mode.cwiseAbs().maxCoeff();
    if (!(largest > 0.0) || !std::isfinite(largest)) break;  // nothing is free to move
    mode /= largest;
    const double step = 1e-8;  // m: nodes move by ten nanometres
    moved = u + step * mode;
    system.internal_force(moved, f);

    double rayleigh = 0.0, norm = 0.0;
    for (Index a = 0; a < n; ++a) {
      const Eigen::Vector4d Kw = constraints.project(a, (f.col(a) - f0.col(a)) / step);
      rayleigh += mode.col(a).dot(Kw);
      norm += mass[a] * mode.col(a).squaredNorm();
      mode.col(a) = Kw / mass[a];
    }
    omega2 = std::abs(rayleigh) / norm;
    settled = std::abs(omega2 - before) < 2e-4 * omega2 ? settled + 1 : 0;
    before = omega2;
    result.converged = settled >= 10;
  }
  result.dt = omega2 > 0.0 ? 2.0 / std::sqrt(omega2) : 0.0;
  return result;
}

}  // namespace dimple
