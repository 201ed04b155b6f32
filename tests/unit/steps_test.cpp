// Scenes of several steps, each from the equilibrium of the one before.

#include "solver/march/steps.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <optional>

#include "io/error.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/block.hpp"

namespace dimple::steps_test {
namespace {

const Material tissue = neo_hookean(210.0, 0.49, 1000.0);

struct Seen {
  History history;
  std::vector<int> frame;
  std::vector<Vec3> aside;
  Nodal u;
  std::optional<MarchState> kept;
};

Seen march(const Model& model, const std::vector<Step>& steps, std::vector<HeldSet> further = {},
           const MarchState* from = nullptr, std::size_t keep_after = 0) {
  Seen seen;
  const ForceSystem forces(model, {{tissue}, model.tissue}, Precision::double_);
  Loading loading{.depth = 1e-3, .rate = 1e-3, .further = std::move(further), .steps = steps};
  std::size_t passed = 0;
  Observer observer{.frame =
                        [&](const Frame& f) {
                          seen.frame.push_back(f.number);
                          seen.aside.push_back(f.aside);
                          seen.u = f.u;
                        },
                    .between_steps =
                        [&](const std::function<MarchState()>& state) {
                          if (keep_after > 0 && ++passed == keep_after) seen.kept = state();
                        }};
  solve(TimeMode::quasi_static, forces, model, loading, {.frames = 4, .step_radii = 0.1, .tolerance = 1e-6},
        observer, seen.history, from);
  return seen;
}

Vec3 force_of(const Seen& seen) {
  return Eigen::Map<const Vec3>(seen.history.force.back().on_tool.data());
}

class Steps : public testing::Test {
 protected:
  const Model model = testing_bodies::averaged_block();
  const Vec3 approach = model.tool.approach;
  const Vec3 side = approach.unitOrthogonal();
};

TEST_F(Steps, AreMeasuredByAHundredthOfTheForcesThatTheyBeginWith) {
  const ForceSystem forces(model, {{tissue}, model.tissue}, Precision::double_);
  System system(forces, model, make_constraints(model, Contact::bonded));
  Nodal u = Nodal::Zero(4, model.node_count()), f = u, free = u;
  system.set({.depth = 1e-3}, u);
  system.force(u, f);
  const double reactions = system.balance(f, free).reactions;
  system.set_residual_scale(f);
  EXPECT_DOUBLE_EQ(system.least_reactions(), 0.01 * reactions);
  system.set_residual_scale(0.1 * f);
  EXPECT_DOUBLE_EQ(system.least_reactions(), 0.01 * reactions) << "the largest counts";
}

ForceSample sample(double depth, double aside, double force) {
  ForceSample s{0.0, depth, force, 0.0};
  s.aside[1] = aside;
  return s;
}

TEST(JumpOfACurve, IsWhatNeitherNeighbourLeadsTo) {
  // Neither a corner from pressing to sliding nor a long segment of constant slope is a jump.
  EXPECT_NEAR(
      largest_jump({sample(0, 0, 0), sample(1, 0, 1), sample(2, 0, 2), sample(2, 1, 2), sample(2, 2, 2)})
          .force,
      0.0, 1e-15);
  EXPECT_NEAR(largest_jump({sample(0, 0, 0), sample(1, 0, 1), sample(4, 0, 4), sample(5, 0, 5)}).force, 0.0,
              1e-15);
  const Jump down = largest_jump({sample(2, 0, 2), sample(2, 2, 2), sample(2, 2, 2), sample(2, 3, 1.25),
                                  sample(2, 5, 1.25), sample(2, 6, 1.25)});
  EXPECT_NEAR(down.force, 0.75, 1e-15);
  EXPECT_EQ(down.sample, 3u);
  EXPECT_EQ(largest_jump({}).force, 0.0);
  EXPECT_EQ(largest_jump({sample(0, 0, 0), sample(1, 0, 1)}).force, 0.0) << "one piece has no neighbours";
}

TEST_F(Steps, TwoPressesAreOne) {
  const Seen once = march(model, {}),
             twice = march(model, {{"a", "", 0.4e-3 * approach}, {"b", "", 0.6e-3 * approach}});
  EXPECT_NEAR(twice.history.force.back().depth, 1e-3, 1e-15);
  EXPECT_NEAR(twice.history.force.back().t, once.history.force.back().t, 1e-12);
  EXPECT_NEAR(twice.history.force.back().force, once.history.force.back().force,
              1e-4 * once.history.force.back().force);
  const EnergySample &all = once.history.energy.back(), &both = twice.history.energy.back();
  EXPECT_NEAR(both.external, all.external, 0.01 * all.external);
  EXPECT_NEAR(both.stored, all.stored, 1e-4 * all.stored);
  EXPECT_EQ(twice.frame, (std::vector<int>{0, 1, 2, 3, 4}));
}

TEST_F(Steps, ElasticTissueForgetsOnWhichPathTheToolCame) {
  const Seen corner = march(model, {{"press", "", 1e-3 * approach}, {"slide", "", 0.5e-3 * side}}),
             straight = march(model, {{"slant", "", 1e-3 * approach + 0.5e-3 * side}}),
             around = march(model, {{"drag", "", 0.5e-3 * side}, {"press", "", 1e-3 * approach}});
  const double size = force_of(straight).norm();
  EXPECT_LT((force_of(corner) - force_of(straight)).norm(), 1e-3 * size);
  EXPECT_LT((force_of(around) - force_of(straight)).norm(), 1e-3 * size);
  EXPECT_LT(force_of(corner).dot(side), -0.05 * size) << "dragged tissue pulls back";
  for (const Seen* seen : {&corner, &straight, &around}) {
    EXPECT_NEAR(seen->history.force.back().depth, 1e-3, 1e-12);
    EXPECT_LT((seen->aside.back() - 0.5e-3 * side).norm(), 1e-12);
    EXPECT_LT((Eigen::Map<const Vec3>(seen->history.force.back().aside.data()) - 0.5e-3 * side).norm(),
              1e-12);
  }
  // The moment is about a point that moves with the tool, for any path.
  const auto moment = [](const Seen& s) {
    return Eigen::Map<const Vec3>(s.history.force.back().on_tool.data() + 3);
  };
  EXPECT_LT((moment(corner) - moment(straight)).norm(), 1e-3 * size * model.tool.radius);
}

TEST_F(Steps, ThereAndBackLeavesNothing) {
  const Seen seen = march(model, {{"press", "", 1e-3 * approach},
                                  {"slide", "", 0.5e-3 * side},
                                  {"lift", "", -1e-3 * approach},
                                  {"home", "", -0.5e-3 * side}});
  double largest = 0.0;
  for (const ForceSample& s : seen.history.force) largest = std::max(largest, s.force);
  EXPECT_LT(force_of(seen).norm(), 1e-3 * largest);
  EXPECT_NEAR(seen.history.force.back().depth, 0.0, 1e-15);
  EXPECT_LT(seen.u.colwise().norm().maxCoeff(), 1e-6);
  const EnergySample& end = seen.history.energy.back();
  double most = 0.0;
  for (const EnergySample& e : seen.history.energy) most = std::max(most, e.external);
  EXPECT_LT(std::abs(end.external), 0.02 * most) << "a way round takes no work";
  EXPECT_LT(std::abs(end.stored), 1e-4 * most);
}

TEST_F(Steps, ABondedToolPullsAsItPresses) {
  const Seen pulled = march(model, {{"pull", "", -0.05e-3 * approach}}),
             pressed = march(model, {{"press", "", 0.05e-3 * approach}});
  EXPECT_LT(pulled.history.force.back().force, 0.0);
  EXPECT_NEAR(pulled.history.force.back().force, -pressed.history.force.back().force,
              0.05 * pressed.history.force.back().force);
  EXPECT_LT(pulled.history.force.back().depth, 0.0);
}

TEST_F(Steps, AFurtherPatchMovesWhileTheToolRests) {
  std::vector<Index> patch;
  const auto edge = testing_bodies::on_boundary(model);
  for (Index a = 0; a < model.node_count(); ++a)
    if (edge[static_cast<std::size_t>(a)] &&
        (model.X.col(a) - model.tool.centre).dot(side) > 1.5 * model.tool.radius &&
        std::find(model.base.begin(), model.base.end(), a) == model.base.end())
      patch.push_back(a);
  ASSERT_FALSE(patch.empty());
  const HeldSet still{.name = "retractor", .node = patch};
  HeldSet together = still;
  together.direction = side;
  together.fraction = 0.5;
  const Seen steps = march(model, {{"press", "", 1e-3 * approach}, {"pull", "retractor", 0.5e-3 * side}},
                           {still}),
             at_once = march(model, {}, {together});
  EXPECT_NEAR(steps.history.force.back().depth, 1e-3, 1e-15);
  EXPECT_LT((force_of(steps) - force_of(at_once)).norm(), 1e-3 * force_of(at_once).norm());
  EXPECT_LT(steps.aside.back().norm(), 1e-15);
  EXPECT_NEAR(steps.history.energy.back().stored, at_once.history.energy.back().stored,
              1e-3 * at_once.history.energy.back().stored);
  EXPECT_NEAR(steps.history.energy.back().external, steps.history.energy.back().stored,
              0.02 * steps.history.energy.back().stored)
      << "the retractor's work counts";
}

TEST_F(Steps, ARunThatIsResumedInALaterStepContinuesToTheSameBits) {
  const std::vector<Step> displacement = {{"press", "", 0.8e-3 * approach}, {"slide", "", 1.2e-3 * side}};
  const Seen whole = march(model, displacement, {}, nullptr, 3);
  ASSERT_TRUE(whole.kept);
  ASSERT_EQ(whole.kept->step_of_scene, 1) << "of the second step";
  const Seen remaining = march(model, displacement, {}, &*whole.kept);
  EXPECT_EQ(remaining.history.force.back().on_tool, whole.history.force.back().on_tool);
  EXPECT_EQ(remaining.history.force.size(), whole.history.force.size());
  EXPECT_EQ(remaining.history.energy.back().external, whole.history.energy.back().external);
  EXPECT_TRUE(remaining.u == whole.u);
}

TEST_F(Steps, AreRefusedWithInertia) {
  const ForceSystem forces(model, {{tissue}, model.tissue});
  History history;
  const Loading loading{.depth = 1e-3, .rate = 1.0, .steps = {{"press", "", 1e-3 * approach}}};
  EXPECT_THROW(solve(TimeMode::explicit_, forces, model, loading, {}, {}, history), SolveError);
}

TEST(FramesOfSteps, AreDividedByTheLengthsOfThePathsAndNoStepHasNone) {
  const std::vector<Step> steps = {{"a", "", {4, 0, 0}}, {"b", "", {0, 4, 0}}, {"c", "", {0, 0, 0.1}}};
  EXPECT_EQ(frames_of_steps(steps, 16), (std::vector<int>{8, 8, 1}));
  EXPECT_EQ(frames_of_steps(steps, 1), (std::vector<int>{1, 1, 1}));
  EXPECT_EQ(frames_of_steps({{"a", "", {1, 0, 0}}}, 16), std::vector<int>{16});
}

}  // namespace
}  // namespace dimple::steps_test
