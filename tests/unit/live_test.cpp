// A body under a tool that is followed in bounded time.

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>
#include <random>

#include "io/error.hpp"
#include "solver/between_frames.hpp"
#include "solver/known_states.hpp"
#include "solver/session.hpp"
#include "tests/helpers/block.hpp"

namespace dimple {
namespace {

const Material tissue = neo_hookean(210.0, 0.499, 1000.0);

// A frame is 40 ms: 10 mm/s, with a stop at each end.
std::vector<double> way_of_a_hand() {
  std::vector<double> depth;
  for (int k = 1; k <= 5; ++k) depth.push_back(0.4e-3 * k);
  depth.insert(depth.end(), 5, 2e-3);
  for (int k = 4; k >= 2; --k) depth.push_back(0.4e-3 * k);
  depth.insert(depth.end(), 5, 0.8e-3);
  return depth;
}

TEST(Live, AToolThatIsFollowedByAFewEvaluationsFeelsTheForceOfEquilibrium) {
  const Model model = testing_bodies::averaged_block();
  Session live(model, {tissue}), still(model, {tissue}, {.tolerance = 1e-5});
  double now = 0.0;
  int held = 0, frames = 0;
  for (const double depth : way_of_a_hand()) {
    const LiveFrame frame = live.follow(depth, {.evaluations = 12});
    EXPECT_LE(frame.evaluations, 12);
    EXPECT_EQ(frame.asked, depth);
    if (frame.depth == 0.0) continue;
    still.equilibrate(frame.depth);
    EXPECT_NEAR(frame.force, still.force(), (depth == now ? 0.01 : 0.05) * still.force()) << 1e3 * depth;
    held += std::abs(frame.force - still.force()) <= frame.error;
    ++frames;
    now = depth;
  }
  EXPECT_GE(frames, 16);
  EXPECT_GE(held, frames - 1);
}

TEST(Live, AForceIsBetterForWhatIsLeftUnbalancedBeingAccountedFor) {
  const Model model = testing_bodies::averaged_block();
  Session live(model, {tissue}), still(model, {tissue}, {.tolerance = 1e-5});
  live.follow(1e-3, {.evaluations = 200});
  double with = 0.0, without = 0.0;
  for (int k = 1; k <= 5; ++k) {
    const LiveFrame frame = live.follow(1e-3 + 0.4e-3 * k, {.evaluations = 2});
    still.equilibrate(frame.depth);
    with += std::abs(frame.force - still.force());
    without += std::abs(live.force() - still.force());
  }
  EXPECT_LT(with, 0.5 * without);
}

TEST(Live, TheSameWayGivesTheSameForcesWithAnyNumberOfThreads) {
  const Model model = testing_bodies::averaged_block(8);
  const auto forces = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    Session session(model, {tissue});
    std::vector<double> force;
    for (const double depth : way_of_a_hand()) {
      const LiveFrame frame = session.follow(depth, {.evaluations = 6});
      force.insert(force.end(), {frame.depth, frame.force, frame.error, frame.stiffness});
    }
    return force;
  };
  EXPECT_EQ(forces(1), forces(4));
}

TEST(Live, AToolThatJerksAheadIsLaggedBehindAndReachedWhenItStandsStill) {
  Session session(testing_bodies::averaged_block(), {tissue});
  LiveFrame frame = session.follow(3e-3, {.evaluations = 8});
  EXPECT_EQ(frame.tool, LiveFrame::Tool::lags);
  EXPECT_LT(frame.depth, 3e-3);
  double before = frame.depth;
  for (int k = 0; k < 30 && frame.tool == LiveFrame::Tool::lags; ++k) {
    frame = session.follow(3e-3, {.evaluations = 8});
    EXPECT_GE(frame.depth, before);
    before = frame.depth;
  }
  EXPECT_EQ(frame.tool, LiveFrame::Tool::there);
  EXPECT_EQ(frame.depth, 3e-3);
  // Back along the way that is known it follows at once.
  frame = session.follow(0.5e-3, {.evaluations = 8});
  EXPECT_EQ(frame.tool, LiveFrame::Tool::there);
  EXPECT_EQ(session.depth(), 0.5e-3);
}

TEST(Live, ALiftedToolFeelsNothingAndLeavesNoDent) {
  Session session(testing_bodies::averaged_block(), {tissue});
  session.follow(1e-3, {.evaluations = 100});
  const double pressed = session.follow(1e-3, {.evaluations = 100}).force;
  EXPECT_GT(pressed, 0.0);
  const LiveFrame lifted = session.follow(-5e-3, {.evaluations = 8});
  EXPECT_EQ(lifted.force, 0.0);
  EXPECT_EQ(lifted.depth, 0.0);
  EXPECT_EQ(lifted.tool, LiveFrame::Tool::there);
  EXPECT_TRUE(session.displacement().isZero(0.0));
  EXPECT_NEAR(session.follow(1e-3, {.evaluations = 8}).force, pressed, 1e-2 * pressed);
}

TEST(Live, RandomJerksShowNoStateThatIsNoneAndNeverHoldTheToolOnItsWayBack) {
  const Model model = testing_bodies::averaged_block();
  Session session(model, {tissue});
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  double depth = 0.0, last = 0.0;
  int held_back = 0;
  for (int k = 0; k < 60; ++k) {
    const double to = 12e-3 * unit(random),
                 step = 2e-3 * (0.1 + 0.9 * unit(random));  // 60 % of 20 mm, 50 mm/s
    while (depth != to) {
      depth = std::abs(to - depth) <= step ? to : depth + std::copysign(step, to - depth);
      const LiveFrame frame = session.follow(depth, {.evaluations = 8});
      ASSERT_TRUE(std::isfinite(frame.force) && std::isfinite(frame.error));
      ASSERT_GE(frame.force, 0.0);
      ASSERT_LT(frame.residual, 0.05);
      ASSERT_LT(session.displacement().colwise().norm().maxCoeff(), 2.5 * frame.depth + 1e-9);
      held_back = frame.asked < last - 1e-9 && frame.depth == last ? held_back + 1 : 0;
      ASSERT_LT(held_back, 3) << "asked for " << 1e3 * frame.asked << " mm, stays at " << 1e3 * last;
      last = frame.depth;
    }
  }
}

TEST(Live, TissueThatRelaxesResistsLessAndLessUnderAToolThatStands) {
  Material slow = tissue;
  slow.prony = {{0.5, 0.2}};
  Session session(testing_bodies::averaged_block(), {slow});
  double first = 0.0, force = 0.0;
  for (int k = 0; k < 40; ++k) {
    force = session.follow(std::min(1e-3, 0.25e-3 * (k + 1)), {.evaluations = 20}, 0.04).force;
    if (k == 4) first = force;
  }
  EXPECT_LT(force, 0.9 * first);
  EXPECT_GT(force, 0.4 * first);
}

TEST(Live, ThePapersSchemeIsRefusedInWords) {
  Session session(testing_bodies::block(), {tissue});
  try {
    session.follow(1e-3, {.evaluations = 8});
    FAIL();
  } catch (const SolveError& error) {
    EXPECT_EQ(error.report.code, "no-live");
  }
  EXPECT_THROW(session.follow(std::numeric_limits<double>::quiet_NaN(), {.evaluations = 8}),
               std::invalid_argument);
}

TEST(KnownStates, APathThatIsACubicOverTheDepthIsKnownFromFourOfItsPoints) {
  const auto at = [](double d) {
    KnownStates::State s{
        .at = d, .u = Nodal::Constant(4, 2, 3.0 * d + d * d - 2.0 * d * d * d), .lambda = {}};
    s.lambda = Eigen::VectorXd::Constant(1, d * d);
    s.force = 2.0 * d;
    return s;
  };
  KnownStates known{.state = {}, .apart = 0.5};
  for (const double d : {4.0, 1.0, 3.0, 2.0, 0.0, 2.2}) known.add(at(d));
  EXPECT_EQ(known.state.size(), 5u) << "one stands too near another";
  Nodal u;
  Eigen::VectorXd lambda;
  known.guess(1.7, u, lambda);
  EXPECT_NEAR(u(0, 0), at(1.7).u(0, 0), 1e-12);
  EXPECT_NEAR(lambda[0], 1.7 * 1.7, 1e-12);
  EXPECT_NEAR(known.slope(3.5).force, 2.0, 1e-12);
  EXPECT_NEAR(known.slope(9.0).lambda[0], 16.0 - 9.0, 1e-12);
}

TEST(KnownStates, OfTwoNeighboursTheOneNearerToEquilibriumStays) {
  const auto at = [](double d, double residual) {
    return KnownStates::State{d, Nodal::Zero(4, 1), Eigen::VectorXd::Zero(1), residual, 0.0};
  };
  KnownStates known{.state = {}, .apart = 0.5};
  known.add(at(0.0, 0.0));
  known.add(at(1.0, 1e-2));
  known.add(at(1.2, 1e-3));
  known.add(at(1.1, 1e-2));
  ASSERT_EQ(known.state.size(), 2u);
  EXPECT_EQ(known.state[1].at, 1.2);
}

// 200 answers a second over frames of 25 a second that come late and are each 5 % off, to and fro.
TEST(BetweenFrames, CorrectionsDoNotMakeTheForceJump) {
  BetweenFrames between;
  double last = 0.0, largest = 0.0;
  for (int k = 0; k < 2000; ++k) {
    const double t = 0.005 * k, depth = 2.5e-3 - 2.5e-3 * std::cos(t), force = 10.0 * depth;
    if (k > 0) {
      const double now = answer(between, depth, 0.005);
      const double moved = 10.0 * std::abs(depth - (2.5e-3 - 2.5e-3 * std::cos(t - 0.005)));
      if (k > 20) largest = std::max(largest, std::abs(now - last) - 1.5 * moved);
      if (k > 100) {
        EXPECT_NEAR(now, force, 0.1 * force + 1e-3);
      }
      last = now;
    }
    if (k % 8 == 0) {
      LiveFrame frame;
      frame.depth = std::max(0.0, depth - 0.1e-3);
      frame.force = 10.0 * frame.depth * (k % 16 == 0 ? 1.05 : 0.95);
      frame.stiffness = 10.0;
      correct(between, frame);
    }
  }
  EXPECT_LT(largest, 0.02 * 0.05);
  EXPECT_EQ(answer(between, -1e-3, 0.005), 0.0);
}

}  // namespace
}  // namespace dimple
