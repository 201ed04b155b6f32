#include "solver/internal_force.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/LU>

#include "tests/helpers/block.hpp"

namespace dimple {
namespace {

using namespace testing_bodies;
using Nodal = ForceSystem::Nodal;

const Material tissue = neo_hookean(210.0, 0.499, 1000.0);

// The first `count` points of a model: the sweep takes four at once, and a block of 128 at a time.
Model first_points(const Model& whole, Index count) {
  Model part = whole;
  part.point.conservativeResize(3, count);
  part.volume.conservativeResize(count);
  part.support.offset.conservativeResize(count + 1);
  part.support.member.conservativeResize(part.support.offset[count]);
  part.dphi.conservativeResize(3, part.support.offset[count]);
  return part;
}

// The same force point by point with the plain formulas of the material.
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
  const Model whole = block(4);
  const Nodal u = random_displacement(whole, 3e-4);
  for (const bool printed : {false, true})
    for (const Index count : {1, 2, 3, 4, 5, 127, 128, 129, 131}) {
      SCOPED_TRACE(count);
      const Model model = first_points(whole, count);
      Material material = tissue;
      if (printed) material.law = PrintedNeoHookean{};
      const ForceSystem system(model, material);
      EXPECT_EQ(system.point_count(), count);
      EXPECT_EQ(system.pair_count(), model.support.member.size());
      Nodal f = Nodal::Constant(4, model.node_count(), 7.0);  // what was there before does not matter
      EXPECT_TRUE(system.internal_force(u, f).ok());
      EXPECT_LT((f - plain_force(model, material, u)).cwiseAbs().maxCoeff(), 1e-12 * force_scale(model));
      EXPECT_EQ(f.row(3).cwiseAbs().maxCoeff(), 0.0);  // the padding
    }
}

TEST(InternalForce, VanishesAtRestAndUnderATranslation) {
  const Model model = block(5);
  const ForceSystem system(model, tissue);
  Nodal u = Nodal::Zero(4, model.node_count()), f = u;
  system.internal_force(u, f);
  EXPECT_LT(f.cwiseAbs().maxCoeff(), 1e-14 * force_scale(model));
  u.topRows<3>().colwise() += Vec3(0.3, -0.1, 0.2);  // ten times the body; digits of the sum of dphi are lost
  system.internal_force(u, f);
  EXPECT_LT(f.cwiseAbs().maxCoeff(), 1e-10 * force_scale(model));
}

TEST(InternalForce, TurnsWithTheBody) {
  const Model model = block(4);
  const ForceSystem system(model, tissue);
  const Mat3 R = (Mat3() << 0, -1, 0, 1, 0, 0, 0, 0, 1).finished();
  const Nodal u = random_displacement(model, 3e-4);
  Nodal f = u, f_turned = u;
  system.internal_force(u, f);
  const Points turned = R * (model.X + u.topRows<3>()) - model.X;
  system.internal_force(to_nodal(turned), f_turned);
  EXPECT_LT((f_turned.topRows<3>() - R * f.topRows<3>()).cwiseAbs().maxCoeff(), 1e-10 * force_scale(model));
}

TEST(InternalForce, IsTheGradientOfTheStoredEnergyInRandomDirections) {
  const Model model = block(4);
  const ForceSystem system(model, tissue);
  const Nodal u = random_displacement(model, 2e-4);
  Nodal f = u;
  system.internal_force(u, f);
  for (const unsigned seed : {1u, 2u, 3u}) {
    const Nodal w = random_displacement(model, 1.0, seed);
    const double h = 1e-9;  // m; central differences keep some six digits
    const double slope = (system.stored_energy(u + h * w) - system.stored_energy(u - h * w)) / (2.0 * h);
    EXPECT_NEAR(f.cwiseProduct(w).sum(), slope, 1e-6 * f.norm() * w.norm());
  }
}

TEST(InternalForce, ReportsTheSmallestVolumeRatioAndWhereItIs) {
  const Model model = block(5);
  const ForceSystem system(model, tissue);
  const Nodal u = random_displacement(model, 3e-4);
  const auto F = system.deformation_gradients(u);
  double least = 2.0;
  Index where = -1;
  for (Index q = 0; q < F.cols(); ++q)
    if (const double J = Eigen::Map<const Mat3>(F.col(q).data()).determinant(); J < least)
      least = J, where = q;
  const ForceSystem::Sweep sweep = system.stress_sweep(u);
  ASSERT_LT(least, 1.0);
  EXPECT_EQ(sweep.point, where);
  EXPECT_NEAR(sweep.J_min, least, 1e-13);
}

// One point, in each lane and in a lane beside the last whole four, is turned inside out or made not a
// number.
TEST(InternalForce, ReportsTheBadPointInsteadOfThrowingWhereverItIs) {
  const Model whole = first_points(block(4), 131);
  for (const Index bad : {0, 1, 2, 3, 64, 127, 128, 130})
    for (const double spoilt : {-1e9, std::nan(""), std::numeric_limits<double>::infinity()}) {
      SCOPED_TRACE(testing::Message() << "point " << bad << ", " << spoilt);
      Model model = whole;
      // A displacement of the form x -> stretch along x: a gradient of this point alone that is far too
      // large.
      for (int k = model.support.offset[bad]; k < model.support.offset[bad + 1]; ++k)
        model.dphi.col(k) *= spoilt;
      const ForceSystem system(model, tissue);
      Nodal f = Nodal::Zero(4, model.node_count());
      const ForceSystem::Sweep sweep =
          system.internal_force(affine(model, Vec3(1.001, 1.0, 1.0).asDiagonal()), f);
      EXPECT_FALSE(sweep.ok());
      EXPECT_EQ(sweep.point, bad);
      EXPECT_EQ(std::isfinite(sweep.J_min), std::isfinite(spoilt));
    }
}

TEST(InternalForce, ABadPointCarriesNoStressAndLeavesTheOthersTheirs) {
  const Model model = first_points(block(4), 3);
  const ForceSystem system(model, tissue);
  Model spoilt = model;
  for (int k = spoilt.support.offset[1]; k < spoilt.support.offset[2]; ++k) spoilt.dphi.col(k) *= -1e6;
  const Nodal u = affine(model, Vec3(1.001, 1.0, 1.0).asDiagonal());
  Model without = model;
  without.volume[1] = 0.0;
  Nodal f = u, f_without = u;
  EXPECT_FALSE(ForceSystem(spoilt, tissue).internal_force(u, f).ok());
  ForceSystem(without, tissue).internal_force(u, f_without);
  EXPECT_EQ(f, f_without);
}

TEST(InternalForce, IsBitwiseEqualForAnyNumberOfThreads) {
  const Model model = block(6);
  const ForceSystem system(model, tissue);
  const Nodal u = random_displacement(model, 2e-4);
  std::vector<Nodal> forces;
  std::vector<ForceSystem::Sweep> sweeps;
  for (const std::size_t threads : {1, 2, 3}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    forces.push_back(u);
    sweeps.push_back(system.internal_force(u, forces.back()));
  }
  for (std::size_t k : {1, 2}) {
    EXPECT_EQ(forces[0], forces[k]);
    EXPECT_EQ(sweeps[0].J_min, sweeps[k].J_min);
    EXPECT_EQ(sweeps[0].point, sweeps[k].point);
  }
}

TEST(InternalForce, TheGatherVisitsEveryNodeOnce) {
  const Model model = block(6);
  const ForceSystem system(model, tissue);
  const Nodal u = random_displacement(model, 2e-4);
  Nodal f = u, expected = u;
  system.internal_force(u, expected);
  std::vector<int> visits(static_cast<std::size_t>(model.node_count()), 0);
  system.stress_sweep(u);
  system.gather_sweep(f, [&](Index first, Index last) {
    for (Index a = first; a < last; ++a) {
      ++visits[static_cast<std::size_t>(a)];
      EXPECT_EQ(f.col(a), expected.col(a));
    }
  });
  EXPECT_EQ(visits, std::vector<int>(visits.size(), 1));
}

// A microstrain: det F - 1 computed as such would lose ten of sixteen digits, and kappa multiplies the rest.
TEST(InternalForce, KeepsItsDigitsNearRest) {
  const Model model = block(4);
  const ForceSystem system(model, tissue);
  const Nodal u = random_displacement(model, 1e-12);
  Nodal f = u, f_twice = u;
  system.internal_force(u, f);
  system.internal_force(2.0 * u, f_twice);
  EXPECT_LT((f_twice - 2.0 * f).norm(), 1e-6 * f.norm());
}

}  // namespace
}  // namespace dimple
