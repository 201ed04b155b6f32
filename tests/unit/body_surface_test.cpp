// From a label image to a closed surface: whatever the body's shape and however fine its voxels.

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <map>
#include <random>

#include "io/error.hpp"
#include "preprocess/label_surface.hpp"

namespace dimple {
namespace {

template <class Inside>
LabelImage image_of(std::array<Index, 3> size, const Vec3& spacing, const Inside& inside) {
  LabelImage image;
  image.size = size;
  image.to_world = Eigen::Affine3d(Eigen::Scaling(spacing));
  std::vector<std::int32_t> voxel;
  for (Index k = 0; k < size[2]; ++k)
    for (Index j = 0; j < size[1]; ++j)
      for (Index i = 0; i < size[0]; ++i) voxel.push_back(inside(i, j, k) ? 1 : 0);
  image.voxel = std::move(voxel);
  return image;
}

bool in_box(Index i, Index j, Index k, std::array<Index, 3> low, std::array<Index, 3> high) {
  return i >= low[0] && i < high[0] && j >= low[1] && j < high[1] && k >= low[2] && k < high[2];
}

LabelImage ellipsoid(Index across, const Vec3& half) {
  return image_of({across, across, across}, Vec3::Ones(), [&](Index i, Index j, Index k) {
    const Vec3 x = Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)).array() -
                   0.5 * static_cast<double>(across - 1);
    return x.cwiseQuotient(half).squaredNorm() < 1.0;
  });
}

// Every edge has two triangles that run along it in opposite directions, and no triangle is a line.
void expect_closed_and_outward(const BodySurface& surface) {
  std::map<std::pair<Index, Index>, int> sides;
  for (const auto& t : surface.triangles().colwise())
    for (int c = 0; c < 3; ++c) ++sides[{t[c], t[(c + 1) % 3]}];
  for (const auto& [side, count] : sides) {
    ASSERT_NE(side.first, side.second);
    ASSERT_EQ(count, 1);
    ASSERT_EQ(sides.count({side.second, side.first}), 1u);
  }
  EXPECT_GT(surface.volume(), 0.0);
}

TEST(Surface, OfAnEllipsoidIsClosedHoweverMuchCoarserThanItsVoxels) {
  const LabelImage image = ellipsoid(127, {60.0, 50.0, 41.0});
  for (const double step : {1.0, 1.3, 2.0, 2.5, 3.0, 3.7, 5.0, 7.1, 10.0, 14.3, 20.0, 33.0, 50.0, 70.0, 100.0}) {
    SCOPED_TRACE(step);
    if (step > 45.0) {  // as wide as the body: it vanishes, which is said
      EXPECT_THROW(make_body_surface(image, {}, {.step_mm = step}), ModelError);
      continue;
    }
    const SegmentedBody body = make_body_surface(image, {}, {.step_mm = step});
    expect_closed_and_outward(body.surface);
    EXPECT_NEAR(body.surface.volume() / body.report.voxel_volume_mm3, 1.0, 1e-3);
    EXPECT_EQ(body.report.step_mm, step);
  }
}

}  // namespace
}  // namespace dimple
