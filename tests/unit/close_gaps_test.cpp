// Narrow gaps in a body: closed by a ball for any shape of voxels, and reported where they remain.

#include "preprocess/image/close_gaps.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/image/phantom.hpp"
#include "preprocess/surface/label_surface.hpp"
#include "tests/helpers/image.hpp"
#include "tests/helpers/report.hpp"

namespace dimple {
namespace {

std::int64_t voxels(const LabelImage& image) {
  std::int64_t count = 0;
  for (const Run& run : image.run) count += run.end - run.begin;
  return count;
}

/// A block of `size` voxels, with two empty ones around it. A slit of `wide` voxels across `axis` goes from
/// the top of another axis to `deep` of it.
LabelImage slit_block(std::array<Index, 3> size, const Vec3& spacing, std::size_t axis, Index wide) {
  const std::size_t up = (axis + 1) % 3;
  const Index from = 2 + size[axis] / 2, floor = 2 + size[up] / 3;
  std::array<Index, 3> all = size;
  for (Index& n : all) n += 4;
  return image_of(all, spacing, [&](Index i, Index j, Index k) {
    const std::array<Index, 3> at = {i, j, k};
    for (std::size_t d = 0; d < 3; ++d)
      if (at[d] < 2 || at[d] >= 2 + size[d]) return 0;
    return at[axis] >= from && at[axis] < from + wide && at[up] >= floor ? 0 : 1;
  });
}

TEST(CloseGaps, FillsASlitThatIsNarrowerAndLeavesAWiderOneAcrossAnyAxisOfAnyVoxels) {
  for (const Vec3& spacing : {Vec3(1, 1, 1), Vec3(0.5, 1, 2), Vec3(0.75, 0.75, 1.5)})
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (const Index wide : {1, 2, 3, 5, 7, 12}) {
        SCOPED_TRACE(testing::Message() << spacing.transpose() << " mm, axis " << axis << ", " << wide);
        const double across = spacing[static_cast<Index>(axis)], width = static_cast<double>(wide) * across;
        const LabelImage image = slit_block({40, 40, 40}, spacing, axis, wide);
        const std::int64_t slit = 64000 - voxels(image);
        const ClosedImage closed = close_gaps(image, {}, 4.0);
        const double fraction =
            static_cast<double>(voxels(closed.image) - voxels(image)) / static_cast<double>(slit);
        // The ball cannot reach the bottom edges of a wide slit; it sags into the mouth of a narrow one.
        if (width > 4.0) {
          EXPECT_LT(fraction, 0.1);
        } else if (width <= 4.0 - across) {
          EXPECT_GT(fraction, 0.7);
        }
        EXPECT_LE(voxels(closed.image), 64000);  // nothing is added outside of the block
      }
}

TEST(CloseGaps, SaysTheVolumeThatItAdds) {
  const Vec3 spacing(0.5, 1, 2);
  const LabelImage image = slit_block({40, 40, 20}, spacing, 0, 4);
  const ClosedImage closed = close_gaps(image, {}, 4.0);
  EXPECT_NEAR(closed.body_mm3, static_cast<double>(voxels(image)), 1e-6);  // of 1 mm3 each
  EXPECT_NEAR(closed.added_mm3, static_cast<double>(voxels(closed.image) - voxels(image)), 1e-6);
  EXPECT_GT(closed.added_mm3, 0.0);
  EXPECT_EQ(close_gaps(image, {}, 0.0).image.run, image.run);
}

TEST(CloseGaps, DoneTwiceIsDoneOnce) {
  const LabelImage image = image_of({50, 50, 30}, {0.7, 0.7, 1.3}, [](Index i, Index j, Index k) {
    const double x = 0.7 * static_cast<double>(i) - 17.0, y = 0.7 * static_cast<double>(j) - 17.0,
                 z = 1.3 * static_cast<double>(k) - 19.0;
    const double folds = 1.0 + 0.25 * std::sin(9.0 * std::atan2(y, x)) * std::sin(0.4 * z);
    return std::sqrt(x * x + y * y + z * z) < 13.0 * folds ? 1 : 0;
  });
  const ClosedImage once = close_gaps(image, {}, 4.0), twice = close_gaps(once.image, {}, 4.0);
  EXPECT_GT(once.added_mm3, 0.0);
  EXPECT_EQ(twice.added_mm3, 0.0);
  EXPECT_EQ(twice.image.run, once.image.run);
  EXPECT_GT(voxels(close_gaps(image, {}, 8.0).image), voxels(once.image));
}

TEST(CloseGaps, LeavesABodyWithoutGapsAlone) {
  const LabelImage block = make_phantom({.shape = "block", .size_mm = {40, 40, 20}, .spacing_mm = 1});
  EXPECT_EQ(close_gaps(block, {}, 4.0).image.run, block.run);
  const LabelImage ellipsoid = make_phantom({.shape = "cut-ellipsoid", .spacing_mm = 1.5});
  const ClosedImage closed = close_gaps(ellipsoid, {}, 4.0);
  EXPECT_LT(closed.added_mm3, 1e-3 * closed.body_mm3);
}

TEST(CloseGaps, WeldsNoOtherPieceOn) {
  // The image has a block, and a speck two voxels from it.
  const LabelImage image = image_of({40, 24, 24}, Vec3::Ones(), [](Index i, Index j, Index k) {
    const bool block = i >= 2 && i < 22 && j >= 2 && j < 22 && k >= 2 && k < 22;
    const bool speck = i >= 24 && i < 28 && j >= 10 && j < 14 && k >= 10 && k < 14;
    return block || speck ? 1 : 0;
  });
  EXPECT_EQ(close_gaps(image, {}, 4.0).added_mm3, 0.0);
}

TEST(CloseGaps, GivesTheAddedVoxelsTheNearestOfTheChosenLabels) {
  // The image has tissue 1 left of a slit, tissue 2 right of it, and fluid 7 within.
  const LabelImage image = image_of({44, 24, 24}, Vec3::Ones(), [](Index i, Index j, Index k) {
    if (i < 2 || i >= 42 || j < 2 || j >= 22 || k < 2 || k >= 22) return 0;
    if (i >= 20 && i < 23 && k >= 8) return 7;
    return i < 21 ? 1 : 2;
  });
  const LabelImage closed = close_gaps(image, {1, 2}, 4.0).image;
  EXPECT_EQ(closed.at(20, 12, 14), 1);
  EXPECT_EQ(closed.at(21, 12, 14), 1) << "of two as near the smaller";
  EXPECT_EQ(closed.at(22, 12, 14), 2);
  EXPECT_EQ(close_gaps(image, {}, 4.0).image.run, image.run) << "the fluid chosen too: there is no gap";
}

TEST(CloseGaps, IsTheSameHoweverTheBodyIsTurnedAndForAnyNumberOfThreads) {
  const Vec3 spacing(0.73242, 1.1, 1.7);
  const auto tissue = [&](double x, double y, double z) {
    const double folds = 1.0 + 0.2 * std::sin(8.0 * std::atan2(y, x)) + 0.1 * std::sin(z);
    return std::sqrt(x * x + y * y + 1.3 * z * z) < 14.0 * folds;
  };
  const std::array<Index, 3> size = {56, 38, 24};
  const auto at = [&](std::size_t d, Index i) {
    return spacing[static_cast<Index>(d)] * (static_cast<double>(i) - 0.5 * static_cast<double>(size[d] - 1));
  };
  const LabelImage image = image_of(
      size, spacing, [&](Index i, Index j, Index k) { return tissue(at(0, i), at(1, j), at(2, k)) ? 1 : 0; });
  // The image has its axes in another order, one of them backwards.
  const LabelImage turned = image_of(
      {size[2], size[0], size[1]}, Vec3(spacing[2], spacing[0], spacing[1]),
      [&](Index a, Index b, Index c) { return tissue(at(0, b), at(1, size[1] - 1 - c), at(2, a)) ? 1 : 0; });
  const LabelImage closed = close_gaps(image, {}, 4.0).image, other = close_gaps(turned, {}, 4.0).image;
  EXPECT_GT(voxels(closed), voxels(image));
  ASSERT_EQ(voxels(closed), voxels(other));
  for (Index k = 0; k < size[2]; ++k)
    for (Index j = 0; j < size[1]; ++j)
      for (Index i = 0; i < size[0]; ++i)
        ASSERT_EQ(closed.at(i, j, k), other.at(k, i, size[1] - 1 - j)) << i << ' ' << j << ' ' << k;
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(close_gaps(image, {}, 4.0).image.run, closed.run);
}

TEST(CloseGaps, OfAWidthBeyondTheOrganAreRefusedInWords) {
  const LabelImage block = make_phantom({.shape = "block", .size_mm = {40, 40, 20}, .spacing_mm = 1});
  expect_error<ModelError>([&] { close_gaps(block, {}, 25.0); },
                           {.fact = "20 mm", .where = "--close", .code = "close-too-wide"});
}

TEST(CloseGaps, AreLeftWhenTheWorkIsToEnd) {
  const LabelImage image = slit_block({40, 40, 40}, Vec3::Ones(), 0, 2);
  ask_to_stop(StopReason::interrupted);
  EXPECT_THROW(close_gaps(image, {}, 4.0), Stopped);
  forget_stop();
}

TEST(FacingFraction, OfASmoothBodyIsNoneAndOfASlitIsTheFractionOfItsWalls) {
  const double block = facing_fraction(
      make_body_surface(make_phantom({.shape = "block", .size_mm = {40, 40, 40}, .spacing_mm = 1}), {})
          .surface,
      4.0);
  EXPECT_EQ(block, 0.0);
  // A cube of 40 mm with a slit 2 mm wide and 26 mm deep has two walls of 40 x 26 mm in addition to its six
  // faces.
  const LabelImage image = slit_block({40, 40, 40}, Vec3::Ones(), 0, 2);
  const double walls = 2.0 * 40 * 26, fraction = walls / (6.0 * 40 * 40 + walls - 2.0 * (40 + 2 * 26));
  EXPECT_NEAR(facing_fraction(make_body_surface(image, {}).surface, 4.0), fraction, 0.03);
  EXPECT_LT(facing_fraction(make_body_surface(close_gaps(image, {}, 4.0).image, {}).surface, 4.0), 0.01);
  const LabelImage wide = slit_block({40, 40, 40}, Vec3::Ones(), 0, 6);
  EXPECT_LT(facing_fraction(make_body_surface(wide, {}).surface, 4.0), 0.02);
}

}  // namespace
}  // namespace dimple
