#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "apps/run/image_error_of_run.hpp"
#include "apps/run/words.hpp"

namespace dimple {
namespace {

using testing::HasSubstr;

// Force of a sphere on a half-space, proportional to depth^1.5, at five depths up to 2 mm; 10 mN there.
std::vector<ForceSample> sphere_curve() {
  std::vector<ForceSample> curve;
  for (int k = 0; k <= 4; ++k) {
    const double depth = 5e-4 * k, force = 0.01 * std::pow(depth / 2e-3, 1.5);
    curve.push_back({static_cast<double>(k), depth, force, force});
  }
  return curve;
}

UnderTool sphere_on(double thickness_mm, double voxel_mm = 1.0) {
  return {.voxel = 1e-3 * voxel_mm, .thickness = 1e-3 * thickness_mm, .contact = 3e-3, .has_contact = true};
}

TEST(ImageError, IsNotKnownWithoutVoxelsOrWithoutAForce) {
  EXPECT_FALSE(image_error(sphere_curve(), sphere_on(30.0, 0.0)).known());
  EXPECT_FALSE(image_error({}, sphere_on(30.0)).known());
  EXPECT_FALSE(ImageError().known());
  EXPECT_EQ(image_warning({}, 0.01, 2e-3, 0.0), "");
}

TEST(ImageError, HasAWidthForEachDepthAndNoneWhereNothingIsPressed) {
  const ImageError error = image_error(sphere_curve(), sphere_on(30.0));
  ASSERT_TRUE(error.known());
  ASSERT_EQ(error.half.size(), 5U);
  EXPECT_EQ(error.half[0], 0.0);
  for (std::size_t k = 1; k < 5; ++k) EXPECT_GT(error.half[k], error.half[k - 1]);
  EXPECT_DOUBLE_EQ(error.half.back(), std::hypot(error.shape, error.thickness));
}

TEST(ImageError, OfTheShapeIsTheChangeOfTheForceWithTheDepth) {
  UnderTool ridge = sphere_on(1e6);
  ridge.curvature = 1.0 / 4e-3;
  const double off = shape_error(ridge);
  EXPECT_DOUBLE_EQ(off, 1e-3 * shape_voxels / 16.0);
  const ImageError error = image_error(sphere_curve(), ridge);
  EXPECT_NEAR(error.shape, 0.01 * (std::pow(1.0 + off / 2e-3, 1.5) - 1.0), 1e-9);
  EXPECT_LT(error.thickness, 1e-6);
  ridge.curvature = 0.0, ridge.roughness = 1e-4;
  EXPECT_DOUBLE_EQ(shape_error(ridge), bumps * 1e-4);
  ridge.curvature = 1e4;
  EXPECT_DOUBLE_EQ(shape_error(ridge), most_shape_voxels * 1e-3) << "never more than half a voxel";
}

TEST(ImageError, IsSmallForAThickBodyThatIsFlatOrWide) {
  UnderTool dome = sphere_on(60.0);
  EXPECT_LT(image_error(sphere_curve(), dome).half.back(), 0.01 * 0.01);
  dome.curvature = 1.0 / 25e-3;
  EXPECT_LT(image_error(sphere_curve(), dome).half.back(), 0.01 * 0.01);
}

TEST(ImageError, OfTheBondedPatchIsByTheThicknessAlone) {
  UnderTool bonded_patch = sphere_on(10.0);
  bonded_patch.has_contact = false;
  bonded_patch.contact = 5e-3;
  const ImageError error = image_error(sphere_curve(), bonded_patch);
  EXPECT_EQ(error.shape, 0.0);
  EXPECT_DOUBLE_EQ(error.half.back(), 0.01 * thickness_exponent(0.5) * thickness_voxels * 0.1);
}

TEST(ImageError, OfTheThicknessFollowsTheLayersForce) {
  // Reference: -d ln F / d ln H by differences of the polynomial of Dimitriadis et al. (2002).
  const auto layer = [](double x) {
    return 1.0 + 1.133 * x + 1.283 * x * x + 0.769 * x * x * x + 0.0975 * x * x * x * x;
  };
  for (const double x : {0.05, 0.3, 1.0, 2.0}) {
    const double step = 1e-5, slope = std::log(layer(x * (1.0 + step)) / layer(x * (1.0 - step))) /
                                      std::log((1.0 + step) / (1.0 - step));
    EXPECT_NEAR(thickness_exponent(x), slope, 1e-8);
  }
  EXPECT_LT(thickness_exponent(0.02), 0.03) << "a thick body does not feel its base";
}

// Surface of these heights over a square of 40 mm, in triangles of a millimetre; outward is up.
Surface surface_of(const std::function<double(double, double)>& height_mm) {
  constexpr int count = 41;
  Surface surface;
  surface.vertex_mm.resize(3, count * count);
  surface.triangles.resize(3, 2 * (count - 1) * (count - 1));
  Index t = 0;
  for (int j = 0; j < count; ++j)
    for (int i = 0; i < count; ++i) {
      const double x = i - 20.0, y = j - 20.0;
      const int v = i + count * j;
      surface.vertex_mm.col(v) << x, y, height_mm(x, y);
      if (i + 1 == count || j + 1 == count) continue;
      surface.triangles.col(t++) << v, v + 1, v + count;
      surface.triangles.col(t++) << v + 1, v + count + 1, v + count;
    }
  return surface;
}

TEST(ImageError, TakesTheCurvatureUnderTheToolFromTheAreaThatItWouldOverlap) {
  RigidBody sphere;
  sphere.shape = sphere_shape(10e-3);
  RigidBody punch = sphere;
  punch.shape = punch_shape(8e-3, 2e-3);
  const Vec3 down = -Vec3::UnitZ();
  const Surface flat = surface_of([](double, double) { return 0.0; });
  const Surface hollow = surface_of([](double x, double y) { return (x * x + y * y) / 60.0; });
  const auto under = [&](const RigidBody& indenter, const Surface& surface) {
    UnderTool found;
    look_under(indenter, surface, down, 1e-3, found);
    return found;
  };
  for (const RigidBody* indenter : {&sphere, &punch}) {
    EXPECT_LT(under(*indenter, flat).curvature, 1.0);
    EXPECT_LT(under(*indenter, flat).roughness, 1e-9);
    EXPECT_EQ(under(*indenter, hollow).curvature, 0.0);
    for (const double radius : {6.0, 12.0}) {
      const UnderTool dome =
          under(*indenter, surface_of([&](double x, double y) { return -(x * x + y * y) / (2.0 * radius); }));
      EXPECT_NEAR(dome.curvature, 1e3 / radius, 0.15e3 / radius) << radius;
      EXPECT_LT(dome.roughness, 3e-5) << "a quadric, but for its triangles";
    }
  }
}

TEST(ImageError, OfTheThicknessIsLargerWhereAPartIsFreeToBend) {
  UnderTool part = sphere_on(30.0);
  part.is_free_below = true;
  EXPECT_DOUBLE_EQ(image_error(sphere_curve(), part).thickness,
                   0.01 * exponent_of_bending * thickness_voxels / 30.0);
}

TEST(ImageError, IsWarnedOfWithItsNumberReasonAndRemedy) {
  ImageError error{.unknown = "", .voxel = 1e-3, .shape = 2e-3, .thickness = 1e-4, .half = {2e-3}};
  const std::string words = image_warning(error, 0.01, 2e-3, 1e-3);
  EXPECT_THAT(words, HasSubstr("half a voxel changes the force by 20.0 %, +- 2.00 mN; voxels of 1.00 mm"));
  EXPECT_THAT(words, HasSubstr("shape under the tool uncertain"));
  EXPECT_THAT(words, HasSubstr("try: a finer image, a sharper tool or a greater depth"));
  EXPECT_EQ(image_warning(error, 0.01, 2e-3, 2.1e-3), "") << "the error of the discretisation is larger";
  error.half = {0.9e-3};
  EXPECT_EQ(image_warning(error, 0.01, 2e-3, 0.0), "") << "a tenth of the force, or less";
  error.shape = 1e-4, error.thickness = 2e-3, error.half = {2e-3};
  EXPECT_THAT(image_warning(error, 0.01, 2e-3, 0.0),
              HasSubstr("thickness under the tool uncertain; try: a finer image ["));
}

TEST(ImageError, IsInTheTitleInTheUnitOfTheForce) {
  EXPECT_EQ(plus_minus(0.0754, 0.00121, "image resolution"), ", +- 1.2 (image resolution)");
  EXPECT_EQ(plus_minus(0.0456, 0.0000361, "image resolution"), ", +- 0.036 (image resolution)");
}

}  // namespace
}  // namespace dimple
