#include "apps/run/band.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "apps/run/simulate.hpp"
#include "preprocess/phantom.hpp"
#include "tests/helpers/band_scenes.hpp"

namespace dimple {
namespace {

constexpr double radius = 5e-3;

// Force k * depth at these depths [mm].
std::vector<ForceSample> curve(const std::vector<double>& depths_mm, double k) {
  std::vector<ForceSample> samples;
  for (const double mm : depths_mm) samples.push_back({mm, 1e-3 * mm, k * mm, k * mm});
  return samples;
}

TEST(Band, HoldsTheForceOf95In100ScenesWithTheMultiplierThatItHas) {
  const BandScores scores = band_scores(band_scenes(DIMPLE_BAND_SCENES));
  EXPECT_GE(std::count_if(scores.begin(), scores.end(), [](const auto& of) { return of.second.size() >= least_scenes; }),
            4);
  EXPECT_NEAR(conformal(scores, 0.95, least_scenes), band_multiplier, 0.005);
}

TEST(Band, OfADisplacementHasTheMultiplierOfItsScenesToo) {
  const BandScores scores = point_scores(point_scenes(DIMPLE_BAND_POINTS));
  EXPECT_GE(scores.at(1000).size(), least_points);
  EXPECT_NEAR(conformal(scores, 0.95, least_points), displacement_multiplier, 0.005);
}

TEST(Band, IsAsWideAsTheChangeAndTheFloorTimesTheMultiplier) {
  const std::vector<double> half =
      half_widths(curve({0, 1, 2, 3, 4}, 1.02), 4000, curve({0, 2, 4}, 1.0), radius, false);
  ASSERT_EQ(half.size(), 5u);
  EXPECT_EQ(half[0], 0.0);
  for (std::size_t k = 1; k < half.size(); ++k)
    EXPECT_NEAR(half[k], 1.02 * static_cast<double>(k) * band_half_width(0.02, 4000, {0.2 * static_cast<double>(k)}), 1e-12) << k;
  EXPECT_NEAR(band_half_width(0.02, 1000, {}), band_multiplier * (0.3 * 0.02 + 0.01), 1e-12);
  EXPECT_GT(band_half_width(0.0, 1000, {1.0}), band_half_width(0.0, 1000, {0.5})) << "deeper";
  EXPECT_GT(band_half_width(0.0, 1000, {0.5, true}), band_half_width(0.0, 1000, {0.5})) << "of several tissues";
}

TEST(Band, DoesNotTrustCloudsThatComeTogetherDeeperDown) {
  std::vector<ForceSample> coarse = curve({0, 1, 2}, 1.0);
  coarse[1].force = 0.9;
  const std::vector<double> half = half_widths(curve({0, 1, 2}, 1.0), 1000, coarse, radius, false);
  EXPECT_GE(half[2] / 2.0, half[1]);
}

TEST(Band, IsNotKnownDeeperThanTheCoarserCloudGoes) {
  EXPECT_TRUE(half_widths(curve({0, 1, 2}, 1.0), 1000, curve({0, 1}, 1.0), radius, false).empty());
  EXPECT_TRUE(half_widths({}, 1000, {}, radius, false).empty());
}

TEST(Band, ALadderBeginsBelowTheNodesThatMayWellDo) {
  const auto first_two = [](double wanted, double facing, double radii) {
    const Index expected = expected_nodes(wanted, facing, floor_of_force({radii})), first = first_rung(expected);
    return std::pair(first, second_rung(first, expected));
  };
  EXPECT_EQ(first_two(0.05, 0.0, 1.0), std::pair(Index{500}, Index{1000}));
  EXPECT_EQ(first_two(0.02, 0.0, 1.0), std::pair(Index{2000}, Index{4000}));
  EXPECT_EQ(first_two(0.01, 0.0, 1.0), std::pair(Index{4000}, Index{16'000}))
      << "soon an answer, if not that one";
  EXPECT_EQ(first_two(0.05, 0.2, 1.0), std::pair(Index{2000}, Index{4000})) << "of a folded body";
  EXPECT_EQ(first_two(0.0, 0.0, 1.0), std::pair(Index{500}, Index{1000}))
      << "nobody knows how much of it that is";
  EXPECT_EQ(first_two(1e-9, 0.0, 2.0).first, 4000) << "too much to ask for";
}

TEST(Band, ALadderLeapsWhereItsBandIsFarTooWide) {
  EXPECT_EQ(next_rung(1000, 0.015, 0.01), 2000);
  EXPECT_EQ(next_rung(1000, 0.05, 0.01), 4000);
}

// A block of two labels, which may be of one material or of two that are alike.
Result of_block(const std::map<std::string, std::string>& differing) {
  static const LabelImage image =
      make_phantom({.shape = "block", .size_mm = {60, 60, 30}, .spacing_mm = 3, .two_labels = true});
  Config config;
  config.cloud.nodes = 1000;
  config.load.depth_mm = 1.0;
  config.solver.frames = 4;
  if (!differing.empty()) config.tissue["2"] = differing;
  return simulate({.config = config, .image = &image, .band = true});
}

// Two tissues that are alike give the force of one, and the band that was measured where tissues meet.
TEST(Band, OfTwoTissuesIsWiderThoughTheyAreAlike) {
  const Result one = of_block({}), two = of_block({{"mu", "210Pa"}});
  ASSERT_TRUE(one.band.known()) << one.band.unknown;
  ASSERT_TRUE(two.band.known()) << two.band.unknown;
  const double force = one.history.force.back().force;
  EXPECT_NEAR(two.history.force.back().force, force, 0.01 * force);
  EXPECT_GT(two.band.half.back(), 1.2 * one.band.half.back());
}

// As wide as for two clouds that agree, and by more than nothing wider: they are two clouds.
TEST(Band, ComparesTheCloudWithAnother) {
  const Result result = of_block({});
  ASSERT_TRUE(result.band.known()) << result.band.unknown;
  const ForceSample& last = result.history.force.back();
  const double agreed = band_half_width(0.0, 1000, {last.depth / result.model.tool.radius});
  EXPECT_GT(result.band.half.back(), (agreed + 1e-4) * last.force);
  EXPECT_EQ(result.band.coarse_nodes, 500);
}

}  // namespace
}  // namespace dimple
