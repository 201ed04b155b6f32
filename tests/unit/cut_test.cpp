#include "preprocess/surface/cut.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "io/error.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

const Vec3 lower(-30.0, -30.0, 0.0), upper(30.0, 30.0, 30.0);
constexpr double gap = 0.5;

double all_pieces(const CutBody& of) {
  double sum = of.surface.volume() + of.removed_mm3;
  for (const CutPiece& piece : of.parted) sum += piece.volume_mm3;
  return sum;
}

TEST(ACut, LeavesOfABlockTheBlockWithThatSlit) {
  const BodySurface body = block_surface(lower, upper),
                    slit = slit_block_surface({60.0, 60.0, 30.0}, 8.0, gap, 25.0);
  const TriangleMesh blade =
      swept_sheet({8.25, -31.0, 30.0}, {8.25, 31.0, 30.0}, -Vec3::UnitZ(), 1.0, 25.0, 2.0);
  const CutBody is = cut(body, {blade}, gap, {0.0, 0.0, 30.0});
  EXPECT_NEAR(is.surface.volume(), slit.volume(), 1e-6);
  EXPECT_NEAR(is.surface.area(), slit.area(), 1e-6);
  EXPECT_NEAR(is.removed_mm3, 60.0 * 25.0 * gap, 1e-6);
  EXPECT_NEAR(is.area_mm2, 60.0 * 25.0, 1e-5);
  EXPECT_TRUE(is.parted.empty());
  for (const double x : {7.9, 8.1, 8.4, 8.6})
    for (const double z : {4.0, 6.0, 29.0})
      EXPECT_EQ(is.surface.contains({x, 3.0, z}), slit.contains({x, 3.0, z})) << x << ' ' << z;
  EXPECT_FALSE(is.surface.sees({7.0, 0.0, 20.0}, {10.0, 0.0, 20.0}, 2.0));
  EXPECT_TRUE(is.surface.sees({7.0, 0.0, 2.0}, {10.0, 0.0, 2.0}, 2.0)) << "beneath its end";
}

TEST(ACut, ThatEndsInTheTissueAllAroundIsAHollowOfItsOwnWidth) {
  const CutBody is = cut(block_surface(lower, upper),
                         {disc_sheet({0.0, 0.0, 15.0}, {0.0, 0.6, 0.8}, 10.0, 1.0)}, gap, {0.0, 0.0, 30.0});
  EXPECT_NEAR(is.removed_mm3, std::numbers::pi * 100.0 * gap, 0.002 * std::numbers::pi * 100.0 * gap);
  EXPECT_TRUE(is.parted.empty());
  EXPECT_NEAR(all_pieces(is), 108e3, 1e-4);
  EXPECT_FALSE(is.surface.contains({0.0, 0.0, 15.0}));
  EXPECT_FALSE(is.surface.sees({0.0, 0.0, 13.0}, {0.0, 0.0, 17.0}, 2.0));
}

TEST(ACut, ThroughAllOfTheBodyPartsItAndKeepsTheRequestedPiece) {
  const BodySurface body = block_surface(lower, upper);
  const TriangleMesh plane = disc_sheet({10.0, 0.0, 15.0}, {1.0, 0.0, 0.0}, 60.0, 5.0);
  const CutBody left = cut(body, {plane}, gap, {0.0, 0.0, 30.0}),
                right = cut(body, {plane}, gap, {20.0, 0.0, 30.0});
  EXPECT_NEAR(left.surface.volume(), 39.75 * 1800.0, 1e-4);
  EXPECT_NEAR(right.surface.volume(), 19.75 * 1800.0, 1e-4);
  ASSERT_EQ(left.parted.size(), 1U);
  EXPECT_NEAR(left.parted[0].volume_mm3, right.surface.volume(), 1e-6);
  EXPECT_NEAR(left.parted[0].centre.x(), 20.125, 1e-6);
}

TEST(ACut, CrossingAnotherOpensWhatEitherOpens) {
  const TriangleMesh along_y =
                         swept_sheet({0.0, -31.0, 30.0}, {0.0, 31.0, 30.0}, -Vec3::UnitZ(), 1.0, 20.0, 2.0),
                     along_x =
                         swept_sheet({-31.0, 3.0, 30.0}, {31.0, 3.0, 30.0}, -Vec3::UnitZ(), 1.0, 10.0, 2.0);
  const CutBody is = cut(block_surface(lower, upper), {along_y, along_x}, gap, {0.0, 0.0, 0.0});
  EXPECT_NEAR(is.removed_mm3, gap * (60.0 * 20.0 + 60.0 * 10.0 - gap * 10.0), 1e-6);
}

TEST(ACut, ThatMeetsNoTissueIsRefusedByThatReason) {
  const BodySurface body = block_surface(lower, upper);
  const TriangleMesh next_to = disc_sheet({100.0, 0.0, 0.0}, Vec3::UnitX(), 5.0, 1.0),
                     blade = disc_sheet({0.0, 0.0, 15.0}, Vec3::UnitX(), 5.0, 1.0);
  EXPECT_THROW(cut(body, {next_to}, gap, Vec3::Zero()), ModelError);
  EXPECT_THROW(cut(body, {blade, blade}, gap, Vec3::Zero()), ModelError) << "twice the same";
}

// Planes tangent to faces, through edges and corners, along the surface, outside: never an open surface or a
// lost piece of tissue.
TEST(ACut, OfAnyPlaceAndSizeLosesNoTissue) {
  constexpr int bodies = 60;
  const BodySurface ellipsoid = cut_ellipsoid_surface({30.0, 25.0, 20.0}, -8.0, 80),
                    block = block_surface(lower, upper);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> within(-1.0, 1.0);
  int cuts = 0, refused = 0;
  for (int k = 0; k < bodies; ++k) {
    const BodySurface& body = k % 2 ? block : ellipsoid;
    const auto place = [&] {
      return Vec3(25.0 * within(random), 25.0 * within(random), 25.0 * within(random));
    };
    const auto whole = [&](Vec3 x) { return k % 5 ? x : Vec3((x / 10.0).array().round() * 10.0); };
    std::vector<TriangleMesh> sheets;
    for (int n = 0; n < 1 + k % 3; ++n) {
      const Vec3 x = whole(place()), y = whole(place());
      if ((y - x).norm() < 1.0) continue;
      const Vec3 into = k % 5 ? (y - x).unitOrthogonal() : Vec3((y - x).cross(Vec3::UnitZ()).normalized());
      if (!(into.norm() > 0.5)) continue;
      sheets.push_back(n % 2 ? disc_sheet(x, y - x, 5.0 + 20.0 * std::abs(within(random)), 2.0)
                             : swept_sheet(x, y, into, 1.0, 5.0 + 20.0 * std::abs(within(random)), 2.0));
    }
    if (sheets.empty()) continue;
    try {
      const CutBody is = cut(body, sheets, gap, Vec3(0.0, 0.0, 10.0));
      EXPECT_NEAR(all_pieces(is), body.volume(), 1e-6 * body.volume()) << k;
      EXPECT_GT(is.removed_mm3, 0.0) << k;
      ++cuts;
    } catch (const ModelError& error) {
      EXPECT_EQ(error.report.fact, "a cut meets no tissue") << k;
      ++refused;
    }
  }
  EXPECT_GT(2 * cuts, bodies);
  EXPECT_GT(refused, 0);
}

}  // namespace
}  // namespace dimple
