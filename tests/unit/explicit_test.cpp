
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/error.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/system.hpp"

namespace dimple::explicit_test {
namespace {

using namespace testing_bodies;
using testing::HasSubstr;

const Material tissue = neo_hookean(210.0, 0.49, 1000.0);
const Loading short_press = {.depth = 0.5e-3, .rate = 10e-3};

TEST(Simulate, GivesAFrameAtTheStartAndAfterEverySegmentAndEndsAtTheRequestedDepth) {
  const Model model = block(4);
  const ForceSystem system(model, tissue);
  std::vector<int> numbers;
  std::vector<double> depths;
  const Observer observer = {.frame =
                                 [&](const Frame& frame) {
                                   numbers.push_back(frame.number);
                                   depths.push_back(frame.depth);
                                   for (const Index a : model.bonded_patch) {
                                     EXPECT_NEAR(frame.u(2, a), -frame.depth, 1e-15);
                                     EXPECT_EQ(frame.u(0, a), 0.0);
                                   }
                                   for (const Index a : model.base) EXPECT_EQ(frame.u.col(a).norm(), 0.0);
                                 },
                             .sample = {}};
  History history;
  solve(TimeMode::explicit_, system, model, short_press, {.frames = 5}, observer, history);
  EXPECT_THAT(numbers, testing::ElementsAre(0, 1, 2, 3, 4, 5));
  for (std::size_t k = 0; k < depths.size(); ++k)
    EXPECT_NEAR(depths[k], 0.1e-3 * static_cast<double>(k), 1e-15);
  EXPECT_NEAR(history.force.back().depth, 0.5e-3, 1e-15);
  EXPECT_NEAR(history.force.back().t, 0.05, 1e-12);
  EXPECT_NEAR(history.force.front().force, 0.0, 1e-12);  // N: rounding of stresses that cancel
  EXPECT_GT(history.force.back().force, 0.0);
  EXPECT_LE(history.dt_first, 0.9 * history.dt_stable_first);
  EXPECT_FALSE(history.interrupted);
}

TEST(Simulate, SamplesAtTheRequestedRate) {
  const Model model = block(4);
  const History history = marched(TimeMode::explicit_, model, tissue, short_press,
                                  {.frames = 2, .sample_rate = 400.0, .energy_rate = 100.0});
  EXPECT_EQ(history.force.size(), 21u);  // 0.05 s: 0 ... 19 at the rate, and the end
  EXPECT_EQ(history.energy.size(), 6u);
  for (std::size_t k = 0; k + 1 < history.force.size(); ++k)
    EXPECT_NEAR(history.force[k].t, static_cast<double>(k) / 400.0,
                1.001 * history.dt_first);  // at the first step that is not earlier
}

TEST(Simulate, StopsWhenTheObserverSaysSoAndKeepsWhatThereIs) {
  const Model model = block(4);
  const ForceSystem system(model, tissue);
  int last_frame = -1;
  double last_t = 0.0;
  const Observer observer = {
      .frame =
          [&](const Frame& frame) {
            last_frame = frame.number;
            last_t = frame.t;
          },
      .sample = [](const ForceSample& sample, const History&) { return sample.t < 0.02; }};
  History history;
  solve(TimeMode::explicit_, system, model, short_press, {.frames = 5}, observer, history);
  EXPECT_TRUE(history.interrupted);
  EXPECT_GT(last_frame, 0);
  EXPECT_EQ(last_t, history.force.back().t);
  EXPECT_GT(history.force.back().t, 0.02);
  EXPECT_LT(history.force.back().t, 0.03);
}

TEST(Simulate, NothingFreeToMoveIsRefused) {
  Model model = block(3);
  model.base.clear();
  for (Index a = 0; a < model.node_count(); ++a)
    if (std::find(model.bonded_patch.begin(), model.bonded_patch.end(), a) == model.bonded_patch.end())
      model.base.push_back(a);
  History history;
  EXPECT_THROW(
      solve(TimeMode::explicit_, ForceSystem(model, tissue), model, short_press, {.frames = 1}, {}, history),
      SolveError);
}

}  // namespace
}  // namespace dimple::explicit_test
