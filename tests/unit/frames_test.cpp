// Output frames do not affect a quasi-static march.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "solver/march/quasi_static.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/arch.hpp"

namespace dimple::frames_test {
namespace {

using namespace testing_bodies;

struct Seen {
  History history;
  std::vector<double> depth, force;  // of frames: the load's depth and the reaction of the patch
};

Seen march(const Model& model, const Tissues& tissues, double depth, const SolverOptions& options) {
  const ForceSystem system(model, tissues, Precision::single_);
  Seen seen;
  const Eigen::Vector4d approach = padded(model.tool.approach);
  const Observer observer{.frame = [&](const Frame& now) {
    double force = 0.0;
    for (const Index a : model.bonded_patch) force += now.f.col(a).dot(approach);
    seen.depth.push_back(now.depth);
    seen.force.push_back(force);
  }};
  solve(TimeMode::quasi_static, system, model, {.depth = depth, .rate = 1e-3}, options, observer,
        seen.history);
  return seen;
}

const ForceSample* sample_at(const History& history, double depth) {
  const auto found = std::find_if(history.force.begin(), history.force.end(),
                                  [&](const ForceSample& s) { return std::abs(s.depth - depth) < 1e-9; });
  return found == history.force.end() ? nullptr : &*found;
}

const Material plain = neo_hookean(210.0, 0.49, 1000.0);
const Material relaxing = material_from(numbers_of_preset("miller_chinzei_2002"));

TEST(Frames, HoweverManyLeaveTheForceAsItIsToTheBit) {
  const Model model = averaged_block(5);
  for (const Material& material : {plain, relaxing}) {
    const Tissues tissues{{material}, Eigen::VectorXi::Zero(model.point_count())};
    const Seen few = march(model, tissues, 4e-3, {.frames = 1, .step_radii = 0.1});
    ASSERT_EQ(few.history.force.size(), 11u) << "ten steps of a tenth of the radius";
    for (const int frames : {3, 4, 16, 100}) {
      SCOPED_TRACE(frames);
      const Seen many = march(model, tissues, 4e-3, {.frames = frames, .step_radii = 0.1});
      EXPECT_EQ(many.depth.size(), static_cast<std::size_t>(frames) + 1);
      for (const ForceSample& s : few.history.force) {
        const ForceSample* same = sample_at(many.history, s.depth);
        ASSERT_NE(same, nullptr) << s.depth;
        EXPECT_EQ(same->force, s.force) << s.depth;
      }
      EXPECT_EQ(many.history.evaluations, few.history.evaluations);
      EXPECT_EQ(many.history.J_min, few.history.J_min);
      ASSERT_EQ(many.history.energy.size(), few.history.energy.size());
      EXPECT_EQ(many.history.energy.back().external, few.history.energy.back().external);
      EXPECT_TRUE(std::is_sorted(many.history.force.begin(), many.history.force.end(),
                                 [](const auto& a, const auto& b) { return a.depth < b.depth; }));
    }
  }
}

TEST(Frames, AreEachInEquilibriumAtTheirOwnDepth) {
  const Model model = averaged_block(5);
  const Tissues tissues{{plain}, Eigen::VectorXi::Zero(model.point_count())};
  const Seen seen = march(model, tissues, 4e-3, {.frames = 7, .tolerance = 1e-6}),
             own = march(model, tissues, 4e-3, {.frames = 1, .step_radii = 1.0 / 7.0, .tolerance = 1e-6});
  ASSERT_EQ(seen.depth.size(), 8u);
  ASSERT_EQ(own.history.force.size(), 8u) << "the same depths, as steps";
  for (std::size_t k = 1; k < 8; ++k) {
    EXPECT_NEAR(seen.depth[k], 4e-3 * static_cast<double>(k) / 7.0, 1e-12);
    EXPECT_NEAR(seen.force[k] / own.history.force[k].force, 1.0, 1e-4) << k;
    const ForceSample* sample = sample_at(seen.history, seen.depth[k]);
    ASSERT_NE(sample, nullptr);
    EXPECT_NEAR(sample->force, seen.force[k], 1e-12);
  }
}

TEST(Frames, StepsGrowWithTheDepthInRadiiAlone) {
  const Model model = averaged_block(4);
  const double radius = model.tool.radius;
  EXPECT_EQ(steps_of_load(model, {.depth = 1.6 * radius}, {.frames = 3}), 8);
  EXPECT_EQ(steps_of_load(model, {.depth = 1.6 * radius}, {.frames = 300}), 8);
  EXPECT_EQ(steps_of_load(model, {.depth = 0.6 * radius}, {}), 3);
  EXPECT_EQ(steps_of_load(model, {.depth = 0.61 * radius}, {}), 4);
  EXPECT_EQ(steps_of_load(model, {.depth = 1e-9 * radius}, {}), 1);
  EXPECT_EQ(steps_of_load(model, {.depth = radius}, {.step_radii = 0.05}), 20);
}

}  // namespace
}  // namespace dimple::frames_test
