#include "apps/run/band.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

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

}  // namespace
}  // namespace dimple
