// A run restarted from a state of an earlier one ends with the same bits.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "solver/solve.hpp"
#include "tests/helpers/arch.hpp"

namespace dimple::restart_test {
namespace {

using namespace testing_bodies;
using Nodal = ForceSystem::Nodal;

struct Kept {
  int number;
  double t;
  Nodal u, f;
};
struct Result {
  History history;
  std::vector<Kept> frame;
  std::vector<std::pair<MarchState, std::size_t>> state;  // with the number of frames before it
};

/// `every`: number of steps between two states that are kept; 0: none.
Result march(TimeMode by, const Model& model, const Tissues& tissues, Precision precision,
             const Loading& loading, const SolverOptions& options, int every,
             const MarchState* from = nullptr) {
  const ForceSystem system(model, tissues, precision);
  ForceState forces(system);
  Result result;
  int steps = 0;
  Observer observer = {.frame =
                           [&](const Frame& now) {
                             result.frame.push_back({now.number, now.t, now.u, now.f});
                           },
                       .sample = {}};
  if (every > 0)
    observer.between_steps = [&](const std::function<MarchState()>& state) {
      if (steps++ % every == 0) result.state.emplace_back(state(), result.frame.size());
    };
  solve(by, system, model, loading, options, observer, result.history, from);
  return result;
}

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), sizeof(T) * a.size()) == 0;
}

void expect_same_end(const Result& whole, const Result& remaining, std::size_t frames_before) {
  EXPECT_TRUE(same_bits(whole.history.force, remaining.history.force));
  EXPECT_TRUE(same_bits(whole.history.energy, remaining.history.energy));
  EXPECT_EQ(whole.history.evaluations, remaining.history.evaluations);
  EXPECT_EQ(whole.history.extra_evaluations, remaining.history.extra_evaluations);
  EXPECT_EQ(whole.history.J_min, remaining.history.J_min);
  EXPECT_EQ(whole.history.inverted, remaining.history.inverted);
  EXPECT_EQ(whole.history.residual, remaining.history.residual);
  EXPECT_EQ(whole.history.dt_first, remaining.history.dt_first);
  EXPECT_EQ(whole.history.dt_smallest, remaining.history.dt_smallest);
  EXPECT_EQ(whole.history.momentum_error, remaining.history.momentum_error);
  ASSERT_EQ(whole.frame.size(), frames_before + remaining.frame.size());
  for (std::size_t k = 0; k < remaining.frame.size(); ++k) {
    const Kept &a = whole.frame[frames_before + k], &b = remaining.frame[k];
    EXPECT_EQ(a.number, b.number);
    EXPECT_EQ(a.t, b.t);
    EXPECT_EQ(a.u, b.u);
    EXPECT_EQ(a.f, b.f);
  }
}

History expect_restarts(TimeMode by, const Model& model, const Tissues& tissues, const Loading& loading,
                        const SolverOptions& options, int every = 1,
                        Precision precision = Precision::single_) {
  const Result alone = march(by, model, tissues, precision, loading, options, 0);
  const Result watched = march(by, model, tissues, precision, loading, options, every);
  expect_same_end(alone, watched, 0);
  EXPECT_GE(watched.state.size(), 3u);
  for (std::size_t k = 0; k < watched.state.size(); ++k) {
    SCOPED_TRACE("state " + std::to_string(k) + " of " + std::to_string(watched.state.size()));
    const auto& [state, frames] = watched.state[k];
    expect_same_end(alone, march(by, model, tissues, precision, loading, options, 0, &state), frames);
  }
  return alone.history;
}

Tissues one(const Material& material, const Model& model) {
  return {{material}, Eigen::VectorXi::Zero(model.point_count())};
}
const Material plain = neo_hookean(210.0, 0.49, 1000.0);
const Material relaxing = material_from(numbers_of_preset("miller_chinzei_2002"));

TEST(Restart, OfEquilibriumAtEachDepth) {
  const Model model = averaged_block(5);
  const Loading loading{.depth = 4e-3, .rate = 1e-3};
  expect_restarts(TimeMode::quasi_static, model, one(plain, model), loading, {.frames = 6});
  expect_restarts(TimeMode::quasi_static, model, one(relaxing, model), loading, {.frames = 6});
  expect_restarts(TimeMode::quasi_static, model, one(plain, model),
                  {.depth = 4e-3, .rate = 1e-3, .contact = Contact::frictionless}, {.frames = 6}, 1,
                  Precision::double_);
}

TEST(Restart, OfEquilibriumBeforeAndAfterALimitPoint) {
  const Model model = arch_under_a_pad();
  const Tissues tissues{{neo_hookean(2000.0, 0.45, 1000.0), neo_hookean(120.0, 0.45, 1000.0)}, model.label};
  const History history =
      expect_restarts(TimeMode::quasi_static, model, tissues, {.depth = 14e-3, .rate = 1e-3}, {.frames = 7},
                      2, Precision::double_);
  EXPECT_TRUE(std::any_of(history.guards.begin(), history.guards.end(),
                          [](const Finding& found) { return found.report.code == "limit-point"; }));
}

TEST(Restart, OfEquilibriumOfThePapersSchemeAtEachDepth) {
  const Model model = block(4);
  expect_restarts(
      TimeMode::quasi_static, model, one(plain, model), {.depth = 1e-3, .rate = 1e-3},
      {.frames = 5, .step_radii = 0.05, .tolerance = 1e-3, .guards = false});  // too coarse for guards
}

TEST(Restart, OfEveryWave) {
  const Model paper = block(4);
  const Loading loading{.depth = 0.4e-3, .rate = 20e-3};
  expect_restarts(TimeMode::explicit_, paper, one(plain, paper), loading, {.damping = 5.0, .frames = 5});
  const Model model = averaged_block(4);
  expect_restarts(TimeMode::explicit_, model, one(plain, model), loading,
                  {.frames = 4, .sample_rate = 2000.0});
  expect_restarts(TimeMode::explicit_, model, one(relaxing, model), loading, {.frames = 4}, 1,
                  Precision::double_);
}

}  // namespace
}  // namespace dimple::restart_test
