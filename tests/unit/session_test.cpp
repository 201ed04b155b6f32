// A body under a tool that a hand moves.

#include "solver/session.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "io/error.hpp"
#include "preprocess/supports/contact_surface.hpp"
#include "preprocess/supports/support.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/caches.hpp"
#include "tests/helpers/report.hpp"

namespace dimple::session_test {
namespace {

const Material tissue = neo_hookean(210.0, 0.499, 1000.0);

TEST(Session, ABodyHasTheSameForceOnAProcessorWithOtherCaches) {
  std::vector<double> forces;
  for (const std::ptrdiff_t first_level : {8 << 10, 32 << 10, 48 << 10}) {
    const testing_bodies::Caches caches(first_level);
    Session session(testing_bodies::averaged_block(9), {tissue});  // 1000 nodes: several levels of multigrid
    session.equilibrate(1e-3);
    forces.push_back(session.force());
  }
  EXPECT_EQ(forces[0], forces[1]);
  EXPECT_EQ(forces[0], forces[2]);
}

// The tool moves 0.1 mm at a time, like a hand; force and surface are read after each.
TEST(Session, AToolMovedByATenthOfAMillimetreHasTheForceOfTheWholePath) {
  const Model model = testing_bodies::averaged_block();
  const History whole = solve(model, {{tissue}, model.tissue}, {.depth = 1e-3, .rate = 1e-4}, {.frames = 4});

  Session session(model, {tissue});
  const Interpolation skin = surface_interpolation(session.model());
  double last = 0.0;
  for (int k = 1; k <= 10; ++k) {
    EXPECT_LT(session.equilibrate(1e-4 * k), 60);
    EXPECT_GT(session.force(), last);
    last = session.force();
    const Eigen::MatrixXd moved = skin(session.nodal_parameters());
    EXPECT_EQ(moved.cols(), model.surface.vertex_mm.cols());
    EXPECT_LE(moved.colwise().norm().maxCoeff(), 1.1e-4 * k);
  }
  EXPECT_NEAR(session.depth(), 1e-3, 1e-12);
  EXPECT_NEAR(session.force(), whole.force.back().force, 1e-3 * session.force());
  EXPECT_NEAR(session.base_force(), session.force(), 1e-3 * session.force());
}

TEST(Session, AToolThatGoesBackLeavesNoForceAndNoDent) {
  Session session(testing_bodies::averaged_block(), {tissue});
  session.equilibrate(0.5e-3);
  const double pressed = session.force();
  session.equilibrate(0.0);
  EXPECT_LT(std::abs(session.force()), 1e-3 * pressed);
  EXPECT_LT(session.nodal_parameters().cwiseAbs().maxCoeff(), 1e-6);
  session.equilibrate(0.5e-3);
  EXPECT_NEAR(session.force(), pressed, 1e-3 * pressed);
}

// Nodal forces and their moments sum to zero, so the tool's wrench is that of the base.
TEST(Session, TheForceAndTheMomentOnTheToolAreThoseOfTheBase) {
  for (const Contact contact : {Contact::bonded, Contact::frictionless}) {
    const Model model =
        testing_bodies::averaged_block(6, 0.2, 1.8, [](const Vec3& x) { return x.x() > 17e-3; });
    Session session(model, {tissue, neo_hookean(2100.0, 0.499, 1000.0)},
                    {.contact = contact, .tolerance = 1e-6});
    session.equilibrate(1e-3);
    const Points at = model.X + session.nodal_parameters(), f = session.forces();
    const Vec3 reference = model.tool.centre + 1e-3 * model.tool.approach;
    Vec3 force = Vec3::Zero(), moment = Vec3::Zero(), across = force;
    for (const Index a : model.base) {
      force += f.col(a);
      moment += (at.col(a) - reference).cross(f.col(a));
    }
    for (const Index a : model.bonded_patch) across -= f.col(a);
    const Wrench recorded = session.on_tool();
    EXPECT_LT((recorded.head<3>() - force).norm(), 1e-4 * force.norm());
    EXPECT_LT((recorded.tail<3>() - moment).norm(), 1e-4 * moment.norm());
    EXPECT_NEAR(-recorded.head<3>().dot(model.tool.approach), session.force(), 1e-12);
    EXPECT_GT(recorded[2], 0.0) << "the tool is pushed back";
    EXPECT_GT(moment.norm(), 1e-2 * force.norm() * model.tool.radius);
    if (contact == Contact::bonded) {
      EXPECT_GT(lateral_fraction(recorded, model.tool.approach), 0.1);
      EXPECT_LT((recorded.head<3>() - across).norm(), 1e-12);
    } else {
      EXPECT_LT(lateral_fraction(recorded, model.tool.approach), 1e-12)
          << "a tool that slides is pushed along its axis alone";
    }
  }
}

// In every time mode the samples have the force vector of their depth.
TEST(Session, EverySampleOfAMarchHasTheForceVectorOfItsDepth) {
  const Model model =
      testing_bodies::averaged_block(6, 0.2, 1.8, [](const Vec3& x) { return x.x() > 17e-3; });
  const Material soft = neo_hookean(210.0, 0.45, 1000.0), hard = neo_hookean(2100.0, 0.45, 1000.0);
  for (const TimeMode time : {TimeMode::quasi_static, TimeMode::explicit_}) {
    Nodal u, f;
    History whole;
    solve(time, ForceSystem(model, {{soft, hard}, model.tissue}, Precision::single_), model,
          {.depth = 1e-3, .rate = 5e-3}, {.frames = 2},
          {.frame = [&](const Frame& frame) { u = frame.u, f = frame.f; }}, whole);
    const ForceSample& last = whole.force.back();
    Vec3 force = Vec3::Zero(), moment = Vec3::Zero();
    for (const Index a : model.bonded_patch) {
      const Vec3 on_tool = -f.col(a).head<3>();
      force += on_tool;
      moment += (model.X.col(a) - model.tool.centre).cross(on_tool);  // the patch moves as one
    }
    const Eigen::Map<const Wrench> recorded(last.on_tool.data());
    EXPECT_LT((recorded.head<3>() - force).norm(), 1e-12);
    EXPECT_LT((recorded.tail<3>() - moment).norm(), 1e-12);
    EXPECT_NEAR(-force.dot(model.tool.approach), last.force, 1e-12);
    EXPECT_GT(force.head<2>().norm(), 0.05 * last.force);
    for (const double value : whole.force.front().on_tool)
      EXPECT_FALSE(std::signbit(value)) << "no -0 in a file";
  }
}

TEST(Session, SlowSmallStepsWithInertiaComeNearTheEquilibrium) {
  const Model model = testing_bodies::averaged_block();
  const Material soft = neo_hookean(210.0, 0.45, 1000.0);
  Session still(model, {soft}), moving(model, {soft});
  still.equilibrate(2e-4);
  std::int64_t steps = 0;
  for (int k = 1; k <= 20; ++k) steps += moving.step(1e-5 * k, 0.05);
  EXPECT_GT(steps, 100);
  EXPECT_NEAR(moving.force(), still.force(), 0.15 * still.force());
}

TEST(Session, AMoveThatCannotBeFollowedLeavesTheBodyAsItWas) {
  Session session(testing_bodies::averaged_block(), {tissue});
  session.equilibrate(0.3e-3);
  const double force = session.force();
  const Points before = session.nodal_parameters();
  EXPECT_THROW(session.step(15e-3, 1e-3), SolveError);
  EXPECT_EQ(session.depth(), 0.3e-3);
  EXPECT_EQ(session.force(), force);
  EXPECT_TRUE(session.nodal_parameters() == before);
}

TEST(Session, AMoveOfTooManyStepsIsRefusedBeforeTheFirst) {
  Session session(testing_bodies::averaged_block(), {tissue}, {.steps = 50});
  EXPECT_GT(session.step(1e-5, 1e-3), 0);
  const Points before = session.nodal_parameters();
  EXPECT_THROW(session.step(2e-5, 1e3), SolveError);
  EXPECT_TRUE(session.nodal_parameters() == before);
}

// After any motion of the tool, and under any loads, later waves depend on the same tissue stiffness.
TEST(Session, StepsFromAnEquilibriumContinueWithTheStiffnessOfTheVolume) {
  const Model model = testing_bodies::averaged_block(4);
  for (const double gravity : {0.0, -3.0}) {
    const SessionOptions options{.loads = {.gravity = Vec3(0.0, 0.0, gravity), .pressure = {}}};
    Session moving(model, {neo_hookean(210.0, 0.49, 1000.0)}, options),
        still(model, {neo_hookean(210.0, 0.49, 1000.0)}, options);
    moving.equilibrate(0.5e-3);
    for (int k = 1; k <= 20; ++k) moving.step(0.5e-3 + 0.25e-4 * k, 0.05);
    still.equilibrate(1e-3);
    EXPECT_NEAR(moving.force(), still.force(), 0.03 * still.force()) << gravity;
  }
}

// The patch's nodes would hold the tissue: a force of zero at every depth.
TEST(Session, OfAContactingToolOnAModelWithNodesOfAPatchIsRefused) {
  const Model model = testing_bodies::averaged_block();
  ASSERT_FALSE(model.bonded_patch.empty());
  const auto indenter = std::make_shared<RigidBody>();
  indenter->shape = sphere_shape(3e-3);
  indenter->surface = contact_surface(model, 9e-3);
  indenter->pose = first_contact(indenter->shape, model.tool, indenter->surface);
  expect_error<SolveError>(
      [&] { const Session session(model, {tissue}, {.indenter = indenter}); },
      {.fact = "nodes of a bonded patch", .remedy = "contact_radius_mm", .code = "no-live"});
}

}  // namespace
}  // namespace dimple::session_test
