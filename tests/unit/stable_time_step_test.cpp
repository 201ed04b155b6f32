#include "solver/equilibrium/stable_time_step.hpp"

#include <gtest/gtest.h>

#include "tests/helpers/block.hpp"
#include "tests/helpers/system.hpp"

namespace dimple::stable_time_step_test {
namespace {

using namespace testing_bodies;
using Nodal = ForceSystem::Nodal;

const Material tissue = neo_hookean(210.0, 0.49, 1000.0);

StableStep step_of(const Model& model, const Material& material) {
  const ForceSystem system(model, material);
  ForceState forces(system);
  return testing_bodies::stable_step(forces.system(), model, model.mass,
                                     make_constraints(model, Contact::bonded),
                                     Nodal::Zero(4, model.node_count()));
}

TEST(StableTimeStep, ScalesWithTheWaveSpeedAndTheSize) {
  const Model model = block(5);
  const double dt = step_of(model, tissue).dt;
  // At four times the stiffness waves are twice as fast.
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

TEST(StableTimeStep, IsZeroWhereNothingCanMove) {
  const Model model = block(3);
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  HeldSet all{.name = "all", .node = {}};
  for (Index a = 0; a < model.node_count(); ++a) all.node.push_back(a);
  const Constraints constraints(model.node_count(), {all});
  EXPECT_EQ(testing_bodies::stable_step(forces.system(), model, model.mass, constraints,
                                        Nodal::Zero(4, model.node_count()))
                .dt,
            0.0);
}

TEST(StableTimeStep, ShrinksWhereTheTissueIsPressedTogether) {
  const Model model = block(5);
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  const Constraints constraints = make_constraints(model, Contact::bonded);
  const double undeformed = testing_bodies::stable_step(forces.system(), model, model.mass, constraints,
                                                        Nodal::Zero(4, model.node_count()))
                                .dt;
  const double pressed = testing_bodies::stable_step(forces.system(), model, model.mass, constraints,
                                                     affine(model, Vec3(1.29, 1.29, 0.6).asDiagonal()))
                             .dt;
  EXPECT_LT(pressed, 0.9 * undeformed);
}

}  // namespace
}  // namespace dimple::stable_time_step_test
