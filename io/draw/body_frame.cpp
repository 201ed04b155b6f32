#include "io/draw/body_frame.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace dimple {

BodyFrame body_frame(const Points& nodes, const Vec3& patch_centre, const Vec3& approach) {
  using Vec2 = Eigen::Vector2d;
  BodyFrame f;
  f.up = approach.allFinite() && approach.norm() > 1e-9 ? Vec3(-approach.normalized()) : Vec3::UnitZ();
  // Any two directions across `up`, from the axis least aligned with it.
  Index least = 0;
  f.up.cwiseAbs().minCoeff(&least);
  const Vec3 a = f.up.cross(Vec3::Unit(least)).normalized(), b = f.up.cross(a);

  Vec3 mean = Vec3::Zero();
  double count = 0.0;
  for (Index n = 0; n < nodes.cols(); ++n)
    if (nodes.col(n).allFinite()) mean += nodes.col(n), count += 1.0;
  mean /= std::max(count, 1.0);
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
  for (Index n = 0; n < nodes.cols(); ++n) {
    if (!nodes.col(n).allFinite()) continue;
    const Vec2 q((nodes.col(n) - mean).dot(a), (nodes.col(n) - mean).dot(b));
    spread += q * q.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(spread);
  const bool round = axes.eigenvalues()[1] < 1.05 * axes.eigenvalues()[0] || !(axes.eigenvalues()[1] > 0.0);
  const Vec2 longest = round ? Vec2(1.0, 0.0) : Vec2(axes.eigenvectors().col(1));
  f.broad = (longest[0] * a + longest[1] * b).normalized();
  f.front = f.broad.cross(f.up).normalized();

  // Front: the side with the contact patch, where the skin slopes toward the viewer. Without such a side, the
  // one that shows left, posterior or superior on the right.
  const double reach = std::sqrt(std::max(axes.eigenvalues()[0], 0.0) / std::max(count, 1.0));
  const double offset = patch_centre.allFinite() ? (patch_centre - mean).dot(f.front) : 0.0;
  Index main = 0;
  f.broad.cwiseAbs().maxCoeff(&main);
  const bool turn = std::abs(offset) > 0.1 * reach ? offset < 0.0 : f.broad[main] < 0.0;
  if (turn) f.broad = -f.broad, f.front = -f.front;
  return f;
}

}  // namespace dimple
