// Tissue geometries that confine the load path.

#include "preprocess/scene/load_path.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "preprocess/nodes/node_set.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

constexpr double exponent = 0.4, any_slope = 1e3;

double half_space(double from_centre, double radius) {
  return 1.0 / (std::numbers::pi * (2.0 * from_centre * from_centre + radius * radius));
}

Boundary patch_on_top(const BodySurface& body, double diameter_mm) {
  return find_boundary(body,
                       {.base = "inferior", .indent_at = "0,0,top", .indenter_diameter_mm = diameter_mm});
}

Points patch_edge_of(const BodySurface& body, const Boundary& boundary) {
  return edge_of_patch(body, boundary, 48);
}

TEST(LoadPath, InAColumnIsTheFluxThroughItsSection) {
  const BodySurface body = block_surface(Vec3(-10, -10, 0), Vec3(10, 10, 100));
  const Boundary boundary = patch_on_top(body, 8.0);
  const LoadPath path(body, boundary, patch_edge_of(body, boundary), exponent, any_slope);
  // Cells at the walls count fully: 15 of 1.39 mm for 20 mm, 3 % of the factor.
  for (const double depth : {20.0, 30.0, 40.0}) {
    const double more = 1.0 / (20.0 * 20.0) / half_space(depth, 4.0);
    EXPECT_NEAR(path(boundary.centre + depth * boundary.approach), std::pow(more, -exponent), 0.02)
        << depth << " mm";
  }
}

TEST(LoadPath, InAWideDeepBodyIsThatOfAHalfSpace) {
  const BodySurface body = block_surface(Vec3(-60, -60, 0), Vec3(60, 60, 120));
  const Boundary boundary = patch_on_top(body, 12.0);
  const LoadPath path(body, boundary, patch_edge_of(body, boundary), exponent, any_slope);
  for (const double depth : {15.0, 20.0, 30.0})
    EXPECT_GT(path(boundary.centre + depth * boundary.approach), 0.93) << depth << " mm";
}

TEST(LoadPath, GoesAroundASlitHoweverNarrow) {
  // The load passes behind a slit from below only: it is smaller there than in the whole block.
  const BodySurface whole = slit_block_surface({60, 60, 30}, 6.0, 2.0, 1.0),
                    slit = slit_block_surface({60, 60, 30}, 6.0, 0.05, 25.0);
  const LoadPath open(whole, patch_on_top(whole, 10.0), patch_edge_of(whole, patch_on_top(whole, 10.0)),
                      exponent, any_slope),
      cut(slit, patch_on_top(slit, 10.0), patch_edge_of(slit, patch_on_top(slit, 10.0)), exponent, any_slope);
  const Vec3 behind(12.0, 0.0, 12.0), before(3.0, 0.0, 12.0);
  EXPECT_LT(cut(before), open(before) - 0.01);
  EXPECT_GE(cut(behind), open(behind));
}

TEST(LoadPath, ChangesNowhereFasterThanRequested) {
  const BodySurface body = block_surface(Vec3(-10, -10, 0), Vec3(10, 10, 100));
  constexpr double slope = 1.0 / 60.0;
  const LoadPath path(body, patch_on_top(body, 8.0), patch_edge_of(body, patch_on_top(body, 8.0)), exponent,
                      slope);
  double before = path(Vec3(0, 0, 0.25));
  for (double z = 0.75; z < 100.0; z += 0.5) {
    const double here = path(Vec3(0, 0, z));
    EXPECT_LE(std::abs(here - before), 0.5 * slope + 1e-9) << z;
    before = here;
  }
}

TEST(NodeSet, KeepsItsInnerNodesAwayFromTheSurfaceOfAThinLayer) {
  // Such a node between those of the base has no resistance; one moved farther than the tool.
  const BodySurface body = block_surface(Vec3(-30, -30, 0), Vec3(30, 30, 15));
  const Boundary boundary = patch_on_top(body, 10.0);
  const GradingOptions grading = converging.grading;
  const Sizing sizing(body, boundary, grading);
  for (const std::uint64_t seed : {1, 2, 3, 4}) {
    const NodeSet node_set =
        make_node_set(body, boundary, sizing, {.count = 1000, .seed = seed, .grading = grading});
    for (Index a = node_set.surface_count; a < node_set.X.cols(); ++a) {
      ASSERT_TRUE(body.contains(node_set.X.col(a)));
      EXPECT_GT(body.closest(node_set.X.col(a)).distance, 0.3 * node_set.spacing[a]) << "seed " << seed;
    }
  }
}

}  // namespace
}  // namespace dimple
