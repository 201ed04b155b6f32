#include "solver/equilibrium/stable_time_step.hpp"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <vector>

#include "io/stop.hpp"

// Lanczos iteration for the largest eigenvalue of M^-1/2 K M^-1/2:
// 1. Start vector q of the press direction and the directions from the tool, with factors that vary from node
//    to node.
// 2. w = M^-1/2 (f(u + e M^-1/2 q) - f(u)) / e, on what is free to move.
// 3. Orthogonalise w against the last two vectors; normalise it to the next q.
// 4. Every 5 steps: largest eigenvalue of the tridiagonal matrix, and its remainder. Stop at 0.2 %, or after
//    150 steps.
// 5. dt = 2 / sqrt(eigenvalue + remainder).
//
// Source:   Golub and Van Loan, section 10.1.
// Departs:  no reorthogonalisation; the remainder is added, so that the step errs to the short side.

namespace dimple {

StableStep stable_time_step(System& system, const Eigen::VectorXd& mass, const ForceSystem::Nodal& u) {
  const Model& model = system.model();
  const Constraints& constraints = system.held();
  constexpr int most = 150, between_checks = 5;
  // m: displacement for a difference of forces; float kernels round displacements at a tenth of a nanometre.
  const double nudge = system.tissue().system().precision() == Precision::single_ ? 1e-6 : 1e-8;
  const Index n = u.cols();
  const Eigen::RowVectorXd scale = mass.cwiseSqrt().cwiseInverse().transpose();

  ForceSystem::Nodal q = ForceSystem::Nodal::Zero(4, n), before = q, f0 = q, f = q, w = q;
  // The stiffest modes alternate from node to node; the start only has to be in general position.
  for (Index a = 0; a < n; ++a) {
    const double s = std::sin(1.0 + 12.9898 * static_cast<double>(a)),
                 c = std::cos(2.0 + 78.233 * static_cast<double>(a));
    const Vec3 from_tool = model.X.col(a) - model.tool.centre;
    Eigen::Vector4d start = s * padded(model.tool.approach);
    start.head<3>() += c * from_tool.normalized() + s * c * from_tool.cross(model.tool.approach).normalized();
    q.col(a) = constraints.project(a, start);
  }
  StableStep result;
  if (!(q.norm() > 0.0)) return result;
  q /= q.norm();
  system.force(u, f0);

  std::vector<double> alpha, beta;
  double omega2 = 0.0;
  while (result.iterations < most && !result.converged) {
    stop_if_requested();
    ++result.iterations;
    w = q.array().rowwise() * scale.array();
    const double step = nudge / w.cwiseAbs().maxCoeff();
    system.force(u + step * w, f);
    for (Index a = 0; a < n; ++a)
      w.col(a) = constraints.project(a, (f.col(a) - f0.col(a)) * (scale[a] / step));

    alpha.push_back(w.cwiseProduct(q).sum());
    w -= alpha.back() * q;
    if (!beta.empty()) w -= beta.back() * before;
    beta.push_back(w.norm());
    const bool exhausted = !(beta.back() > 1e-12 * std::abs(alpha.front()));
    if (result.iterations % between_checks == 0 || result.iterations == most || exhausted) {
      const Index k = static_cast<Index>(alpha.size());
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> tridiagonal;
      tridiagonal.computeFromTridiagonal(Eigen::Map<Eigen::VectorXd>(alpha.data(), k),
                                         Eigen::Map<Eigen::VectorXd>(beta.data(), k - 1));
      const double eigenvalue = tridiagonal.eigenvalues()[k - 1];
      const double remainder = std::abs(beta.back() * tridiagonal.eigenvectors()(k - 1, k - 1));
      omega2 = eigenvalue + remainder;
      result.converged = remainder < 2e-3 * eigenvalue;
      if (exhausted || !std::isfinite(omega2)) break;
    }
    before = q;
    q = w / beta.back();
  }
  result.dt = omega2 > 0.0 ? 2.0 / std::sqrt(omega2) : 0.0;
  return result;
}

double shear_crossing_time(const Tissues& tissues, const Model& model) {
  double speed = std::numeric_limits<double>::infinity();
  for (const Material& m : tissues.material) speed = std::min(speed, shear_wave_speed(m));
  const Eigen::VectorXd along = model.X.transpose() * model.tool.approach;
  return (along.maxCoeff() - along.minCoeff()) / speed;
}

}  // namespace dimple
