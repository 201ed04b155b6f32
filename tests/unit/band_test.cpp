#include "apps/run/band.hpp"

#include <gtest/gtest.h>

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

TEST(Band, HoldsTheForceOf95In100ScenesWithTheMultipliersThatItHas) {
  const std::vector<BandScene> scenes = band_scenes(DIMPLE_BAND_SCENES);
  const std::vector<double> shallow = band_scores(scenes, false), deep = band_scores(scenes, true);
  EXPECT_GE(shallow.size(), 40u);
  EXPECT_NEAR(conformal(shallow, 0.95), band_multiplier, 0.005);
  EXPECT_NEAR(conformal(deep, 0.95), band_multiplier_deep, 0.005);
}

TEST(Band, IsAsWideAsTheChangeAndTheFloorTimesTheMultiplier) {
  const std::vector<double> half =
      half_widths(curve({0, 1, 2, 3, 4}, 1.02), 4000, curve({0, 2, 4}, 1.0), radius);
  ASSERT_EQ(half.size(), 5u);
  EXPECT_EQ(half[0], 0.0);
  for (std::size_t k = 1; k < half.size(); ++k)
    EXPECT_NEAR(half[k], 1.02 * static_cast<double>(k) * band_multiplier * (0.02 + 0.015), 1e-12) << k;
}

TEST(Band, DoesNotTrustCloudsThatComeTogetherDeeperDown) {
  std::vector<ForceSample> coarse = curve({0, 1, 2}, 1.0);
  coarse[1].force = 0.9;
  const std::vector<double> half = half_widths(curve({0, 1, 2}, 1.0), 1000, coarse, radius);
  EXPECT_NEAR(half[2] / 2.0, half[1], 1e-12);
}

TEST(Band, IsNotKnownDeeperThanTheCoarserCloudGoes) {
  EXPECT_TRUE(half_widths(curve({0, 1, 2}, 1.0), 1000, curve({0, 1}, 1.0), radius).empty());
  EXPECT_TRUE(half_widths({}, 1000, {}, radius).empty());
}

TEST(Band, ALadderBeginsBelowTheNodesThatMayWellDo) {
  const auto first_two = [](double wanted, double facing, double radii) {
    const Index expected = expected_nodes(wanted, facing, radii), first = first_rung(expected);
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
