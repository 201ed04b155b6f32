// A body under a tool that is moved by hand.

#include "solver/session.hpp"

#include <gtest/gtest.h>

#include "io/error.hpp"
#include "preprocess/support.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/block.hpp"

namespace dimple {
namespace {

const Material tissue = neo_hookean(210.0, 0.499, 1000.0);

// 0.1 mm at a time, as a hand moves, reading force and surface after each.
TEST(Session, AToolMovedByATenthOfAMillimetreFeelsTheForceOfTheWholeWay) {
  const Model model = testing_bodies::averaged_block();
  const History whole = solve(model, {{tissue}, model.tissue}, {.depth = 1e-3, .rate = 1e-4}, {.frames = 4});

  Session session(model, {tissue});
  const Interpolation skin = surface_interpolation(session.model());
  double last = 0.0;
  for (int k = 1; k <= 10; ++k) {
    EXPECT_LT(session.equilibrate(1e-4 * k), 60);
    EXPECT_GT(session.force(), last);
    last = session.force();
    const Eigen::MatrixXd moved = skin(session.displacement());
    EXPECT_EQ(moved.cols(), model.surface.vertex_mm.cols());
    EXPECT_LE(moved.colwise().norm().maxCoeff(), 1.1e-4 * k);
  }
  EXPECT_NEAR(session.depth(), 1e-3, 1e-12);
  EXPECT_NEAR(session.force(), whole.force.back().force, 1e-3 * session.force());
  EXPECT_NEAR(session.base_force(), session.force(), 1e-3 * session.force());
  EXPECT_TRUE(session.positions() == session.model().X + session.displacement());
}

TEST(Session, AToolThatGoesBackLeavesNoForceAndNoDent) {
  Session session(testing_bodies::averaged_block(), {tissue});
  session.equilibrate(0.5e-3);
  const double pressed = session.force();
  session.equilibrate(0.0);
  EXPECT_LT(std::abs(session.force()), 1e-3 * pressed);
  EXPECT_LT(session.displacement().cwiseAbs().maxCoeff(), 1e-6);
  session.equilibrate(0.5e-3);
  EXPECT_NEAR(session.force(), pressed, 1e-3 * pressed);
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
  const Points before = session.displacement();
  EXPECT_THROW(session.step(15e-3, 1e-3), SolveError);
  EXPECT_EQ(session.depth(), 0.3e-3);
  EXPECT_EQ(session.force(), force);
  EXPECT_TRUE(session.displacement() == before);
}

TEST(Session, AMoveOfTooManyStepsIsRefusedBeforeTheFirst) {
  Session session(testing_bodies::averaged_block(), {tissue}, {.steps = 50});
  EXPECT_GT(session.step(1e-5, 1e-3), 0);
  const Points before = session.displacement();
  EXPECT_THROW(session.step(2e-5, 1e3), SolveError);
  EXPECT_TRUE(session.displacement() == before);
}

}  // namespace
}  // namespace dimple
