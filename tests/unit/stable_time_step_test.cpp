#include "solver/stable_time_step.hpp"

#include <gtest/gtest.h>

#include "tests/helpers/block.hpp"

namespace dimple {
namespace {

using namespace testing_bodies;
using Nodal = ForceSystem::Nodal;
using Kind = Constraints::Kind;

const Material tissue = neo_hookean(210.0, 0.49, 1000.0);

TEST(Constraints, HoldTheBaseAndDriveTheCircle) {
  const Model model = block(5);
  const Constraints bonded = make_constraints(model, Contact::bonded);
  const Constraints frictionless = make_constraints(model, Contact::frictionless);
  for (Index a = 0; a < model.node_count(); ++a) {
    const auto at = static_cast<std::size_t>(a);
    const bool base = std::find(model.base.begin(), model.base.end(), a) != model.base.end();
    const bool circle = std::find(model.indenter.begin(), model.indenter.end(), a) != model.indenter.end();
    EXPECT_EQ(bonded.kind[at], base ? Kind::fixed : circle ? Kind::driven : Kind::free);
    EXPECT_EQ(frictionless.kind[at], base ? Kind::fixed : circle ? Kind::sliding : Kind::free);
  }
}

TEST(Constraints, ProjectLeavesWhatIsNotPrescribed) {
  Constraints c;
  c.kind = {Kind::free, Kind::fixed, Kind::driven, Kind::sliding};
  c.push << Vec3(1, 2, -2) / 3.0, 0.0;
  const Eigen::Vector4d v(0.3, -0.7, 1.1, 0.0);
  EXPECT_EQ(c.project(0, v), v);
  EXPECT_EQ(c.project(1, v), Eigen::Vector4d::Zero());
  EXPECT_EQ(c.project(2, v), Eigen::Vector4d::Zero());
  EXPECT_NEAR(c.project(3, v).dot(c.push), 0.0, 1e-15);
  EXPECT_LT((c.project(3, c.project(3, v)) - c.project(3, v)).norm(), 1e-15);
  EXPECT_LT((c.project(3, v) + c.push * v.dot(c.push) - v).norm(), 1e-15);
}

StableStep step_of(const Model& model, const Material& material) {
  const ForceSystem system(model, material);
  return stable_time_step(system, model, model.mass, make_constraints(model, Contact::bonded),
                          Nodal::Zero(4, model.node_count()));
}

TEST(StableTimeStep, ScalesWithTheWaveSpeedAndTheSize) {
  const Model model = block(5);
  const double dt = step_of(model, tissue).dt;
  // Four times as stiff: waves are twice as fast.
  EXPECT_NEAR(step_of(model, neo_hookean(840.0, 0.49, 1000.0)).dt, 0.5 * dt, 1e-3 * dt);
  Model heavy = model;
  heavy.mass *= 4.0;
  EXPECT_NEAR(step_of(heavy, tissue).dt, 2.0 * dt, 1e-3 * dt);
  Model large = model;
  large.X *= 3.0;
  large.tool.centre *= 3.0;
  large.dphi /= 3.0;
  large.volume *= 27.0;
  large.mass *= 27.0;
  EXPECT_NEAR(step_of(large, tissue).dt, 3.0 * dt, 3e-3 * dt);
}

TEST(StableTimeStep, IsOfTheOrderOfTheTimeAWaveTakesFromNodeToNode) {
  const Model model = block(5);
  const StableStep step = step_of(model, tissue);
  const double wave = model.spacing[0] / pressure_wave_speed(tissue);
  EXPECT_TRUE(step.converged);
  EXPECT_GT(step.dt, 0.5 * wave);
  EXPECT_LT(step.dt, 5.0 * wave);
}

TEST(StableTimeStep, IsZeroWhereNothingCanMove) {
  const Model model = block(3);
  const ForceSystem system(model, tissue);
  Constraints constraints = make_constraints(model, Contact::bonded);
  for (auto& kind : constraints.kind) kind = Kind::fixed;
  EXPECT_EQ(stable_time_step(system, model, model.mass, constraints, Nodal::Zero(4, model.node_count())).dt,
            0.0);
}

TEST(StableTimeStep, ShrinksWhereTheTissueIsPressedTogether) {
  const Model model = block(5);
  const ForceSystem system(model, tissue);
  const Constraints constraints = make_constraints(model, Contact::bonded);
  const double at_rest =
      stable_time_step(system, model, model.mass, constraints, Nodal::Zero(4, model.node_count())).dt;
  const double pressed = stable_time_step(system, model, model.mass, constraints,
                                          affine(model, Vec3(1.29, 1.29, 0.6).asDiagonal()))
                             .dt;
  EXPECT_LT(pressed, 0.9 * at_rest);
}

}  // namespace
}  // namespace dimple
