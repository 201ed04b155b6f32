// Energy of the converging scheme and its forces.

#include "solver/terms/projected_kernel.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "io/error.hpp"
#include "solver/terms/internal_force.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/material.hpp"
#include "tests/helpers/report.hpp"

namespace dimple::projected_kernel_test {
namespace {

using namespace testing_bodies;
using Nodal = ForceSystem::Nodal;

int upper_half(const Vec3& x) {
  return x.z() > 10e-3;
}

Tissues soft_and_ogden(const Model& model) {
  return {{neo_hookean(210.0, 0.499, 1000.0), ogden({{500.0, -4.7}, {300.0, 3.0}}, 0.45, 1000.0)},
          model.label};
}

// Difference of (W(u + e v) - W(u - e v)) / 2e and f . v, relative to |f| |v|.
double error_of_gradient(const ForceSystem& system, const Nodal& u) {
  ForceState forces(system);
  Model shape;
  shape.X.resize(3, u.cols());
  const Nodal v = random_displacement(shape, 1.0, 11);
  Nodal f = u;
  forces.internal_force(u, f);
  const double e = 1e-7;
  const double slope = (forces.stored_energy(u + e * v) - forces.stored_energy(u - e * v)) / (2.0 * e);
  return std::abs(slope - f.cwiseProduct(v).sum()) / (f.norm() * v.norm());
}

TEST(ProjectedKernel, ForceIsTheGradientOfTheEnergy) {
  const Model model = averaged_block(), halves = averaged_block(6, 0.2, 1.8, upper_half);
  const ForceSystem system(model, neo_hookean(210.0, 0.499, 1000.0)),
      softer(model, neo_hookean(210.0, 0.49, 1000.0)), two(halves, soft_and_ogden(halves));
  const Nodal inside_out = random_displacement(model, 4e-3);
  Nodal f = inside_out;
  EXPECT_GT(ForceState(softer).internal_force(inside_out, f).inverted, 0);
  EXPECT_LT(error_of_gradient(softer, inside_out), 1e-7);
  EXPECT_LT(error_of_gradient(system, random_displacement(model, 0.3e-3)), 1e-7);
  EXPECT_LT(error_of_gradient(system, affine(model, Vec3(1.3, 1.1, 0.6).asDiagonal())), 1e-7);
  EXPECT_LT(error_of_gradient(two, random_displacement(halves, 0.3e-3)), 1e-7);
}

// Both loops are tested: that for any law, and that for neo-Hookean points alone.
TEST(ProjectedKernel, OfAMooneyRivlinBodyIsNeoHookeanWhereTheSecondInvariantHasNoPart) {
  const Model model = averaged_block();
  const ForceSystem plain(model, neo_hookean(210.0, 0.499, 1000.0)),
      other(model, mooney_rivlin(105.0, 0.0, 0.499, 1000.0)),
      both(model, mooney_rivlin(60.0, 45.0, 0.499, 1000.0));
  const Nodal u = random_displacement(model, 0.3e-3);
  const Nodal f = forces_at(plain, u);
  EXPECT_LT((f - forces_at(other, u)).norm(), 1e-10 * f.norm());
  EXPECT_LT(error_of_gradient(both, u), 1e-7);
}

TEST(ProjectedKernel, OfABodyMovedAsAWholeHasNoForce) {
  const Model model = averaged_block();
  const ForceSystem system(model, neo_hookean(210.0, 0.499, 1000.0));
  ForceState forces(system);
  const Mat3 turn = Eigen::AngleAxisd(1.1, Vec3(1.0, 2.0, -0.5).normalized()).toRotationMatrix();
  Nodal u = affine(model, turn);
  u.topRows<3>().colwise() += Vec3(0.01, -0.02, 0.03);
  Nodal f = u;
  forces.internal_force(u, f);
  EXPECT_LT(f.cwiseAbs().maxCoeff(), 1e-9 * 104930.0 * 1e-5);  // of kappa x the area of a cell
  EXPECT_LT(forces.stored_energy(u), 1e-12);
}

TEST(ProjectedKernel, OfAHomogeneousStretchHasItsStressEverywhere) {
  const Model model = averaged_block();
  const Material material = neo_hookean(210.0, 0.499, 1000.0);
  const ForceSystem system(model, material);
  ForceState forces(system);
  Mat3 F;
  F << 1.1, 0.05, 0.0, 0.0, 0.95, 0.02, 0.01, 0.0, 0.97;
  const Mat3 P = pk1_stress(material, F);
  forces.stress_sweep(affine(model, F));
  const auto stresses = forces.stresses();
  for (Index q = 0; q < model.point_count(); ++q)
    EXPECT_LT((Eigen::Map<const Mat3>(stresses.col(q).data()) - P).norm(), 1e-9 * P.norm());
  EXPECT_NEAR(forces.stored_energy(affine(model, F)), model.volume.sum() * strain_energy(material, F),
              1e-9 * model.volume.sum() * strain_energy(material, F));
}

TEST(ProjectedKernel, KeepsMomentumAndAngularMomentum) {
  const Model model = averaged_block();
  const ForceSystem system(model, neo_hookean(210.0, 0.499, 1000.0));
  const Nodal u = random_displacement(model, 0.5e-3), f = forces_at(system, u);
  Vec3 moment = Vec3::Zero();
  double size = 0.0;
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 x = model.X.col(a) + u.col(a).head<3>(), fa = f.col(a).head<3>();
    moment += x.cross(fa);
    size += x.norm() * fa.norm();
  }
  EXPECT_LT(f.rowwise().sum().norm(), 1e-12 * f.cwiseAbs().sum());
  EXPECT_LT(moment.norm(), 1e-12 * size);
}

TEST(GradientVariance, OfALinearFieldIsNothingAndOfAnyOtherIsPositive) {
  const Model model = averaged_block();
  ASSERT_EQ(model.variance.size(), 1u);
  const GradientVariance& v = model.variance[0];
  const auto apply = [&](const Eigen::RowVectorXd& u) {
    Eigen::RowVectorXd result = Eigen::RowVectorXd::Zero(u.size());
    for (Index a = 0; a < u.size(); ++a)
      for (int k = v.rows.offset[a]; k < v.rows.offset[a + 1]; ++k) result[a] += v.K[k] * u[v.rows.member[k]];
    return result;
  };
  const double size = v.K.cwiseAbs().maxCoeff();
  for (int d = 0; d < 3; ++d) EXPECT_LT(apply(model.X.row(d)).cwiseAbs().maxCoeff(), 1e-12 * size);
  EXPECT_LT(apply(Eigen::RowVectorXd::Ones(model.node_count())).cwiseAbs().maxCoeff(), 1e-11 * size);
  const Eigen::RowVectorXd rough = random_displacement(model, 1.0).row(0);
  EXPECT_GT(rough.dot(apply(rough)), 0.0);
}

TEST(PressurePatches, DivideEveryPointWhollyAndTheVolumeOnce) {
  const Model model = averaged_block();
  const PressurePatches& p = model.patches;
  EXPECT_NEAR(static_cast<double>(p.count()), static_cast<double>(model.node_count()) / 7.0, 2.0);
  for (Index q = 0; q < model.point_count(); ++q)
    EXPECT_NEAR(p.psi.segment(p.of_point.offset[q], p.of_point.count(q)).sum(), 1.0, 1e-14);
  EXPECT_NEAR(p.volume.sum(), model.volume.sum(), 1e-12 * model.volume.sum());
  EXPECT_GT(p.volume.minCoeff(), 0.0);
}

TEST(PressurePatches, LieInOneTissueEach) {
  const Model model = averaged_block(6, 0.2, 1.8, upper_half);
  std::vector<int> tissue(static_cast<std::size_t>(model.patches.count()), -1);
  for (Index q = 0; q < model.point_count(); ++q)
    for (int k = model.patches.of_point.offset[q]; k < model.patches.of_point.offset[q + 1]; ++k) {
      int& of_patch = tissue[static_cast<std::size_t>(model.patches.of_point.member[k])];
      EXPECT_TRUE(of_patch < 0 || of_patch == model.label[q]);
      of_patch = model.label[q];
    }
}

TEST(Kernel, RefusesSupportsThatMeetMoreNodesThanItCanNumber) {
  Model model;
  model.scheme = horton2007;
  const Index points = points_per_block, nodes_of_each = 32768 / points + 1, nodes = points * nodes_of_each;
  model.X = Points::Zero(3, nodes);
  model.point = Points::Zero(3, points);
  model.volume = Eigen::VectorXd::Ones(points);
  model.support.offset = Eigen::VectorXi::LinSpaced(points + 1, 0, static_cast<int>(nodes));
  model.support.member = Eigen::VectorXi::LinSpaced(nodes, 0, static_cast<int>(nodes) - 1);
  model.dphi = Points::Zero(3, nodes);
  const Report report = report_of<SolveError>(
      [&] { const ForceSystem system(model, neo_hookean(210.0, 0.499, 1000.0), Precision::single_); });
  EXPECT_EQ(report.fact, "the supports of " + std::to_string(points) + " neighbouring points hold " +
                             std::to_string(nodes) + " nodes, and at most 32768 can be numbered");
  EXPECT_NE(report.remedy.find("support.radius_factor"), std::string::npos);
}

// At constant shape all resistance to a change of shape relaxes as the Prony series says, including that
// outside of mean gradients. The bulk modulus is so small that the patches have none of it.
TEST(Viscoelasticity, WhatMeanGradientsDoNotSeeRelaxesToo) {
  const Model model = averaged_block(4);
  const Nodal u = random_displacement(model, 1e-8);
  const auto force_after = [&](const Material& material, double step, int steps) {
    const ForceSystem system(model, material, Precision::double_);
    ForceState forces(system);
    Nodal f = u;
    for (int k = 0; k <= steps; ++k) {
      forces.begin_step(k == 0 ? 0.0 : step);
      forces.internal_force(u, f);
      forces.accept_step(u);
    }
    return f;
  };
  Material tissue = {.mu = 500.0, .kappa = 20.0, .density = 1000.0}, relaxed = tissue;
  tissue.prony = {{.g = 0.6, .tau = 1.0}};
  relaxed.mu *= 0.4 + 0.6 * std::exp(-0.75);
  const Nodal known = force_after(relaxed, 0.0, 0), ours = force_after(tissue, 0.25, 3);
  EXPECT_LT((ours - known).norm(), 1e-4 * known.norm());
}

}  // namespace
}  // namespace dimple::projected_kernel_test
