// Live contact of a tool that a hand moves, against the equilibria of a march.

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <random>

#include "io/error.hpp"
#include "solver/session.hpp"
#include "tests/helpers/report.hpp"
#include "tests/verification/pressed_cylinder.hpp"

namespace dimple {
namespace {

const Material tissue = neo_hookean(210.0, 0.499, 1000.0);

struct ContactSummary {
  Model model;
  std::shared_ptr<const RigidBody> indenter;
  SessionOptions options(double tolerance = 1e-4) const {
    return {.tolerance = tolerance, .indenter = indenter};
  }
};

// A tool on the axis of a cylinder; with `tilt` [degrees] it meets the flat end obliquely.
ContactSummary scene(const char* tool, double tilt = 0.0, const char* friction = "0") {
  const Scene run = pressed_cylinder::described(
      {.tool = tool, .depth_mm = 3.0, .friction = friction, .nodes = 500, .tilt = tilt});
  Model model = build_model(cylinder_surface(20, 20), model_options(run)).model;
  std::shared_ptr<const RigidBody> indenter = indenter_of(run, model);
  return {std::move(model), std::move(indenter)};
}

// Depths of a hand at frames of 40 ms: 10 mm/s in, out of the body, and in again with a stop.
std::vector<double> path_of_a_hand() {
  std::vector<double> depth;
  for (int k = 1; k <= 6; ++k) depth.push_back(0.4e-3 * k);
  depth.insert(depth.end(), 3, 2.4e-3);
  for (int k = 5; k >= 1; --k) depth.push_back(0.4e-3 * k + 0.1e-3);
  depth.insert(depth.end(), {-1e-3, 0.3e-3, 0.9e-3, 1.5e-3, 1.5e-3, 1.5e-3});
  return depth;
}

// Largest penetration of the body's surface into the tool [m], at contact samples or also between them.
double deepest_in_tool(const Session& session, double depth, bool between) {
  const RigidBody& indenter = *session.indenter();
  const ToolPose pose{indenter.pose.tip + depth * indenter.pose.points_at, indenter.pose.points_at};
  Nodal u = Nodal::Zero(4, session.model().node_count());
  u.topRows<3>() = session.nodal_parameters();
  const ContactSurface& surface = indenter.surface;
  const Points moved[] = {surface.place + surface.at_place(u.topRows<3>()),
                          surface.between + surface.at_between(u.topRows<3>())};
  double deepest = 0.0;
  for (const Points& places : moved) {
    if (&places == &moved[1] && !between) break;
    for (const auto& x : places.colwise())
      deepest = std::max(deepest, -distance_to_tool(indenter.shape, pose, x).distance);
  }
  return deepest;
}

TEST(LiveContact, HasInAndOutTheForceOfEquilibriumAndStatesItsError) {
  for (const auto& [tool, tilt] : {std::pair{"sphere:5mm", 20.0}, {"punch:5mm,edge=3mm", 0.0}}) {
    SCOPED_TRACE(tool);
    const ContactSummary with = scene(tool, tilt);
    Session live(with.model, {tissue}, with.options()), still(with.model, {tissue}, with.options(1e-5));
    int held = 0, frames = 0;
    double before = 0.0;
    for (const double depth : path_of_a_hand()) {
      const LiveFrame frame = live.follow(depth, {.evaluations = 8});
      EXPECT_LE(frame.evaluations, frames == 0 ? 8 + 240 : 8) << "the first finds what to begin with";
      EXPECT_EQ(frame.tool == LiveFrame::Tool::there, frame.depth == std::max(0.0, depth));
      if (frame.depth > 0.0) {
        still.equilibrate(frame.depth);
        const double truth = still.force();
        EXPECT_NEAR(frame.force, truth, (depth == before ? 0.003 : 0.05) * truth) << 1e3 * depth;
        EXPECT_NEAR(frame.on_tool.head<3>().dot(-with.model.tool.approach), frame.force, 1e-9 * frame.force);
        held += std::abs(frame.force - truth) <= frame.error_at_depth;
        ++frames;
        EXPECT_LT(deepest_in_tool(live, frame.depth, false), 0.02 * frame.depth);
      }
      before = depth;
    }
    EXPECT_GE(frames, 18);
    EXPECT_GE(held, frames - 1);
  }
}

TEST(LiveContact, EquilibriaAreThoseOfAMarch) {
  const ContactSummary with = scene("sphere:5mm");
  const ForceSystem force(with.model, {{tissue}, with.model.tissue}, Precision::single_);
  Loading loading{.depth = 2e-3};
  loading.indenter = with.indenter;
  const History history = marched(force, with.model, loading, {.frames = 2});
  Session session(with.model, {tissue}, with.options());
  session.equilibrate(2e-3);
  EXPECT_NEAR(session.force(), history.force.back().force, 1e-3 * session.force());
  EXPECT_NEAR(session.base_force(), session.force(), 2e-3 * session.force());
  EXPECT_NEAR(session.on_tool().head<3>().dot(-with.model.tool.approach), session.force(),
              1e-9 * session.force());
  EXPECT_EQ(session.tool().centre, with.indenter->pose.tip);
  session.equilibrate(-1e-3);
  EXPECT_EQ(session.force(), 0.0);
  EXPECT_EQ(session.depth(), -1e-3);
  EXPECT_TRUE(session.nodal_parameters().isZero(0.0));
}

TEST(LiveContact, AForceIsBetterForWhatIsLeftUnbalancedBeingAccountedFor) {
  const ContactSummary with = scene("sphere:5mm");
  Session live(with.model, {tissue}, with.options()), still(with.model, {tissue}, with.options(1e-5));
  live.follow(1e-3, {.evaluations = 200});
  double corrected = 0.0, raw = 0.0;
  for (int k = 1; k <= 5; ++k) {
    const LiveFrame frame = live.follow(1e-3 + 0.4e-3 * k, {.evaluations = 3});
    still.equilibrate(frame.depth);
    corrected += std::abs(frame.force - still.force());
    raw += std::abs(live.force() - still.force());
  }
  EXPECT_LT(corrected, 0.6 * raw);
}

// With too few evaluations for one frame an equilibrium is continued in the next, with the tool at its new
// place. Missing contact was once searched at the old place.
TEST(LiveContact, WithFewEvaluationsItLagsAndNeverShowsAForceOfAnotherDepth) {
  const ContactSummary with = scene("sphere:5mm");
  Session live(with.model, {tissue}, with.options()), still(with.model, {tissue}, with.options(1e-5));
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  double depth = 0.0, to = 0.0;
  int held = 0, frames = 0;
  for (int k = 0; k < 40; ++k) {
    if (k % 10 == 0) to = 0.4e-3 + 2e-3 * unit(random);
    depth = std::abs(to - depth) < 0.4e-3 ? to : depth + std::copysign(0.4e-3, to - depth);
    const LiveFrame frame = live.follow(depth, {.evaluations = 3});
    if (!(frame.depth > 0.2e-3)) continue;
    still.equilibrate(frame.depth);
    EXPECT_NEAR(frame.force, still.force(), 0.02 * still.force()) << 1e3 * frame.depth;
    held += std::abs(frame.force - still.force()) <= frame.error_at_depth;
    ++frames;
  }
  EXPECT_GE(frames, 35);
  EXPECT_GE(held, frames - 2);
}

TEST(LiveContact, RandomJerksNeverPullNorPenetrateTheBodyAndLeaveNothingBehind) {
  const ContactSummary with = scene("sphere:5mm");
  Session session(with.model, {tissue}, with.options());
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  for (int k = 0; k < 60; ++k) {
    const LiveFrame frame = session.follow(-1e-3 + 5e-3 * unit(random), {.evaluations = 6});
    ASSERT_TRUE(std::isfinite(frame.force) && std::isfinite(frame.error_at_depth));
    ASSERT_GE(frame.force, 0.0);
    ASSERT_LT(deepest_in_tool(session, frame.depth, true), 0.05 * 5e-3);
  }
  EXPECT_EQ(session.follow(-1e-3, {.evaluations = 1}).force, 0.0);
  EXPECT_TRUE(session.nodal_parameters().isZero(0.0));
}

TEST(LiveContact, TheSamePathGivesTheSameForcesWithAnyNumberOfThreads) {
  const ContactSummary with = scene("sphere:5mm");
  const auto forces = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    Session session(with.model, {tissue}, with.options());
    std::vector<double> force;
    for (const double depth : {0.4e-3, 0.8e-3, 1.2e-3, 0.6e-3}) {
      const LiveFrame frame = session.follow(depth, {.evaluations = 6});
      force.insert(force.end(), {frame.depth, frame.force, frame.error_at_depth, frame.stiffness});
    }
    return force;
  };
  EXPECT_EQ(forces(1), forces(4));
}

// The discretisation is too coarse for so small a ball, and the ball shorter than the displacement.
TEST(LiveContact, ItStopsBeforeTheSurfacePenetratesTheToolAndNoDeeperThanTheToolIsLong) {
  const ContactSummary with = scene("sphere:2mm");
  Session session(with.model, {tissue}, with.options());
  double deepest = 0.0;
  for (int k = 1; k <= 12; ++k) {
    const LiveFrame frame = session.follow(0.4e-3 * k, {.evaluations = 10});
    if (0.4e-3 * k > 4e-3) EXPECT_EQ(frame.tool, LiveFrame::Tool::beyond);
    EXPECT_LT(deepest_in_tool(session, frame.depth, true), 0.05 * 2e-3);
    deepest = std::max(deepest, frame.depth);
    // The force is that of the present depth, even if deeper ones were tried.
    const double force = session.force();
    EXPECT_NEAR(session.on_tool().head<3>().dot(-with.model.tool.approach), force, 1e-9 * force);
    EXPECT_NEAR(session.base_force(), force, 0.05 * force);
  }
  EXPECT_GT(deepest, 0.3e-3);
  EXPECT_LT(deepest, 4e-3);
  EXPECT_NE(session.follow(0.3e-3, {.evaluations = 100}).tool, LiveFrame::Tool::beyond);
}

TEST(LiveContact, WhatWasTriedDeeperLeavesTheForceOfWhereItIs) {
  const ContactSummary with = scene("sphere:5mm");
  Session session(with.model, {tissue}, with.options());
  const LiveFrame there = session.follow(1e-3, {.evaluations = 200});
  const double force = session.force();
  EXPECT_EQ(session.follow(3e-3, {.evaluations = 1}).force, there.force);
  ASSERT_EQ(session.depth(), 1e-3) << "one evaluation gets nowhere";
  EXPECT_EQ(session.force(), force);
}

TEST(LiveContact, WhatDependsOnItsPathIsRefusedInWords) {
  const auto refused = [](const ContactSummary& with, const Material& material, const char* word) {
    SCOPED_TRACE(word);
    expect_error<SolveError>([&] { Session(with.model, {material}, with.options()); },
                             {.why = word, .code = "no-live"});
  };
  Material slow = tissue;
  slow.prony = {{0.5, 0.2}};
  refused(scene("sphere:5mm", 0.0, "0.3"), tissue, "friction");
  const ContactSummary with = scene("sphere:5mm");
  refused(with, slow, "relaxes");
  refused(with, neo_hookean(210.0, 0.0, 1000.0), "patches");
  Session session(with.model, {tissue}, with.options());
  EXPECT_THROW(session.step(1e-4, 1e-3), SolveError);
}

}  // namespace
}  // namespace dimple
