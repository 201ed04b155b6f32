// The surface between voxels, against the bodies that were voxelised. Lengths in voxels of 1 mm.
#include "preprocess/surface/boundary_fit.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "preprocess/surface/label_surface.hpp"
#include "tests/helpers/image.hpp"

namespace dimple {
namespace {

using Distance = std::function<double(const Vec3&)>;  // signed, negative inside

Distance ball(double radius) {
  return [radius](const Vec3& x) { return x.norm() - radius; };
}

Distance box(const Vec3& half) {
  return [half](const Vec3& x) {
    const Vec3 beyond = x.cwiseAbs() - half;
    return beyond.cwiseMax(0.0).norm() + std::min(beyond.maxCoeff(), 0.0);
  };
}

// Image whose voxels with centres inside are labelled. The body's centre is `offset` voxels from its middle.
LabelImage voxelised(const Distance& body, double reach, const Vec3& spacing, const Vec3& offset) {
  std::array<Index, 3> size;
  Vec3 corner;
  for (Index d = 0; d < 3; ++d) {
    const auto voxels = 2 * static_cast<Index>(std::ceil((reach + 4.0) / spacing[d]));
    size[static_cast<std::size_t>(d)] = voxels;
    corner[d] = spacing[d] * (offset[d] - 0.5 * static_cast<double>(voxels - 1));
  }
  const Eigen::Affine3d to_world = Eigen::Translation3d(corner) * Eigen::Scaling(spacing);
  LabelImage image = image_of(
      size, spacing, [&](Index i, Index j, Index k) { return body(to_world * place_of(i, j, k)) < 0.0; });
  image.to_world = to_world;
  return image;
}

// Evenly spread sequence of grid positions (Roberts 2018).
Vec3 grid_offset(int n) {
  const Vec3 step(0.8191725, 0.6710436, 0.5497005);
  const Vec3 at = Vec3::Constant(0.5) + n * step;
  return (at.array() - at.array().floor() - 0.5).matrix();
}

Points drawn(const LabelImage& image, SurfaceOptions options = {}) {
  const SegmentedBody body = make_body_surface(image, {}, options);
  return body.surface.to_world() * body.surface.vertex();
}

double rms_distance(const Points& vertex, const Distance& body) {
  double sum = 0.0;
  for (const auto& x : vertex.colwise()) sum += body(x) * body(x);
  return std::sqrt(sum / static_cast<double>(vertex.cols()));
}

// Largest error of the six extreme points along the grid's axes.
double worst_top(const Points& vertex, double radius) {
  const double above = (vertex.rowwise().maxCoeff().array() - radius).abs().maxCoeff();
  return std::max(above, (vertex.rowwise().minCoeff().array() + radius).abs().maxCoeff());
}

// The bounds are the design goals; the rounding of voxels is 0.29 rms and 0.5 at most.
TEST(SurfaceBetweenVoxels, OfABallHasItsTopsWhereverTheGridBegins) {
  for (const auto& [radius, at_top] : {std::pair(10.0, 0.2), {25.0, 0.12}})
    for (int n = 0; n < 4; ++n) {
      const Points vertex = drawn(voxelised(ball(radius), radius, Vec3::Ones(), grid_offset(n)));
      EXPECT_LE(worst_top(vertex, radius), at_top) << "radius " << radius << ", grid " << n;
      EXPECT_LE(rms_distance(vertex, ball(radius)), 0.05) << "radius " << radius << ", grid " << n;
    }
}

TEST(SurfaceBetweenVoxels, OfThickSlicesIsRoundBetweenThem) {
  const Points vertex = drawn(voxelised(ball(25.0), 25.0, Vec3(1, 1, 4), grid_offset(1)));
  EXPECT_LE(rms_distance(vertex, ball(25.0)), 0.15);  // terraces alone: 0.6
  EXPECT_LE(worst_top(vertex, 25.0), 1.0);            // a quarter of a slice
}

TEST(SurfaceBetweenVoxels, KeepsFlatFacesFlatAndEdgesWithinHalfAVoxel) {
  const Vec3 half = Vec3::Constant(12.0);
  const Points vertex = drawn(voxelised(box(half), 12.0, Vec3::Ones(), Vec3::Zero()));
  for (const auto& x : vertex.colwise()) {
    Vec3 depth = (x.cwiseAbs() - half).cwiseAbs();
    std::sort(depth.data(), depth.data() + 3);
    const bool far_from_edges = depth[1] > 5.0, far_from_corners = depth[2] > 3.0;
    const double most = far_from_edges ? 0.15 : far_from_corners ? 0.5 : 0.5 * std::sqrt(3.0);
    EXPECT_LE(std::abs(box(half)(x)), most) << x.transpose();
  }
}

TEST(SurfaceBetweenVoxels, OfATiltedBlockIsFlat) {
  const Vec3 half(16.0, 14.0, 9.0);
  const Mat3 turn =
      (Eigen::AngleAxisd(0.3, Vec3::UnitX()) * Eigen::AngleAxisd(0.2, Vec3::UnitY())).toRotationMatrix();
  const Distance tilted = [&](const Vec3& x) { return box(half)(turn.transpose() * x); };
  double sum = 0.0;
  int count = 0;
  const Points vertex = drawn(voxelised(tilted, 20.0, Vec3::Ones(), grid_offset(2)));
  for (const auto& x : vertex.colwise()) {
    Vec3 depth = ((turn.transpose() * x).cwiseAbs() - half).cwiseAbs();
    std::sort(depth.data(), depth.data() + 3);
    if (depth[1] < 5.0) continue;
    sum += tilted(x) * tilted(x), ++count;
  }
  EXPECT_GT(count, 500);
  EXPECT_LE(std::sqrt(sum / count), 0.06);
}

TEST(SurfaceBetweenVoxels, KeepsBothWallsOfASlit) {
  // The body is a block with a slit of two voxels down to its middle.
  const Distance slit = [](const Vec3& x) {
    return std::max(box(Vec3(14, 10, 10))(x), -box(Vec3(1.0, 30.0, 10.0))(x - Vec3(0, 0, 10)));
  };
  const Points vertex = drawn(voxelised(slit, 14.0, Vec3::Ones(), Vec3::Zero()));
  int left = 0, right = 0;
  for (const auto& x : vertex.colwise()) {
    if (std::abs(x[0]) > 3.0 || x[2] < 4.0 || x[2] > 7.0 || std::abs(x[1]) > 6.0) continue;
    EXPECT_NEAR(std::abs(x[0]), 1.0, 0.3);
    ++(x[0] < 0.0 ? left : right);
  }
  EXPECT_GT(left, 20);
  EXPECT_GT(right, 20);
}

TEST(SurfaceBetweenVoxels, DrawnOutwardIsThatFarOut) {
  for (const double outward : {-0.5, 0.5}) {
    const Points vertex =
        drawn(voxelised(ball(15.0), 15.0, Vec3::Ones(), grid_offset(3)), {.outward_mm = outward});
    EXPECT_NEAR(vertex.colwise().norm().mean(), 15.0 + outward, 0.06) << outward;
    EXPECT_LE(rms_distance(vertex, ball(15.0 + outward)), 0.1) << outward;
  }
}

TEST(BoundaryFit, LeavesVerticesWhereFacesDisagreeAndMovesNoneFarther) {
  // One voxel is added to a face of a block: no smooth surface agrees with it.
  LabelImage image = voxelised(box(Vec3::Constant(8.0)), 8.0, Vec3::Ones(), Vec3::Zero());
  VoxelSet set = voxels_with(image, {});
  SegmentedBody body = make_body_surface(image, {});
  TriangleMesh mesh{body.surface.vertex(), body.surface.triangles()};
  set.first = {1, 1, 1};  // the body's frame begins two voxels before it
  const Points before = mesh.vertex;
  const std::vector<double> determined = fit_to_boundary_faces(mesh, set, Mat3::Identity(), 1.0, 0.0);
  ASSERT_EQ(determined.size(), static_cast<std::size_t>(before.cols()));
  for (Index v = 0; v < before.cols(); ++v) {
    const double moved = (mesh.vertex.col(v) - before.col(v)).norm();
    EXPECT_LE(moved, 1.2 * 0.5 * std::sqrt(3.0));
    if (determined[static_cast<std::size_t>(v)] == 0.0) EXPECT_EQ(moved, 0.0);
  }
}

// A contour is tested, because the preserved volume of a closed surface would hide this.
TEST(BoundaryFit, KeepsAContourAsFarOutsideOfTheFacesAsItWasDrawn) {
  constexpr double radius = 12.0, outward = 0.5;
  const LabelImage image = voxelised(ball(radius), radius, Vec3::Ones(), Vec3::Zero());
  VoxelSet set = voxels_with(image, {});
  const SegmentedBody body = make_body_surface(image, {});
  set.first = {1, 1, 1};  // the body's frame begins two voxels before it
  TriangleMesh mesh{body.surface.vertex(), body.surface.triangles()};
  const Vec3 centre = mesh.vertex.rowwise().mean();
  for (Index v = 0; v < mesh.vertex.cols(); ++v)
    mesh.vertex.col(v) += outward * (mesh.vertex.col(v) - centre).normalized();
  fit_to_boundary_faces(mesh, set, Mat3::Identity(), 1.0, outward);
  EXPECT_NEAR((mesh.vertex.colwise() - centre).colwise().norm().mean(), radius + outward, 0.1);
}

}  // namespace
}  // namespace dimple
