#include "solver/equilibrium/pressure_schur.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/helpers/block.hpp"

namespace dimple::pressure_schur_test {
namespace {

Eigen::VectorXd some_numbers(Index count, double phase) {
  return Eigen::VectorXd::NullaryExpr(
      count, [phase](Index k) { return std::sin(phase + 2.3 * static_cast<double>(k)); });
}

class PressureSchurOfABlock : public testing::Test {
 protected:
  const Model model = testing_bodies::averaged_block();
  const ForceSystem forces{model, neo_hookean(210.0, 0.49, 1000.0)};
  System body{forces, model, make_constraints(model, Contact::bonded)};
  PressureSchur schur{body};
  const Index patches = model.patches.count();

  void undeformed() {
    const Nodal u = Nodal::Zero(4, model.node_count());
    Nodal f = u;
    body.force_at(u, Eigen::VectorXd::Zero(patches), f);
    schur.find_gradient();
  }
};

TEST_F(PressureSchurOfABlock, ChangesVolumesByTheTraceOfALinearField) {
  EXPECT_FALSE(schur.has_gradient());
  undeformed();
  EXPECT_TRUE(schur.has_gradient());
  Mat3 F = Mat3::Identity();
  F.diagonal() += Vec3(0.02, -0.005, 0.01);
  F(0, 1) = 0.03;
  const Eigen::VectorXd change = schur.volume_change(testing_bodies::affine(model, F));
  ASSERT_EQ(change.size(), patches);
  EXPECT_LT((change.array() - 0.025).abs().maxCoeff(), 1e-5);
}

// The work of a pressure on a displacement equals its work on that displacement's change of volume.
TEST_F(PressureSchurOfABlock, HasForcesThatAreAdjointToTheChangeOfVolume) {
  undeformed();
  const Nodal u = testing_bodies::random_displacement(model, 1e-3);
  const Eigen::VectorXd lambda = some_numbers(patches, 0.4), change = schur.volume_change(u);
  Nodal f = Nodal::Zero(4, model.node_count());
  schur.add_forces(lambda, f);
  EXPECT_NEAR(f.cwiseProduct(u).sum(), lambda.dot(change), 1e-10 * lambda.norm() * change.norm());
}

TEST_F(PressureSchurOfABlock, SolvesTheMassMatrixOverMuWithCompressibility) {
  const PressurePatches& p = model.patches;
  const Eigen::VectorXd bulk = Eigen::VectorXd::LinSpaced(patches, 3e3, 9e3);
  Eigen::MatrixXd S = Eigen::MatrixXd::Zero(patches, patches);
  for (Index q = 0; q < model.point_count(); ++q)
    for (int i = p.of_point.offset[q]; i < p.of_point.offset[q + 1]; ++i)
      for (int j = p.of_point.offset[q]; j < p.of_point.offset[q + 1]; ++j) {
        const int b = p.of_point.member[i], c = p.of_point.member[j];
        S(b, c) +=
            model.volume[q] * p.psi[i] * p.psi[j] / (forces.shear_modulus(q) * p.volume[b] * p.volume[c]);
      }
  S.diagonal() += bulk.cwiseProduct(p.volume).cwiseInverse();
  EXPECT_FALSE(schur.is_factorised());
  ASSERT_TRUE(schur.factorise(bulk));
  EXPECT_TRUE(schur.is_factorised());
  const Eigen::VectorXd x = some_numbers(patches, 0.4), y = some_numbers(patches, 1.1);
  EXPECT_LT((schur.apply(S * x) - x).norm(), 1e-9 * x.norm());
  const Eigen::VectorXd of_x = schur.apply(x), of_y = schur.apply(y);
  EXPECT_NEAR(y.dot(of_x), x.dot(of_y), 1e-10 * y.norm() * of_x.norm());
  EXPECT_GT(x.dot(of_x), 0.0);
  EXPECT_GT(y.dot(of_y), 0.0);
}

TEST_F(PressureSchurOfABlock, ReportsAMatrixThatIsNotPositiveDefinite) {
  EXPECT_FALSE(schur.factorise(Eigen::VectorXd::Constant(patches, -1e-3)));
  EXPECT_FALSE(schur.is_factorised());
  EXPECT_TRUE(schur.factorise(Eigen::VectorXd::Constant(patches, 1e4))) << "and another one is tried";
}

}  // namespace
}  // namespace dimple::pressure_schur_test
