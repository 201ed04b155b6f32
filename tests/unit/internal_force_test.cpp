#include "solver/terms/internal_force.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/LU>

#include "tests/helpers/block.hpp"

namespace dimple::internal_force_test {
namespace {

using namespace testing_bodies;
using Nodal = ForceSystem::Nodal;

const Material tissue = neo_hookean(210.0, 0.499, 1000.0);

// Model with the first `count` points. The sweep takes four or eight at once, points_at_once from their nodes
// and back, and a block of points_per_block at a time.
Model first_points(const Model& whole, Index count) {
  Model part = whole;
  part.point.conservativeResize(3, count);
  part.volume.conservativeResize(count);
  part.support.offset.conservativeResize(count + 1);
  part.support.member.conservativeResize(part.support.offset[count]);
  part.dphi.conservativeResize(3, part.support.offset[count]);
  return part;
}

// Internal force, point by point, from the plain formulas of the material.
Nodal plain_force(const Model& model, const Material& material, const Nodal& u) {
  Nodal f = Nodal::Zero(4, model.node_count());
  for (Index q = 0; q < model.point_count(); ++q) {
    Mat3 F = Mat3::Identity();
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
      F += u.col(model.support.member[k]).head<3>() * model.dphi.col(k).transpose();
    const Mat3 VP = model.volume[q] * pk1_stress(material, F);
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
      f.col(model.support.member[k]).head<3>() += VP * model.dphi.col(k);
  }
  return f;
}

double force_scale(const Model& model) {
  return tissue.kappa * model.volume.maxCoeff() * model.dphi.colwise().norm().maxCoeff();
}

TEST(InternalForce, IsThePlainFormulaForAnyNumberOfPoints) {
  const Model whole = block(5);
  ASSERT_GT(whole.point_count(), points_per_block + 3);
  const Nodal u = random_displacement(whole, 3e-4);
  for (const bool printed : {false, true})
    for (const Index count : {Index{1}, Index{2}, Index{3}, Index{4}, Index{5}, Index{7}, Index{8}, Index{9},
                              points_at_once - 1, points_at_once, points_at_once + 1, points_per_block - 1,
                              points_per_block, points_per_block + 1, points_per_block + 3}) {
      SCOPED_TRACE(count);
      const Model model = first_points(whole, count);
      Material material = tissue;
      if (printed) material.law = PrintedNeoHookean{};
      const ForceSystem system(model, material);
      ForceState forces(system);
      EXPECT_EQ(system.point_count(), count);
      Nodal f = Nodal::Constant(4, model.node_count(), 7.0);  // what was there before does not matter
      EXPECT_TRUE(forces.internal_force(u, f).ok());
      EXPECT_LT((f - plain_force(model, material, u)).cwiseAbs().maxCoeff(), 1e-12 * force_scale(model));
      EXPECT_EQ(f.row(3).cwiseAbs().maxCoeff(), 0.0);  // the padding
    }
}

TEST(InternalForce, ReportsTheSmallestVolumeRatioAndWhereItIs) {
  const Model model = block(5);
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  const Nodal u = random_displacement(model, 3e-4);
  forces.stress_sweep(u);
  const auto F = forces.deformation_gradients();
  double least = 2.0;
  Index where = -1;
  for (Index q = 0; q < F.cols(); ++q)
    if (const double J = Eigen::Map<const Mat3>(F.col(q).data()).determinant(); J < least)
      least = J, where = q;
  const ForceSystem::Sweep sweep = forces.stress_sweep(u);
  ASSERT_LT(least, 1.0);
  EXPECT_EQ(sweep.point, where);
  EXPECT_NEAR(sweep.J_min, least, 1e-13);
}

// One point in each SIMD lane, or after the last full four, is turned inside out or made not a number.
TEST(InternalForce, ReportsTheBadPointInsteadOfThrowingWhereverItIs) {
  const Model whole = first_points(block(5), points_per_block + 3);
  ASSERT_EQ(whole.point_count(), points_per_block + 3);
  for (const Index bad : {Index{0}, Index{1}, Index{2}, Index{3}, points_per_block / 2, points_per_block - 1,
                          points_per_block, points_per_block + 2})
    for (const double spoilt : {-1e9, std::nan(""), std::numeric_limits<double>::infinity()}) {
      SCOPED_TRACE(testing::Message() << "point " << bad << ", " << spoilt);
      Model model = whole;
      // For a stretch along x, the gradient of this point alone is far too large.
      for (int k = model.support.offset[bad]; k < model.support.offset[bad + 1]; ++k)
        model.dphi.col(k) *= spoilt;
      const ForceSystem system(model, tissue);
      ForceState forces(system);
      Nodal f = Nodal::Zero(4, model.node_count());
      const ForceSystem::Sweep sweep =
          forces.internal_force(affine(model, Vec3(1.001, 1.0, 1.0).asDiagonal()), f);
      EXPECT_FALSE(sweep.ok());
      EXPECT_EQ(sweep.point, bad);
      EXPECT_EQ(std::isfinite(sweep.J_min), std::isfinite(spoilt));
    }
}

TEST(InternalForce, ABadPointCarriesNoStressAndLeavesTheOthersTheirs) {
  const Model model = first_points(block(4), 3);
  Model spoilt = model;
  for (int k = spoilt.support.offset[1]; k < spoilt.support.offset[2]; ++k) spoilt.dphi.col(k) *= -1e6;
  const Nodal u = affine(model, Vec3(1.001, 1.0, 1.0).asDiagonal());
  Model without = model;
  without.volume[1] = 0.0;
  Nodal f = u, f_without = u;
  const ForceSystem with_a_bad_one(spoilt, tissue), with_two(without, tissue);
  EXPECT_FALSE(ForceState(with_a_bad_one).internal_force(u, f).ok());
  ForceState(with_two).internal_force(u, f_without);
  EXPECT_EQ(f, f_without);
}

// One system serves any number of states, which do not affect each other.
TEST(InternalForce, IsAFunctionOfTheDisplacementAndTheStateAlone) {
  const Model model = averaged_block(5);
  Material relaxing = neo_hookean(842.0, 0.49, 1000.0);
  relaxing.prony = {{.g = 0.45, .tau = 0.5}};
  const ForceSystem system(model, relaxing);
  const Nodal u = random_displacement(model, 2e-4);
  ForceState first(system), second(system);
  Nodal f = u, g = u;
  first.begin_step(0.1);
  first.internal_force(u, f);
  first.accept_step(u);
  const ForceState kept = first;
  first.begin_step(0.2);
  first.accept_step(2.0 * u);
  first.hold_pressures(Eigen::VectorXd::Constant(model.patches.count(), 100.0));
  second.begin_step(0.1);
  second.internal_force(u, g);
  EXPECT_EQ(f, g);
  second.accept_step(u);
  EXPECT_EQ(second.past(), kept.past());
  EXPECT_NE(second.past(), first.past());
  ForceState copy = kept;
  copy.begin_step(0.1);
  second.begin_step(0.1);
  copy.internal_force(2.0 * u, f);
  second.internal_force(2.0 * u, g);
  EXPECT_EQ(f, g);
}

TEST(InternalForce, IsBitwiseEqualForAnyNumberOfThreads) {
  const Model model = block(8);
  ASSERT_GT(model.point_count(), 6 * points_per_block);  // threads take two blocks at a time: work for three
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  const Nodal u = random_displacement(model, 2e-4);
  std::vector<Nodal> found;
  std::vector<ForceSystem::Sweep> sweeps;
  for (const std::size_t threads : {1, 2, 3}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    found.push_back(u);
    sweeps.push_back(forces.internal_force(u, found.back()));
  }
  for (std::size_t k : {1, 2}) {
    EXPECT_EQ(found[0], found[k]);
    EXPECT_EQ(sweeps[0].J_min, sweeps[k].J_min);
    EXPECT_EQ(sweeps[0].point, sweeps[k].point);
  }
}

TEST(InternalForce, TheGatherVisitsEveryNodeOnce) {
  const Model model = block(6);
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  const Nodal u = random_displacement(model, 2e-4);
  Nodal f = u, expected = u;
  forces.internal_force(u, expected);
  std::vector<int> visits(static_cast<std::size_t>(model.node_count()), 0);
  forces.stress_sweep(u);
  forces.gather_sweep(f, [&](Index first, Index last) {
    for (Index a = first; a < last; ++a) {
      ++visits[static_cast<std::size_t>(a)];
      EXPECT_EQ(f.col(a), expected.col(a));
    }
  });
  EXPECT_EQ(visits, std::vector<int>(visits.size(), 1));
}

// For a microstrain the plain det F - 1 would lose ten of sixteen digits, and kappa amplifies the error.
TEST(InternalForce, KeepsItsDigitsNearRest) {
  const Model model = block(4);
  const ForceSystem system(model, tissue);
  const Nodal u = random_displacement(model, 1e-12), f = forces_at(system, u);
  EXPECT_LT((forces_at(system, 2.0 * u) - 2.0 * f).norm(), 1e-6 * f.norm());
}

}  // namespace
}  // namespace dimple::internal_force_test
