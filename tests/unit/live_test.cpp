// Live contact: displacement of a tool, with bounded work in each frame.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "io/error.hpp"
#include "solver/live/between_frames.hpp"
#include "solver/live/known_states.hpp"
#include "solver/live/progress.hpp"
#include "solver/session.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/report.hpp"

namespace dimple::live_test {
namespace {

const Material tissue = neo_hookean(210.0, 0.499, 1000.0);

// Depths of a hand at frames of 40 ms: 10 mm/s, with a stop at each end.
std::vector<double> path_of_a_hand() {
  std::vector<double> depth;
  for (int k = 1; k <= 5; ++k) depth.push_back(0.4e-3 * k);
  depth.insert(depth.end(), 5, 2e-3);
  for (int k = 4; k >= 2; --k) depth.push_back(0.4e-3 * k);
  depth.insert(depth.end(), 5, 0.8e-3);
  return depth;
}

TEST(Live, AToolThatIsFollowedByAFewEvaluationsHasTheForceOfEquilibrium) {
  const Model model = testing_bodies::averaged_block();
  Session live(model, {tissue}), still(model, {tissue}, {.tolerance = 1e-5});
  double now = 0.0;
  int held = 0, frames = 0;
  for (const double depth : path_of_a_hand()) {
    const LiveFrame frame = live.follow(depth, {.evaluations = 12});
    EXPECT_LE(frame.evaluations, 12);
    EXPECT_EQ(frame.requested, depth);
    if (frame.depth == 0.0) continue;
    still.equilibrate(frame.depth);
    EXPECT_NEAR(frame.force, still.force(), (depth == now ? 0.01 : 0.05) * still.force()) << 1e3 * depth;
    held += std::abs(frame.force - still.force()) <= frame.error_at_depth;
    ++frames;
    now = depth;
  }
  EXPECT_GE(frames, 16);
  EXPECT_GE(held, frames - 1);
}

TEST(Live, AFrameHasTheForceAcrossTheApproachAndTheMomentOfEquilibriumToo) {
  // The model is ten times as stiff on one side.
  const Model model =
      testing_bodies::averaged_block(6, 0.2, 1.8, [](const Vec3& x) { return x.x() > 17e-3; });
  const std::vector<Material> tissues = {tissue, neo_hookean(2100.0, 0.499, 1000.0)};
  Session live(model, tissues), still(model, tissues, {.tolerance = 1e-5});
  Wrench last = Wrench::Zero();
  for (const double depth : {0.4e-3, 0.8e-3, 1.2e-3, 1.2e-3, 1.2e-3}) {
    const LiveFrame frame = live.follow(depth, {.evaluations = 30});
    EXPECT_NEAR(-frame.on_tool.head<3>().dot(model.tool.approach), frame.force, 1e-12);
    EXPECT_TRUE((frame.force * frame.per_force).isApprox(frame.on_tool, 1e-12));
    still.equilibrate(frame.depth);
    const Wrench true_one = still.on_tool();
    EXPECT_GT(lateral_fraction(true_one, model.tool.approach), 0.1);
    EXPECT_LT((frame.on_tool - true_one).head<3>().norm(), 0.02 * true_one.head<3>().norm()) << depth;
    EXPECT_LT((frame.on_tool - true_one).tail<3>().norm(), 0.05 * true_one.tail<3>().norm()) << depth;
    last = frame.per_force;
  }
  const LiveFrame lifted = live.follow(0.0, {.evaluations = 8});
  EXPECT_TRUE(lifted.on_tool.isZero(0.0));
  EXPECT_LT((lifted.per_force - last).norm(), 0.2 * last.norm())
      << "its direction at the next touch is known";
}

TEST(Live, AToolThatIsToGoThroughTheBodySaysSo) {
  Session session(testing_bodies::averaged_block(), {tissue});  // 20 mm high
  EXPECT_NE(session.follow(19.9e-3, {.evaluations = 8}).tool, LiveFrame::Tool::beyond);
  EXPECT_EQ(session.follow(20.1e-3, {.evaluations = 8}).tool, LiveFrame::Tool::beyond);
  EXPECT_NE(session.follow(1e-3, {.evaluations = 100}).tool, LiveFrame::Tool::beyond);
}

TEST(Live, AToolThatComesNoNearerHasStoppedWithinABoundedNumberOfFramesAndGoesBackAsBefore) {
  Session session(testing_bodies::averaged_block(), {tissue});
  LiveFrame frame;
  int frames = 0, last_lag = 0;
  for (; frames < 150; ++frames) {
    frame = session.follow(19e-3, {.evaluations = 20});
    if (frame.tool == LiveFrame::Tool::lags) last_lag = frames;
    if (frame.tool == LiveFrame::Tool::there) break;
  }
  EXPECT_LT(last_lag, 100) << "it lags for ever, or again and again";
  if (frame.tool == LiveFrame::Tool::there) GTEST_SKIP() << "this body is followed to 19 of its 20 mm";
  EXPECT_EQ(frame.tool, LiveFrame::Tool::stopped);
  EXPECT_LT(frame.depth, 19e-3);
  EXPECT_TRUE(std::isinf(frame.error)) << "nothing is known of the force at 19 mm";
  // Other solvers find no equilibrium at this depth either; a pressing tool has a positive force.
  EXPECT_GE(frame.force + frame.error_at_depth, 0.0) << "its error leaves room for no force that is possible";
  for (int k = 0; k < 20; ++k) frame = session.follow(1e-3, {.evaluations = 20});
  EXPECT_EQ(frame.tool, LiveFrame::Tool::there);
  Session fresh(testing_bodies::averaged_block(), {tissue}, {.tolerance = 1e-5});
  fresh.equilibrate(1e-3);
  EXPECT_NEAR(frame.force, fresh.force(), frame.error);
}

TEST(Live, TheErrorIsOfTheRequestedDepthNotOfTheOneThatWasReached) {
  Session session(testing_bodies::averaged_block(), {tissue}),
      still(testing_bodies::averaged_block(), {tissue});
  still.equilibrate(3e-3);
  EXPECT_TRUE(std::isinf(session.follow(3e-3, {.evaluations = 1}).error)) << "nothing is known yet";
  for (int k = 0; k < 40; ++k) {
    const LiveFrame frame = session.follow(3e-3, {.evaluations = 4});
    EXPECT_LE(std::abs(frame.force - still.force()), frame.error) << k;
    EXPECT_GE(frame.error, frame.error_at_depth);
  }
}

TEST(Live, AToolThatJerksAheadIsLaggedBehindAndReachedWhenItStops) {
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
  // Along the known path back it follows at once.
  frame = session.follow(0.5e-3, {.evaluations = 8});
  EXPECT_EQ(frame.tool, LiveFrame::Tool::there);
  EXPECT_EQ(session.depth(), 0.5e-3);
}

TEST(Live, ALiftedToolHasNoForceAndLeavesNoDent) {
  Session session(testing_bodies::averaged_block(), {tissue});
  session.follow(1e-3, {.evaluations = 100});
  const double pressed = session.follow(1e-3, {.evaluations = 100}).force;
  EXPECT_GT(pressed, 0.0);
  const LiveFrame lifted = session.follow(-5e-3, {.evaluations = 8});
  EXPECT_EQ(lifted.force, 0.0);
  EXPECT_EQ(lifted.depth, 0.0);
  EXPECT_EQ(lifted.tool, LiveFrame::Tool::there);
  EXPECT_TRUE(session.nodal_parameters().isZero(0.0));
  EXPECT_NEAR(session.follow(1e-3, {.evaluations = 8}).force, pressed, 1e-2 * pressed);
}

TEST(Live, RandomJerksShowNoStateThatIsNoneAndNeverHoldTheToolOnItsPathBack) {
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
      ASSERT_TRUE(std::isfinite(frame.force) && std::isfinite(frame.error_at_depth));
      ASSERT_GE(frame.force, 0.0);
      ASSERT_LT(frame.residual, 0.05);
      ASSERT_LT(session.nodal_parameters().colwise().norm().maxCoeff(), 2.5 * frame.depth + 1e-9);
      held_back = frame.requested < last - 1e-9 && frame.depth == last ? held_back + 1 : 0;
      ASSERT_LT(held_back, 3) << "asked for " << 1e3 * frame.requested << " mm, stays at " << 1e3 * last;
      last = frame.depth;
    }
  }
}

TEST(Live, TissueThatRelaxesIsFollowedInAndOutAsEquilibriaInTimeHaveItAndForgetsWhereItIsLifted) {
  Material slow = tissue;
  slow.prony = {{0.5, 0.4}};
  const Model model = testing_bodies::averaged_block();
  Session session(model, {slow}), in_time(model, {slow});
  session.follow(2e-3, {.evaluations = 100});
  session.lift();  // removes all history
  EXPECT_EQ(session.follow(0.0, {.evaluations = 8}, 0.04).force, 0.0);
  const auto press = [&](double depth) { return session.follow(depth, {.evaluations = 30}, 0.04); };
  double largest = 0.0, first = 0.0;
  for (int k = 1; k <= 40; ++k) {
    const double depth = 0.1e-3 * (k <= 10 ? k : k <= 20 ? 10 : std::max(0, 30 - k));
    in_time.equilibrate(depth, 0.04);
    const LiveFrame frame = press(depth);
    EXPECT_EQ(frame.depth, depth);
    largest = std::max(largest, frame.force);
    if (k == 10) first = frame.force;
    EXPECT_NEAR(frame.force, in_time.force(), 0.01 * largest) << k;
  }
  EXPECT_LT(session.force(), -0.05 * largest) << "the dent draws the circle in";
  EXPECT_EQ(press(-1e-3).force, 0.0);
  EXPECT_EQ(press(0.0).force, 0.0);
  for (int k = 1; k <= 10; ++k) largest = press(0.1e-3 * k).force;
  EXPECT_NEAR(largest, first, 0.01 * first);
}

TEST(Live, ThePapersSchemeIsRefusedInWords) {
  Session session(testing_bodies::block(), {tissue});
  expect_error<SolveError>([&] { session.follow(1e-3, {.evaluations = 8}); }, {.code = "no-live"});
  EXPECT_THROW(session.follow(std::numeric_limits<double>::quiet_NaN(), {.evaluations = 8}),
               std::invalid_argument);
}

TEST(Progress, AToolHasStoppedAfterTooManyFramesOrEvaluationsUntilItComesNearer) {
  using State = Progress::State;
  Progress progress;
  for (int k = 1; k < 100; ++k) progress.stall(2);
  EXPECT_EQ(progress.state, State::advances);
  progress.stall(2);
  EXPECT_EQ(progress.state, State::stopped) << "100 frames";
  progress.advance();
  EXPECT_EQ(progress.state, State::advances);
  progress.stall(299);
  EXPECT_EQ(progress.state, State::advances);
  progress.stall(1);
  EXPECT_EQ(progress.state, State::stopped) << "300 evaluations";
  progress.advance();
  progress.stop();
  progress.stall(1);
  EXPECT_EQ(progress.state, State::stopped);
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

LiveFrame frame_at(double depth, double force, double stiffness, double error = 0.0) {
  LiveFrame frame;
  frame.depth = frame.requested = depth;
  frame.force = force, frame.stiffness = stiffness, frame.error = frame.error_at_depth = error;
  frame.per_force << 0.3, 0.0, 1.0, 0.0, 1e-3, 0.0;
  return frame;
}

// Answers come 200 times a second, frames 25 times a second, late, with alternating errors of 5 %.
TEST(BetweenFrames, CorrectionsDoNotMakeTheForceJump) {
  BetweenFrames between;
  double last = 0.0, largest = 0.0;
  for (int k = 0; k < 2000; ++k) {
    const double t = 0.005 * k, depth = 2.5e-3 - 2.5e-3 * std::cos(t), force = 10.0 * depth;
    if (k > 0) {
      const LiveAnswer said = answer(between, depth, t);
      const double moved = 10.0 * std::abs(depth - (2.5e-3 - 2.5e-3 * std::cos(t - 0.005)));
      if (k > 20) largest = std::max(largest, std::abs(said.force - last) - 1.5 * moved);
      if (k > 100) {
        EXPECT_NEAR(said.force, force, 0.1 * force + 1e-3);
      }
      last = said.force;
    }
    if (k % 8 == 0) {
      const double at = std::max(0.0, depth - 0.1e-3);
      correct(between, frame_at(at, 10.0 * at * (k % 16 == 0 ? 1.05 : 0.95), 10.0), t);
    }
  }
  EXPECT_LT(largest, 0.02 * 0.05);
  EXPECT_EQ(answer(between, -1e-3, 11.0).force, 0.0);
}

TEST(BetweenFrames, WhatAFrameChangesIsGivenOutByTheClockWhetherSomethingIsRequestedOrNot) {
  BetweenFrames requested, idle;
  for (BetweenFrames* b : {&requested, &idle}) {
    correct(*b, frame_at(1e-3, 8e-3, 8.0), 0.0);
    correct(*b, frame_at(1e-3, 10e-3, 10.0), 1.0);
  }
  EXPECT_NEAR(answer(requested, 1e-3, 1.0).force, 8e-3, 1e-12) << "no jump";
  for (int k = 1; k < 12; ++k) answer(requested, 1e-3 * (k % 3), 1.0 + 0.005 * k);
  const LiveAnswer said = answer(requested, 1e-3, 1.06), other = answer(idle, 1e-3, 1.06);
  EXPECT_NEAR(said.force, 10e-3 - 2e-3 * std::exp(-1.0), 1e-9);
  EXPECT_NEAR(other.force, said.force, 1e-12);
  EXPECT_NEAR(said.on_tool[2], said.force, 1e-12);
  EXPECT_NEAR(other.error, 2e-3 * std::exp(-1.0), 1e-9) << "what is not given out yet is in the error";
  EXPECT_NEAR(answer(idle, 1e-3, 3.0).force, 10e-3, 1e-9);
  EXPECT_NEAR(answer(idle, 1e-3, 3.0).error_at_depth, 0.0, 1e-9);
  EXPECT_EQ(idle.frame.size(), 1u) << "nothing is kept for ever";
  BetweenFrames left_alone;  // frames continue without any program
  correct(left_alone, frame_at(1e-3, 8e-3, 8.0), 0.0);
  for (int k = 1; k <= 25; ++k) correct(left_alone, frame_at(1e-3, 10e-3, 10.0), 0.04 * k);
  EXPECT_NEAR(answer(left_alone, 1e-3, 1.0).force, 10e-3, 1e-8);
}

TEST(BetweenFrames, AForceThatRisesSteeplyIsNeverAPull) {
  BetweenFrames between;
  correct(between, frame_at(1e-3, 1e-3, 10.0), 0.0);  // like a tenth power
  for (double d = 0.02e-3; d < 1e-3; d += 0.02e-3) EXPECT_GE(answer(between, d, 0.0).force, 0.0) << d;
}

TEST(BetweenFrames, TheErrorOfAFirstContactHoldsWhereTheTissueStiffensWithinARadius) {
  BetweenFrames between;
  correct(between, frame_at(0.0, 0.0, 10.0), 0.0);
  for (double d = 0.02e-3; d <= 1e-3; d += 0.02e-3)
    EXPECT_NEAR(answer(between, d, 0.0).force, 10.0 * d * (1.0 + d / between.radius),
                answer(between, d, 0.0).error_at_depth + 1e-12)
        << d;
}

// For F ~ d^1.5 the stiffness at rest is zero, and a secant to the first state is not valid at other depths.
TEST(BetweenFrames, OfAContactingToolNothingIsExtrapolatedBeyondAFrameBeforeFirstContact) {
  const auto force = [](double d) { return 1.0 * std::pow(d / 1e-3, 1.5) * 2e-3; };
  for (const double at : {0.0, 0.1e-3, 0.5e-3, 1e-3, 3e-3}) {
    BetweenFrames between{.has_contact = true};
    correct(between, frame_at(at, force(at), at > 0.0 ? 1.5 * force(at) / at : 1.2), 0.0);
    for (const double d : {0.2e-3, 1e-3, 2e-3, 4e-3}) {
      const LiveAnswer said = answer(between, d, 0.0);
      EXPECT_NEAR(said.force, force(said.depth), said.error_at_depth + 1e-12) << at << ' ' << d;
      EXPECT_TRUE(at > 0.0 || said.tool == LiveFrame::Tool::lags);
    }
  }
}

TEST(BetweenFrames, TheErrorOfARequestIsInfiniteWhereNoFrameReaches) {
  BetweenFrames between;
  EXPECT_TRUE(std::isinf(answer(between, 1e-3, 0.0).error));
  EXPECT_EQ(answer(between, -1e-3, 0.0).error, 0.0) << "in the air the force is none";
  correct(between, frame_at(1e-3, 10e-3, 10.0), 0.0);
  EXPECT_LT(answer(between, 1.5e-3, 0.0).error, 10e-3);
  const LiveAnswer deep = answer(between, 4e-3, 0.0);
  EXPECT_EQ(deep.tool, LiveFrame::Tool::lags);
  EXPECT_TRUE(std::isinf(deep.error));
  EXPECT_LT(deep.error_at_depth, 10e-3);
}

TEST(LiveFrame, TheForceOfAPoseNearbyIsAsFarOffAsASquareOfTheDepthAllows) {
  LiveFrame frame;
  frame.depth = 2e-3, frame.force = 20e-3;
  EXPECT_EQ(force_apart(frame, 0.0), 0.0);
  for (const double power : {0.5, 1.0, 1.5, 2.0})
    for (double x = -2e-3; x <= 2e-3; x += 0.1e-3) {
      const double there = 20e-3 * std::pow((2e-3 + x) / 2e-3, power);
      EXPECT_LE(std::abs(there - 20e-3), force_apart(frame, x) + 1e-15) << power << ' ' << x;
    }
  EXPECT_TRUE(std::isinf(force_apart(frame, 2.1e-3)));
  EXPECT_EQ(force_apart(frame, -5e-3), 20e-3) << "in the air";
  frame.depth = 0.0;
  EXPECT_TRUE(std::isinf(force_apart(frame, 0.1e-3)));
}

TEST(BetweenFrames, HundredsOfCorrectionsAtOneDepthDoNotAddUpAtAnother) {
  BetweenFrames between;
  double t = 0.0;
  for (int k = 0; k < 200; ++k) {  // deep and back faster than the frames
    answer(between, 4e-3, t);
    correct(between, frame_at(0.0, 0.0, 8.0), t += 0.001);
    answer(between, 0.1e-3, t);
    correct(between, frame_at(4e-3, 40e-3, 12.0), t += 0.001);
    const LiveAnswer said = answer(between, 1e-3, t);
    ASSERT_GE(said.force, 4e-3);
    ASSERT_LE(said.force, 10e-3);
    ASSERT_LE(said.error_at_depth, 10e-3);
  }
  EXPECT_LT(between.frame.size(), 1500u);
}

TEST(BetweenFrames, TheErrorHoldsWhereTheForceRisesFasterOrSlowerThanTheDepth) {
  for (const double power : {0.7, 1.0, 1.5, 1.8})
    for (const double secant : {0.96, 1.0, 1.04})  // a stiffness that is not quite that of the curve
      for (const double at : {0.0, 0.5e-3, 1e-3, 3e-3}) {
        if (at == 0.0 && power != 1.0) continue;  // no stiffness at rest
        const auto force = [&](double d) { return 0.01 * std::pow(d / 1e-3, power); };
        BetweenFrames between;
        correct(between, frame_at(at, force(at), secant * (at > 0.0 ? power * force(at) / at : 10.0), 1e-5),
                0.0);
        for (double d = 0.05e-3; d < at + 1.5e-3; d += 0.05e-3) {
          const LiveAnswer said = answer(between, d, 0.0);
          EXPECT_LE(said.depth, at + 1e-3 + 1e-12);
          EXPECT_EQ(said.tool, d <= said.depth ? LiveFrame::Tool::there : LiveFrame::Tool::lags) << d;
          EXPECT_NEAR(said.force, force(said.depth), said.error_at_depth)
              << power << ", " << secant << ", " << at << ", " << d;
          EXPECT_GE(said.force, 0.0);
          EXPECT_LE(said.error_at_depth, 1e-5 + 1.2 * force(std::max(said.depth, at)))
              << power << ", " << secant << ", " << d;
          if (power == 1.0) {
            EXPECT_LE(said.error_at_depth, 1e-5 + (secant == 1.0 ? 0.3 : 3.2) * force(said.depth))
                << secant << ", " << d;
          }
        }
      }
}

TEST(BetweenFrames, ForceDepthStatusAndVectorAreOfOneMoment) {
  using Tool = LiveFrame::Tool;
  BetweenFrames between;
  EXPECT_EQ(answer(between, 1e-3, 0.0).tool, Tool::lags) << "nothing is known yet";
  EXPECT_EQ(answer(between, 0.0, 0.0).tool, Tool::there);
  correct(between, frame_at(2e-3, 20e-3, 10.0), 0.1);
  const LiveAnswer deep = answer(between, 8e-3, 0.1);
  EXPECT_EQ(deep.tool, Tool::lags);
  EXPECT_NEAR(deep.depth, 3e-3, 1e-12) << "a fifth of the radius beyond the frame";
  EXPECT_NEAR(deep.force, 30e-3, 1e-12);
  EXPECT_NEAR(deep.on_tool[2], deep.force, 1e-12);
  EXPECT_NEAR(deep.on_tool[0], 0.3 * deep.force, 1e-12);
  EXPECT_NEAR(deep.on_tool[4], 1e-3 * deep.force, 1e-12);
  LiveFrame stopped = frame_at(2e-3, 20e-3, 10.0);
  for (const Tool tool : {Tool::stopped, Tool::beyond}) {
    stopped.tool = tool;
    correct(between, stopped, 0.2);
    EXPECT_EQ(answer(between, 8e-3, 2.0).tool, tool);
    EXPECT_EQ(answer(between, 8e-3, 2.0).depth, 2e-3) << "nothing is told of where no equilibrium is";
    EXPECT_EQ(answer(between, 1e-3, 2.0).tool, Tool::there);
  }
  forget(between);
  EXPECT_EQ(answer(between, 1e-3, 3.0).force, 0.0) << "nothing of one place is felt at another";
}

// Force in equilibrium over the depth, by cubic interpolation through four points.
struct Equilibria {
  static constexpr double step = 0.05e-3;
  std::vector<double> force = {0.0};
  Equilibria(const Model& model, double deepest) {
    Session session(model, {tissue}, {.tolerance = 1e-5});
    while (step * static_cast<double>(force.size() - 1) < deepest) {
      session.equilibrate(step * static_cast<double>(force.size()));
      force.push_back(session.force());
    }
  }
  double at(double d) const {
    const double x = std::max(0.0, d) / step;
    const auto first = static_cast<std::size_t>(
        std::clamp(std::floor(x) - 1.0, 0.0, static_cast<double>(force.size()) - 4.0));
    double sum = 0.0;
    for (std::size_t i = first; i < first + 4; ++i) {
      double weight = 1.0;
      for (std::size_t j = first; j < first + 4; ++j)
        if (j != i)
          weight *= (x - static_cast<double>(j)) / (static_cast<double>(i) - static_cast<double>(j));
      sum += weight * force[i];
    }
    return sum;
  }
};

// Random motion of a hand: holds, jumps, draws, shakes up to 10 Hz, lifts or pauses, each up to two seconds.
struct RandomHand {
  std::mt19937 random;
  double deepest, begin = 0.0, end = 0.0, from = 0.0, one = 0.0, other = 0.0, rate = 1.0, each = 0.005,
                  depth = 0.0;
  int displacement = 0;
  double unit() { return std::uniform_real_distribution<double>(0.0, 1.0)(random); }
  // Sets the depth at a time and returns the time until the next request [s].
  double move(double t) {
    if (t >= end) {
      begin = t, end = t + 0.1 + 1.9 * unit();
      from = std::max(0.0, depth), one = deepest * unit(), other = unit() < 0.5 ? 0.0 : deepest * unit();
      displacement = static_cast<int>(6.0 * unit());
      rate = 10.0 * unit();
      each = unit() < 0.8 ? 0.005 : 0.001 + 0.03 * unit();
    }
    if (displacement == 0) depth = one;
    if (displacement == 1) depth = depth == one ? other : one;
    if (displacement == 2) depth = from + (t - begin) / (end - begin) * (one - from);
    if (displacement == 3)
      depth = other + 0.5 * (one - other) * (1.0 - std::cos(6.283185307 * rate * (t - begin)));
    if (displacement == 4) depth = -1e-3 * unit();
    return displacement == 5 ? end - t + 1e-6 : each;
  }
};

struct RandomMinute {
  std::int64_t outside = 0, off = 0;
  double worst = 0.0;  // outside, beyond the allowed error
  std::vector<double>
      relative;  // stated error over the largest force of the last three tenths: old changes have 1/150 left
};

// Simulates a clock with 25 frames a second. A frame uses the depth requested when it began, and is reported
// when it is done.
RandomMinute random_minute(const Model& model, const Equilibria& equilibria, unsigned seed, double seconds) {
  Session session(model, {tissue});
  RandomHand hand{.random = std::mt19937(seed), .deepest = 2.5e-3};
  BetweenFrames between{.radius = model.tool.radius};
  LiveFrame frame;
  bool begun = false;
  double begins = 0.0, done = 0.0;
  std::vector<std::pair<double, double>> depths;  // of the last three tenths of a second
  RandomMinute said;
  for (double t = 0.0; t < seconds;) {
    while (begun ? done <= t : begins <= t) {
      if (begun) {
        correct(between, frame, done);
        begins = std::max(begins + 0.04, done);
      } else {
        frame = session.follow(hand.depth, {.evaluations = 12});
        done = begins + 0.002 + 0.038 * hand.unit();
      }
      begun = !begun;
    }
    const double wait = hand.move(t);
    const LiveAnswer now = answer(between, hand.depth, t);
    depths.push_back({t, hand.depth});
    std::erase_if(depths, [&](const auto& one) { return one.first < t - 0.3; });
    double least = equilibria.at(now.depth), most = least, most_before = least;
    for (const auto& [when, depth] : depths) {
      most_before = std::max(most_before, equilibria.at(depth));
      if (when < t - 0.1) continue;
      least = std::min(least, equilibria.at(depth));
      most = std::max(most, equilibria.at(depth));
    }
    const double here = equilibria.at(now.depth), known = 2e-5 * here;  // accuracy of the reference
    const double out = std::max({0.0, now.force - most, least - now.force});
    said.outside += out > now.error_at_depth + known;
    said.off += std::abs(now.force - here) > now.error_at_depth + known;
    said.worst = std::max(said.worst, out - now.error_at_depth - known);
    if (most_before > equilibria.at(0.02e-3)) said.relative.push_back(now.error_at_depth / most_before);
    t += wait;
  }
  std::sort(said.relative.begin(), said.relative.end());
  return said;
}

TEST(BetweenFrames, NoAnswerOfARandomMinuteLiesOutsideOfTheEquilibriaOfItsLastTenthOfASecond) {
  const Model model = testing_bodies::averaged_block();
  const RandomMinute said = random_minute(model, Equilibria(model, 2.6e-3), 1, 12.0);
  EXPECT_EQ(said.outside, 0) << "the worst " << said.worst << " N";
  EXPECT_EQ(said.off, 0) << "not even the equilibrium of its own depth";
  const auto error = [&](double fraction) {
    return said.relative[static_cast<std::size_t>(fraction * static_cast<double>(said.relative.size() - 1))];
  };
  EXPECT_LT(error(0.5), 0.02) << "an error that is always wide says nothing";
  EXPECT_LT(error(0.95), 0.4);
  EXPECT_LT(error(0.999), 1.5);
}

}  // namespace
}  // namespace dimple::live_test
