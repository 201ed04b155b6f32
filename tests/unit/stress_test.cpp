// What a cell of `dimple stress` is worth: judged from numbers made up here.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>

#include "apps/studies/stress_maps.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

using testing::HasSubstr;

constexpr double circle_mm = 5.0;

/// A curve that stiffens, F = d^1.3, in ten frames.
StressRun stiffening(double factor = 1.0, Index nodes = 1000) {
  StressRun run{.ended = "", .fact = "", .frames = {}, .nodes = nodes, .guards = ""};
  for (int k = 1; k <= 10; ++k)
    run.frames.push_back({.depth_mm = 1.0 * k, .force_N = factor * 0.01 * std::pow(k, 1.3)});
  return run;
}

std::string code(const StressRun& run, std::size_t last = 10) {
  return judge(run, {stiffening(1.0, 4000)}, last, true, circle_mm).code;
}

TEST(StressVerdict, SurvivesWithinFivePercentOfTheFinest) {
  const StressVerdict v = judge(stiffening(1.04), {stiffening(1.0, 4000)}, 10, true, circle_mm);
  EXPECT_EQ(v.code, "ok");
  EXPECT_NEAR(v.error, 0.04, 1e-12);
  EXPECT_EQ(v.reference_nodes, 4000);
  EXPECT_EQ(code(stiffening(1.06)), "inaccurate");
  EXPECT_EQ(code(stiffening(0.94)), "inaccurate");
}

TEST(StressVerdict, TakesTheLargestErrorOfAllDepthsUnlessEachIsACellOfItsOwn) {
  StressRun run = stiffening();
  for (std::size_t k = 0; k < 10; ++k)  // too stiff half-way, right in the end
    run.frames[k].force_N *= 1.0 + 0.06 * std::sin(3.14159265358979 * static_cast<double>(k + 1) / 10.0);
  EXPECT_EQ(judge(run, {stiffening()}, 10, true, circle_mm).code, "ok");
  EXPECT_EQ(judge(run, {stiffening()}, 10, false, circle_mm).code, "inaccurate");
}

TEST(StressVerdict, ABendOfTheCurveIsAKinkAndStiffeningIsNone) {
  EXPECT_EQ(code(stiffening()), "ok");
  StressRun bent = stiffening();
  for (std::size_t k = 7; k < 10; ++k)  // no stiffer from there on, at half the slope
    bent.frames[k].force_N = bent.frames[k - 1].force_N + 0.01;
  EXPECT_EQ(code(bent, 7), "ok") << "before the bend";
  EXPECT_EQ(code(bent, 8), "kinked");
  EXPECT_EQ(code(bent, 10), "kinked") << "a curve with a bend stays one";
}

TEST(StressVerdict, WorkThatIsNotAccountedForIsAFault) {
  StressRun run = stiffening();
  for (std::size_t k = 5; k < 10; ++k) run.frames[k].energy_error = 0.03;
  EXPECT_EQ(code(run, 5), "ok");
  EXPECT_EQ(code(run, 6), "energy");
  EXPECT_EQ(code(run, 10), "energy");
}

TEST(StressVerdict, AFewInvertedPointsAtTheRimAreANoteAndManyAreAFault) {
  StressRun run = stiffening();
  const double half_ball = 2.0 / 3.0 * 3.14159265358979 * std::pow(circle_mm, 3);
  for (StressFrame& f : run.frames) f.J_min = -0.1, f.inverted = 12, f.inverted_mm3 = 0.009 * half_ball;
  EXPECT_EQ(code(run), "ok-rim");
  EXPECT_TRUE(survived("ok-rim"));
  run.frames.back().inverted_mm3 = 0.011 * half_ball;
  EXPECT_EQ(code(run), "inverted");
  EXPECT_FALSE(survived("inverted"));
}

TEST(StressVerdict, ANumberThatIsNoneIsAFault) {
  StressRun run = stiffening();
  run.frames[3].force_N = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(code(run), "non-finite");
  run = stiffening();
  run.frames[3].J_min = std::numeric_limits<double>::infinity();
  EXPECT_EQ(code(run), "non-finite");
}

TEST(StressVerdict, ARunThatEndedSaysWhyOnlyBeyondTheDepthThatItReached) {
  StressRun run = stiffening();
  run.frames.resize(6);
  run.ended = "no-equilibrium";
  EXPECT_EQ(code(run, 6), "ok");
  EXPECT_EQ(code(run, 7), "no-equilibrium");
}

TEST(StressVerdict, AFinestRunThatIsNotStableItselfIsNoReference) {
  StressRun broken = stiffening(1.5, 4000);
  for (std::size_t k = 7; k < 10; ++k) broken.frames[k].energy_error = 0.5;
  EXPECT_EQ(judge(stiffening(), {broken}, 7, true, circle_mm).code, "inaccurate") << "up to there it serves";
  EXPECT_EQ(judge(stiffening(), {broken}, 8, true, circle_mm).code, "unchecked");
  const StressVerdict next = judge(stiffening(), {broken, stiffening(1.0, 2000)}, 8, true, circle_mm);
  EXPECT_EQ(next.code, "ok");
  EXPECT_EQ(next.reference_nodes, 2000);
}

TEST(StressAxis, IsAnOptionWithItsUnitAndValues) {
  const StressAxis axis = stress_axis("material.mu=100,0.2kPa", "--x");
  EXPECT_EQ(axis.key, "material.mu_Pa");
  EXPECT_EQ(axis.values, (std::vector<std::string>{"100", "0.2kPa"}));
  EXPECT_TRUE(is_physical(axis.key));
  EXPECT_FALSE(is_physical("cloud.nodes"));
}

TEST(StressAxis, IsRefusedWhereItMakesNoMap) {
  const std::vector<std::pair<std::string, std::string>> wrong = {
      {"material.nu", "is not key=value"},
      {"material.nv=0.3,0.4", "did you mean 'material.nu'"},
      {"material.nu=0.3,0.7", "material.nu = 0.7 is not allowed"},
      {"material.nu=", "is not allowed"},
      {"material.nu=0.3", "has 1 value"},
      {"material.nu=0.3,0.3", "given twice"},
      {"load.depth=1mm,2mm,4mm", "the depths are not even steps"}};
  for (const auto& [text, words] : wrong) try {
      stress_axis(text, "--x");
      ADD_FAILURE() << text << " was taken";
    } catch (const UsageError& error) {
      EXPECT_THAT(error.report.fact, HasSubstr(words)) << text;
    }
}

TEST(StressMaps, NamesAreTheirOwnAndValuesAreTaken) {
  std::vector<std::string> names;
  for (const StressMap& map : stress_maps()) {
    names.push_back(map.name);
    EXPECT_NO_THROW(check_axis(map.x, "--x")) << map.name;
    EXPECT_NO_THROW(check_axis(map.y, "--y")) << map.name;
    Config config;
    for (const auto& [key, text] : map.settings) EXPECT_NO_THROW(set_option(config, key, text, map.name));
  }
  EXPECT_GE(names.size(), 6u);
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()).size(), names.size());
}

TEST(StressMaps, TheFinestRunIsTheSameCaseComputedAsUsual) {
  Config config;
  set_option(config, "material.nu", "0.3", "");
  set_option(config, "load.depth", "3mm", "");
  set_option(config, "cloud.jitter", "0.5", "");
  set_option(config, "support.radius_factor", "3", "");
  set_option(config, "scheme.name", "horton2007", "");
  set_option(config, "solver.frames", "6", "");
  const Config fine = finest_of(config, 4000);
  EXPECT_EQ(fine.material.nu, 0.3);
  EXPECT_EQ(fine.load.depth_mm, 3.0);
  EXPECT_EQ(fine.solver.frames, 6);
  EXPECT_EQ(fine.cloud.nodes, 4000);
  EXPECT_EQ(fine.cloud.jitter, 0.0);
  EXPECT_EQ(fine.support.radius_factor, 0.0);
  EXPECT_EQ(fine.scheme.name, "converging");
}

}  // namespace
}  // namespace dimple
