// Preprocessing of a phantom: surface, base, patch, nodes, grid; and moving least squares on scattered nodes.

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "apps/scene/resolve.hpp"
#include "io/error.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/image/phantom.hpp"
#include "preprocess/surface/label_surface.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/image.hpp"

namespace dimple {
namespace {

SegmentedBody block_body() {
  return make_body_surface(make_phantom({.shape = "block", .size_mm = {60, 60, 30}, .spacing_mm = 1.5}), {});
}

/// The image with so many empty voxels added before and behind each axis.
LabelImage padded(const LabelImage& image, const std::array<Index, 3>& before,
                  const std::array<Index, 3>& behind) {
  LabelImage result;
  result.to_world = image.to_world;
  Vec3 corner;
  for (std::size_t d = 0; d < 3; ++d) {
    result.size[d] = before[d] + image.size[d] + behind[d];
    corner[static_cast<Index>(d)] = -static_cast<double>(before[d]);
  }
  result.to_world.translation() = image.to_world * corner;
  std::vector<std::int32_t> voxel;
  for (Index k = -before[2]; k < image.size[2] + behind[2]; ++k)
    for (Index j = -before[1]; j < image.size[1] + behind[1]; ++j)
      for (Index i = -before[0]; i < image.size[0] + behind[0]; ++i)
        voxel.push_back(i >= 0 && j >= 0 && k >= 0 && i < image.size[0] && j < image.size[1] &&
                                k < image.size[2]
                            ? image.at(i, j, k)
                            : 0);
  set_voxels(result, voxel);
  return result;
}

TEST(BodySurface, IsTheSameHoweverManyEmptyVoxelsSurroundTheBody) {
  std::mt19937 random(11);
  for (const char* shape : {"brain", "cut-ellipsoid"}) {
    SCOPED_TRACE(shape);
    LabelImage image = make_phantom({.shape = shape, .size_mm = {61, 44, 23}, .spacing_mm = 1.7});
    // The transform gives the body no special position or direction in the lattice.
    image.to_world = Eigen::Translation3d(17.123, -33.98, 91.3) *
                     Eigen::AngleAxisd(0.4, Vec3(0.3, -0.5, 1.0).normalized()) *
                     Eigen::Scaling(0.9, 1.0, 1.3) * image.to_world;
    const BodySurface body = make_body_surface(image, {}).surface;
    for (int draw = 0; draw < 4; ++draw) {
      std::array<Index, 3> before{}, behind{};
      for (std::size_t d = 0; d < 3; ++d) {
        before[d] = static_cast<Index>(random() % 12);
        behind[d] = static_cast<Index>(random() % 12);
      }
      const BodySurface again = make_body_surface(padded(image, before, behind), {}).surface;
      EXPECT_EQ(again.vertex(), body.vertex());
      EXPECT_EQ(again.triangles(), body.triangles());
      EXPECT_LT((again.to_world() * again.vertex() - body.to_world() * body.vertex()).cwiseAbs().maxCoeff(),
                1e-9);
    }
  }
}

TEST(BodySurface, IsTheSameWithASpeckElsewhereInTheImage) {
  const LabelImage image = make_phantom({.shape = "brain", .size_mm = {60, 44, 24}, .spacing_mm = 2});
  LabelImage speckled = padded(image, {9, 5, 7}, {4, 8, 6});
  std::vector<std::int32_t> voxel = every_voxel(speckled);
  voxel.front() = voxel.back() = 1;
  set_voxels(speckled, voxel);
  const SegmentedBody body = make_body_surface(image, {}), again = make_body_surface(speckled, {});
  EXPECT_EQ(again.report.pieces, 3);
  EXPECT_EQ(again.surface.vertex(), body.surface.vertex());
  EXPECT_EQ(again.surface.triangles(), body.surface.triangles());
  EXPECT_LT((again.surface.to_world().matrix() - body.surface.to_world().matrix()).cwiseAbs().maxCoeff(),
            1e-9);
}

TEST(BodySurface, NamesAChosenLabelOfWhichNothingIsInTheLargestPiece) {
  LabelImage image = padded(make_phantom({.shape = "block", .size_mm = {60, 60, 30}, .spacing_mm = 3}),
                            {4, 4, 4}, {4, 4, 4});
  std::vector<std::int32_t> voxel = every_voxel(image);
  voxel.front() = 2;
  set_voxels(image, voxel);
  EXPECT_EQ(make_body_surface(image, {1, 2})
                .report.warnings.front()
                .find("label 2 is dropped completely: choose it with --label 2"),
            0U);
}

TEST(BodySurface, RefusesASpeckAndALabelThatIsNotThere) {
  LabelImage image = make_phantom({.shape = "block", .size_mm = {60, 60, 30}, .spacing_mm = 3});
  EXPECT_THROW(make_body_surface(image, {9}), InputError);
  std::vector<std::int32_t> voxel(every_voxel(image).size(), 0);
  voxel[voxel.size() / 2] = 1;
  set_voxels(image, voxel);
  EXPECT_THROW(make_body_surface(image, {}), ModelError);
}

TEST(NodeSet, HasExactlyTheRequestedNumberOfEvenlySpacedNodesAndThePatchEdge) {
  const SegmentedBody body = block_body();
  const Boundary boundary = find_boundary(body.surface, {});
  const NodeSet node_set = make_node_set(body.surface, boundary, Sizing{}, {.count = 1200});
  EXPECT_EQ(node_set.X.cols(), 1200);
  const IntegrationGrid grid = make_integration_grid(body.surface, {}, 1200);
  const Evenness even = measure_evenness(node_set, grid.point);
  EXPECT_NEAR(even.mean, 0.95, 0.1);
  EXPECT_LT(even.spread, 0.1);
  EXPECT_GT(even.minimum, 0.6);
  EXPECT_LT(even.fill, 1.1);
  int patch_edge = 0;
  for (Index a = 0; a < node_set.X.cols(); ++a) {
    const Vec3 d = node_set.X.col(a) - boundary.centre;
    const double lateral = (d - d.dot(boundary.approach) * boundary.approach).norm();
    if (a < node_set.patch_node_count) patch_edge += std::abs(lateral - 5.0) < 1e-9;
    if (a >= node_set.patch_node_count && a < node_set.surface_count &&
        std::abs(d.dot(boundary.approach)) < 2.0) {
      EXPECT_GT(lateral, 5.0);
    }
    if (a < node_set.surface_count) {
      EXPECT_LT(body.surface.closest(node_set.X.col(a)).distance, 1e-6);
    } else {
      EXPECT_TRUE(body.surface.contains(node_set.X.col(a)));
    }
  }
  EXPECT_GE(patch_edge, 6);
}

TEST(NodeSet, IsAsDenseAtThePatchEdgeAsRequestedAndHasExactlyTheRequestedNumber) {
  const SegmentedBody body =
      make_body_surface(make_phantom({.shape = "block", .size_mm = Vec3(40, 40, 20)}), {});
  const Boundary boundary = find_boundary(body.surface, {});
  const GradingOptions grading = {.patch_edge = 0.2};
  const Sizing sizing(body.surface, boundary, grading);
  const NodeSet node_set = make_node_set(body.surface, boundary, sizing, {.count = 1500, .grading = grading});
  EXPECT_EQ(node_set.X.cols(), 1500);
  const Points patch_edge = edge_of_patch(body.surface, boundary, 16);
  for (const auto& x : patch_edge.colwise()) EXPECT_NEAR(sizing(x), 0.2, 0.01);
  EXPECT_EQ(sizing(boundary.centre + Vec3(0.0, 0.0, -18.0)), 1.0);
  const Evenness evenness = measure_evenness(node_set, node_set.X);
  EXPECT_GT(evenness.mean, 0.85);
  EXPECT_LT(evenness.spread, 0.2);
  EXPECT_GT(evenness.minimum, 0.3);
}

TEST(IntegrationGrid, ThatFollowsTheNodesHasTheBodysVolumeCentroidAndInertia) {
  const SegmentedBody body =
      make_body_surface(make_phantom({.shape = "block", .size_mm = Vec3(40, 40, 20)}), {});
  const Boundary boundary = find_boundary(body.surface, {});
  const Sizing sizing(body.surface, boundary, {.patch_edge = 0.2});
  const double spacing = spacing_for_count(body.surface, 1500, sizing);
  const IntegrationGrid grid = make_graded_grid(body.surface, {.ratio = 7.0}, 1500, sizing, spacing);
  EXPECT_NEAR(static_cast<double>(grid.point.cols()), 7.0 * 1500.0, 0.15 * 7.0 * 1500.0);
  EXPECT_NEAR(grid.volume.sum(), body.surface.volume(), 1e-9 * body.surface.volume());
  const Vec3 centroid = grid.point * grid.volume / grid.volume.sum();
  EXPECT_LT((centroid - body.surface.centroid()).norm(), 0.01);
  // Mean of (x - middle)^2 of a box a x b x c: a^2 / 12; its corners are slightly rounded.
  const Vec3 size = body.surface.upper() - body.surface.lower();
  for (int d = 0; d < 3; ++d) {
    double second = 0.0;
    for (Index q = 0; q < grid.point.cols(); ++q)
      second += grid.volume[q] * (grid.second_moments(d, q) + std::pow(grid.point(d, q) - centroid[d], 2));
    EXPECT_NEAR(second / grid.volume.sum(), size[d] * size[d] / 12.0, 0.03 * size[d] * size[d] / 12.0);
  }
}

TEST(IntegrationGrid, HasTheBodysVolumeAndCentroidAndAboutTheRequestedNumberOfPoints) {
  const SegmentedBody body = make_body_surface(make_phantom({.shape = "cut-ellipsoid", .spacing_mm = 2}), {});
  const IntegrationGrid grid = make_integration_grid(body.surface, {.count = 3000}, 2000);
  EXPECT_NEAR(grid.volume.sum(), body.surface.volume(), 0.005 * body.surface.volume());
  EXPECT_LT((grid.point * grid.volume / grid.volume.sum() - body.surface.centroid()).norm(), 0.1);
  EXPECT_NEAR(static_cast<double>(grid.volume.size()), 3000.0, 0.05 * 3000.0);
}

TEST(Description, KnowsUnitsRangesAndItsOwnFile) {
  Description given;
  set_option(given, "material.mu", "0.3kPa", "test");
  EXPECT_EQ(resolve(given).material.mu_Pa, 300.0);
  set_option(given, "load.depth_mm", "1cm", "test");
  EXPECT_EQ(resolve(given).depth_mm, 10.0);
  EXPECT_THROW(set_option(given, "material.nu", "0.5", "test"), UsageError);
  EXPECT_THROW(set_option(given, "cloud.nodes", "4250.5", "test"), UsageError);
  EXPECT_THROW(set_option(given, "material.mu", "3mm", "test"), UsageError);
  const auto file = test_folder() / "config.toml";
  std::ofstream(file) << to_toml(given, {});
  Description again;
  read_config(again, file);
  EXPECT_EQ(option_values(again), option_values(given));
  EXPECT_EQ(resolve(again).material.mu_Pa, 300.0);
  EXPECT_EQ(resolve(again).depth_mm, 10.0);
  EXPECT_EQ(did_you_mean("materal.mu", {"material.mu", "load.depth"}), ", did you mean 'material.mu'?");
}

}  // namespace
}  // namespace dimple
