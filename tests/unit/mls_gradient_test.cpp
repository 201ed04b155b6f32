#include "preprocess/supports/mls_gradient.hpp"

#include <gtest/gtest.h>

#include <numeric>
#include <random>

namespace dimple {
namespace {

// A jittered lattice of unit spacing times `unit`, 7 nodes along each axis.
Points node_set(double unit) {
  std::mt19937 random(21);
  std::uniform_real_distribution<double> noise(-0.25, 0.25);
  Points X(3, 343);
  for (int a = 0; a < 343; ++a)
    X.col(a) = unit * (Vec3(a % 7, (a / 7) % 7, a / 49) + Vec3(noise(random), noise(random), noise(random)));
  return X;
}

struct Shape {
  std::vector<int> nodes;
  Eigen::VectorXd phi;
  Points dphi;
  MlsResult mls;
};

// Radii differ between nodes, as in a graded discretisation. All nodes are passed; those out of reach have
// zero weight.
Shape shape_at(const Vec3& x, const Points& X, double unit) {
  const SupportOptions options;
  Shape s;
  s.nodes.resize(static_cast<std::size_t>(X.cols()));
  std::iota(s.nodes.begin(), s.nodes.end(), 0);
  Eigen::VectorXd radius(X.cols());
  for (Index a = 0; a < X.cols(); ++a)
    radius[a] = unit * options.radius_factor * (1.2 + 0.2 * std::sin(static_cast<double>(a)));
  s.mls = mls_shape_functions(x, X, s.nodes, radius, 1.0, options, {}, s.phi, s.dphi);
  return s;
}

const Vec3 places[] = {{3.1, 2.9, 3.3}, {0.4, 0.3, 0.6}, {5.9, 3.0, 1.2}, {2.0, 5.5, 4.4}};

TEST(MlsGradient, ShapeFunctionsAreAPartitionOfUnityAndReproduceLinearFields) {
  const Points X = node_set(1.0);
  for (const Vec3& x : places) {
    const Shape s = shape_at(x, X, 1.0);
    ASSERT_TRUE(s.mls.ok());
    const Vec3 g(0.7, -1.3, 2.1);
    const Eigen::VectorXd field = (X.transpose() * g).array() + 0.4;
    EXPECT_NEAR(s.phi.sum(), 1.0, 1e-10);
    EXPECT_NEAR(s.phi.dot(field), g.dot(x) + 0.4, 1e-10 * field.cwiseAbs().maxCoeff());
    EXPECT_LT(s.dphi.rowwise().sum().norm(), 1e-10);
    EXPECT_LT((s.dphi * field - g).norm(), 1e-10 * field.cwiseAbs().maxCoeff());
  }
}

TEST(MlsGradient, GradientsAreTheDifferencesOfTheShapeFunctions) {
  const Points X = node_set(1.0);
  const double h = 1e-5;
  for (const Vec3& x : places) {
    const Shape s = shape_at(x, X, 1.0);
    for (int r = 0; r < 3; ++r) {
      const Shape plus = shape_at(x + h * Vec3::Unit(r), X, 1.0);
      const Shape minus = shape_at(x - h * Vec3::Unit(r), X, 1.0);
      const Eigen::VectorXd slope = (plus.phi - minus.phi) / (2.0 * h);
      // The truncation error is h^2 times a third derivative of order 100.
      EXPECT_LT((s.dphi.row(r).transpose() - slope).cwiseAbs().maxCoeff(),
                1e-6 * s.dphi.cwiseAbs().maxCoeff());
    }
  }
}

TEST(MlsGradient, TheUnitOfLengthDoesNotMatter) {
  const Points X = node_set(1.0), X_mm = node_set(1000.0);
  for (const Vec3& x : places) {
    const Shape m = shape_at(x, X, 1.0), mm = shape_at(1000.0 * x, X_mm, 1000.0);
    EXPECT_LT((m.phi - mm.phi).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LT((m.dphi - 1000.0 * mm.dphi).cwiseAbs().maxCoeff(), 1e-9 * m.dphi.cwiseAbs().maxCoeff());
    EXPECT_NEAR(m.mls.pivot_ratio, mm.mls.pivot_ratio, 1e-9 * m.mls.pivot_ratio);
  }
}

TEST(MlsGradient, ANodeAtThePlaceItselfGivesNumbers) {
  const Points X = node_set(1.0);
  const Shape s = shape_at(X.col(171), X, 1.0);
  EXPECT_TRUE(s.mls.ok());
  EXPECT_TRUE(s.dphi.allFinite());
  EXPECT_NEAR(s.phi.sum(), 1.0, 1e-10);
}

TEST(MlsGradient, NodesInOnePlaneOrTooFewAreNotOk) {
  Points X(3, 25);
  for (int a = 0; a < 25; ++a) X.col(a) = Vec3(a % 5, a / 5, 0.0);
  EXPECT_FALSE(shape_at(Vec3(2.2, 2.1, 0.0), X, 1.0).mls.ok());
  EXPECT_FALSE(shape_at(Vec3(2.2, 2.1, 0.3), X, 1.0).mls.ok());
  EXPECT_FALSE(shape_at(Vec3(0.2, 0.1, 0.0), X.leftCols(3), 1.0).mls.ok());
}

}  // namespace
}  // namespace dimple
