#include "preprocess/image/phantom.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <set>

#include "io/error.hpp"
#include "tests/helpers/image.hpp"
#include "tests/helpers/report.hpp"

namespace dimple {
namespace {

double volume_cm3(const LabelImage& image) {
  double volume = 0.0;
  for (const LabelMeasure& label : measure_labels(image)) volume += label.volume_mm3 / 1000.0;
  return volume;
}

/// Box of the labelled voxels, faces included [mm].
Eigen::AlignedBox3d box(const LabelImage& image) {
  Eigen::AlignedBox3d box;
  const Vec3 half = image.spacing() / 2.0;
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j)
      for (Index i = 0; i < image.size[0]; ++i)
        if (image.at(i, j, k) != 0) {
          const Vec3 centre = image.to_world * place_of(i, j, k);
          box.extend(centre - half);
          box.extend(centre + half);
        }
  return box;
}

/// Label at a position [mm].
int label_at(const LabelImage& image, const Vec3& position) {
  const Vec3 v = image.to_world.inverse() * position;
  return image.at(std::lround(v.x()), std::lround(v.y()), std::lround(v.z()));
}

Report refusal(const PhantomOptions& options) {
  return report_of<UsageError>([&] { make_phantom(options); });
}

TEST(Phantom, BrainHasTheVolumeAndTheBoxOfTheMould) {
  for (const double h : {0.5, 1.0, 2.0}) {
    SCOPED_TRACE(h);
    const LabelImage brain = make_phantom({.spacing_mm = h});
    EXPECT_GT(volume_cm3(brain), 86.0);
    EXPECT_LT(volume_cm3(brain), 90.0);
    const Eigen::AlignedBox3d b = box(brain);
    EXPECT_NEAR(b.sizes().x(), 62.5, h);
    EXPECT_NEAR(b.sizes().y(), 92.5, h);
    EXPECT_NEAR(b.sizes().z(), 28.5, h);
    EXPECT_DOUBLE_EQ(b.min().z(), 0.0);  // the base is on voxel faces
    EXPECT_DOUBLE_EQ(b.min().x() + b.max().x(), 0.0);
    EXPECT_DOUBLE_EQ(b.min().y() + b.max().y(), 0.0);
  }
}

TEST(Phantom, BrainHasTwoMirroredHemispheresWithAFissureBetween) {
  const LabelImage brain = make_phantom({});
  const auto labels = measure_labels(brain);
  ASSERT_EQ(labels.size(), 2u);
  EXPECT_EQ(labels[0].name, "left_hemisphere");
  EXPECT_EQ(labels[1].name, "right_hemisphere");
  EXPECT_EQ(labels[0].voxels, labels[1].voxels);
  for (const LabelMeasure& label : labels) {
    EXPECT_EQ(label.pieces, 1) << label.name;
    EXPECT_FALSE(label.meets_border) << label.name;
  }
  EXPECT_EQ(label_at(brain, {15.5, 0, 10.5}), 1);  // left is +x
  EXPECT_EQ(label_at(brain, {-15.5, 0, 10.5}), 2);
  // The midline at the crest is open down to 9 mm below the top, closed a little lower, and 3 mm wide at half
  // depth.
  EXPECT_EQ(label_at(brain, {0.5, 0, 21.5}), 0);
  EXPECT_NE(label_at(brain, {0.5, 0, 18.5}), 0);
  EXPECT_EQ(label_at(brain, {0.5, 0, 24.5}), 0);
  EXPECT_NE(label_at(brain, {2.5, 0, 24.5}), 0);
  EXPECT_NE(label_at(brain, {6.5, 0, 27.5}), 0);  // the crests reach the full height
}

TEST(Phantom, BrainsDeepTissueLiesInsideBothHemispheres) {
  const LabelImage plain = make_phantom({}), deep = make_phantom({.two_labels = true});
  const auto labels = measure_labels(deep);
  ASSERT_EQ(labels.size(), 3u);
  EXPECT_EQ(labels[2].name, "deep_tissue");
  EXPECT_EQ(labels[2].pieces, 1);
  EXPECT_EQ(label_at(deep, {3, 0, 11.5}), 3);
  EXPECT_EQ(label_at(deep, {-3, 0, 11.5}), 3);
  const auto plain_voxel = every_voxel(plain), deep_voxel = every_voxel(deep);
  for (std::size_t v = 0; v < plain_voxel.size(); ++v)
    ASSERT_EQ(plain_voxel[v] != 0, deep_voxel[v] != 0);  // the same body
  for (Index k = 1; k + 1 < deep.size[2]; ++k)           // and wrapped all around
    for (Index j = 1; j + 1 < deep.size[1]; ++j)
      for (Index i = 1; i + 1 < deep.size[0]; ++i)
        if (deep.at(i, j, k) == 3) {
          ASSERT_TRUE(deep.at(i - 1, j, k) && deep.at(i + 1, j, k) && deep.at(i, j - 1, k) &&
                      deep.at(i, j + 1, k) && deep.at(i, j, k - 1) && deep.at(i, j, k + 1));
        }
}

TEST(Phantom, BlockHasExactlyItsVoxels) {
  const LabelImage block = make_phantom({.shape = "block", .size_mm = {60, 60, 30}});
  ASSERT_EQ(measure_labels(block).size(), 1u);
  EXPECT_EQ(measure_labels(block)[0].voxels, 108'000);
  EXPECT_TRUE(box(block).min().isApprox(Vec3(-30, -30, 0)));
  EXPECT_TRUE(box(block).max().isApprox(Vec3(30, 30, 30)));
  EXPECT_EQ(block.size, (std::array<Index, 3>{64, 64, 34}));

  const auto halves =
      measure_labels(make_phantom({.shape = "block", .size_mm = {60, 60, 30}, .two_labels = true}));
  ASSERT_EQ(halves.size(), 2u);
  EXPECT_EQ(halves[0].voxels, 54'000);
  EXPECT_EQ(halves[1].voxels, 54'000);
  EXPECT_EQ(halves[0].name, "lower_half");

  // Spacings without a finite binary fraction, and an odd number of voxels.
  EXPECT_EQ(
      measure_labels(make_phantom({.shape = "block", .size_mm = {3, 3, 2.7}, .spacing_mm = 0.1}))[0].voxels,
      30 * 30 * 27);
  EXPECT_EQ(
      measure_labels(make_phantom({.shape = "block", .size_mm = {9.9, 12, 9}, .spacing_mm = 0.3}))[0].voxels,
      33 * 40 * 30);
}

TEST(Phantom, CutEllipsoidAndCylinderApproachTheirFormulas) {
  // Cut ellipsoid: pi a b c times the integral of (1 - t^2) from -0.7 to 1.
  const double fraction = (1.0 - 1.0 / 3.0) + (0.7 - 0.343 / 3.0);
  for (const double h : {1.0, 0.5}) {
    const LabelImage ellipsoid =
        make_phantom({.shape = "cut-ellipsoid", .size_mm = {60, 50, 34}, .spacing_mm = h});
    const double exact = std::numbers::pi * 30 * 25 * 20 * fraction / 1000.0;
    EXPECT_NEAR(volume_cm3(ellipsoid), exact, 0.004 * exact);
    EXPECT_NEAR(box(ellipsoid).min().z(), -14.0, 1e-12);  // -0.7 c, on a face
    EXPECT_NEAR(box(ellipsoid).max().z(), 20.0, h);

    const LabelImage cylinder = make_phantom({.shape = "cylinder", .size_mm = {40, 40, 20}, .spacing_mm = h});
    const double cylinder_exact = std::numbers::pi * 400 * 20 / 1000.0;
    EXPECT_NEAR(volume_cm3(cylinder), cylinder_exact,
                0.007 * cylinder_exact);  // voxels in a disc of radius 20 h
    EXPECT_TRUE(box(cylinder).max().isApprox(Vec3(20, 20, 20)));
  }
  for (const char* shape : {"cut-ellipsoid", "cylinder"}) {
    const auto labels =
        measure_labels(make_phantom({.shape = shape, .size_mm = {40, 40, 34}, .two_labels = true}));
    ASSERT_EQ(labels.size(), 2u) << shape;
    EXPECT_EQ(labels[1].name, "core");
  }
}

TEST(Phantom, KeepsItsSizeOrder) {
  const Vec3 size(20, 30, 40);
  for (const char* shape : {"block", "cut-ellipsoid"})
    EXPECT_TRUE(box(make_phantom({.shape = shape, .size_mm = size})).sizes().isApprox(size, 0.06)) << shape;
  EXPECT_TRUE(
      box(make_phantom({.shape = "brain", .size_mm = size})).sizes().isApprox(Vec3(30, 20, 40), 0.06));
}

TEST(Phantom, HasBackgroundAllRoundAndIsTheSameEachTime) {
  for (const char* shape : {"brain", "block", "cut-ellipsoid", "cylinder"}) {
    const PhantomOptions options{
        .shape = shape, .size_mm = {33, 21, 17}, .spacing_mm = 0.7, .two_labels = true};
    const LabelImage once = make_phantom(options), twice = make_phantom(options);
    EXPECT_EQ(every_voxel(once), every_voxel(twice));
    for (const LabelMeasure& label : measure_labels(once)) {
      EXPECT_FALSE(label.meets_border) << shape;
      EXPECT_FALSE(label.name.empty()) << shape;
    }
    EXPECT_EQ(once.orientation, "LPS");
    EXPECT_GT(once.voxel_volume(), 0.0);
  }
}

TEST(Phantom, RefusesWhatMakesNoBody) {
  EXPECT_NE(refusal({.shape = "heart"}).why.find("cut-ellipsoid"), std::string::npos);
  EXPECT_NE(refusal({.shape = "heart"}).remedy.find("--shape"), std::string::npos);
  EXPECT_NE(refusal({.size_mm = {1, 0, 1}}).remedy.find("--size"), std::string::npos);
  EXPECT_NE(refusal({.size_mm = {1, std::nan(""), 1}}).remedy.find("--size"), std::string::npos);
  EXPECT_NE(refusal({.spacing_mm = -1.0}).remedy.find("--spacing"), std::string::npos);
  EXPECT_NE(refusal({.spacing_mm = std::nan("")}).remedy.find("--spacing"), std::string::npos);
  EXPECT_NE(refusal({.spacing_mm = 5.0}).fact.find("5.7 voxels across"), std::string::npos);
  EXPECT_NE(refusal({.spacing_mm = 0.01}).remedy.find("--spacing"), std::string::npos);  // too many
}

}  // namespace
}  // namespace dimple
