// Deliberate changes of an image or its surface, whose effect on the force is then measured.

#include "preprocess/image/change_image.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "preprocess/surface/label_surface.hpp"
#include "tests/helpers/image.hpp"

namespace dimple {
namespace {

const Vec3 half_lengths(14.0, 11.0, 9.0), middle(20.0, 18.0, 15.0);

// Ellipsoid of two labels, the smaller one in its core; an odd number of voxels along one axis.
LabelImage ellipsoid(const Vec3& spacing = Vec3(1.0, 1.0, 1.5)) {
  return image_of({41, 36, 20}, spacing, [&](Index i, Index j, Index k) {
    const Vec3 x = spacing.cwiseProduct(place_of(i, j, k));
    const double r = (x - middle).cwiseQuotient(half_lengths).norm();
    return r > 1.0 ? 0 : r > 0.5 ? 3 : 2;
  });
}

double volume_of(const LabelImage& image, int label) {
  for (const LabelMeasure& m : measure_labels(image))
    if (m.value == label) return m.volume_mm3;
  return 0.0;
}

TEST(DoubleVoxels, HoldTheSameLabelsAtTheSamePlaces) {
  const LabelImage fine = ellipsoid(), coarse = in_double_voxels(fine);
  EXPECT_EQ(coarse.size, (std::array<Index, 3>{21, 18, 10}));
  EXPECT_TRUE(coarse.spacing().isApprox(2.0 * fine.spacing()));
  for (const int label : {2, 3})
    EXPECT_NEAR(volume_of(coarse, label) / volume_of(fine, label), 1.0, 0.05) << label;
  const auto centre = [](const LabelImage& image) { return measure_labels(image).front().centre_mm; };
  EXPECT_LT((centre(coarse) - centre(fine)).norm(), 0.3) << "a tenth of a voxel";
}

TEST(DoubleVoxels, AreOfTheBodyWhereHalfOfThemIs) {
  // Labelled are half of the first two voxels, then three and five of eight, with two labels.
  const LabelImage fine = image_of({8, 2, 2}, Vec3::Ones(), [](Index i, Index j, Index k) {
    if (i < 4) return k > 0 ? 0 : i == j ? 7 : 5;
    if (i < 6) return i == 4 && j + k < 2 ? 5 : 0;
    return i == 6 || (j == 0 && k == 0) ? 7 : 0;
  });
  const LabelImage coarse = in_double_voxels(fine);
  EXPECT_EQ(coarse.at(0, 0, 0), 5) << "of two labels one, in turns";
  EXPECT_EQ(coarse.at(1, 0, 0), 0) << "of two borders one, in turns";
  EXPECT_EQ(coarse.at(2, 0, 0), 0);
  EXPECT_EQ(coarse.at(3, 0, 0), 7);
}

TEST(FarTissue, IsCutAwayOutsideOfACylinderAroundTheTool) {
  const LabelImage image = ellipsoid();
  const Vec3 direction = Vec3(0.2, 0.1, -1.0).normalized();
  const LabelImage near = without_far_tissue(image, middle, direction, 6.0);
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j)
      for (Index i = 0; i < image.size[0]; ++i) {
        const Vec3 d = image.to_world * place_of(i, j, k) - middle;
        const bool is_near = (d - d.dot(direction) * direction).norm() <= 6.0;
        ASSERT_EQ(near.at(i, j, k), is_near ? image.at(i, j, k) : 0);
      }
  EXPECT_GT(reach_of(image, {}, Vec3::UnitX()), reach_of(near, {}, Vec3::UnitX()));
  EXPECT_NEAR(reach_of(image, {}, Vec3::UnitX()), middle.x() + half_lengths.x(), 1.0);
  EXPECT_NEAR(reach_of(image, {2}, Vec3::UnitX()), middle.x() + 0.5 * half_lengths.x(), 1.0);
}

TEST(Surface, SmoothedTwiceAsMuchStillEnclosesTheVoxels) {
  const LabelImage image = ellipsoid();
  const SegmentedBody once = make_body_surface(image, {}),
                      twice = make_body_surface(image, {}, {.smoothing = 2.0});
  EXPECT_DOUBLE_EQ(twice.report.smoothing_mm, 2.0 * once.report.smoothing_mm);
  EXPECT_NEAR(twice.surface.volume() / once.report.voxel_volume_mm3, 1.0, 1e-3);
}

}  // namespace
}  // namespace dimple
