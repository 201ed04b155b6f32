// Where a body stands and where it is indented: a matter of the body, not of how it lies in its image.

#include "preprocess/boundary_conditions.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <functional>
#include <numbers>
#include <random>

#include "io/error.hpp"
#include "preprocess/circle_place.hpp"
#include "preprocess/flat_face.hpp"
#include "preprocess/phantom.hpp"
#include "preprocess/shapes.hpp"

namespace dimple {
namespace {

using Inside = std::function<bool(const Vec3&)>;

// A body within `reach` of the origin, in voxels of edge h whose lattice is turned by `grid`.
LabelImage image_of(const Inside& inside, double reach, double h, const Mat3& grid = Mat3::Identity()) {
  LabelImage image;
  const auto n = static_cast<Index>(2.0 * std::ceil(reach / h)) + 2;
  image.size = {n, n, n};
  image.to_world = Eigen::Affine3d::Identity();
  image.to_world.linear() = h * grid;
  // No place of the lattice is special to the body.
  image.to_world.translation() =
      -h * grid * (Vec3::Constant(0.5 * static_cast<double>(n - 1)) + Vec3(0.13, 0.29, 0.41));
  for (Index k = 0; k < n; ++k)
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i)
        image.voxel.push_back(
            inside(image.to_world * Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k))));
  return image;
}

Mat3 random_rotation(std::mt19937& random) {
  std::normal_distribution<double> normal;
  Eigen::Quaterniond q(normal(random), normal(random), normal(random), normal(random));
  return q.normalized().toRotationMatrix();
}

BodySurface turned(const BodySurface& body, const Mat3& rotation) {
  Eigen::Isometry3d to_world = body.to_world();
  to_world.linear() = rotation * to_world.linear();
  to_world.translation() = rotation * to_world.translation();
  return {body.vertex(), body.triangles(), to_world};
}

// Two hemispheres on a flat cut face at z = 0, the left one `higher` by this part; 84 x 62 x 30 mm.
bool in_brain(const Vec3& x, double higher) {
  if (x.z() < 0.0) return false;
  const double u = std::max(0.0, std::abs(x.x()) - 5.0) / 26.0, v = (x.y() - higher * 30.0) / 42.0;
  const double rho2 = u * u + v * v;
  if (rho2 >= 1.0) return false;
  const double dome = 30.0 * std::sqrt(1.0 - rho2) * (1.0 + (x.x() > 0.0 ? higher : 0.0));
  return x.z() < dome * (1.0 - 0.3 * std::exp(-std::pow(x.x() / 2.5, 2)));
}

double degrees_between(const Vec3& a, const Vec3& b) {
  return std::acos(std::clamp(a.normalized().dot(b.normalized()), -1.0, 1.0)) * 180.0 / std::numbers::pi;
}

// Base and circle in the patient's coordinates.
struct Found {
  Vec3 down, centre;
  double lowest, depth, room;
  std::string words;
};
Found find(const BodySurface& body, const BoundaryOptions& options = {}) {
  const Boundary b = find_boundary(body, options);
  const Vec3 down = body.to_world().linear() * b.down;
  return {down, body.to_world() * b.centre, b.lowest + down.dot(body.to_world().translation()), b.base_depth, b.room,
          b.base_reason + " | " + b.circle_reason};
}

int rotations(int usual) {
  const char* asked = std::getenv("DIMPLE_ROTATIONS");
  return asked ? std::atoi(asked) : usual;
}

struct Worst {
  double angle = 0.0, plane = 0.0, depth = 0.0, circle = 0.0;
  void add(const Found& first, const Found& now, const Mat3& rotation, double radius) {
    angle = std::max(angle, degrees_between(rotation.transpose() * now.down, first.down));
    plane = std::max(plane, std::abs(now.lowest - first.lowest));
    depth = std::max(depth, std::abs(now.depth / first.depth - 1.0));
    circle = std::max(circle, (rotation.transpose() * now.centre - first.centre).norm() / radius);
  }
  void print(const char* what, int count) const {
    fmt::print("{}: {} rotations: base within {:.2f} degrees and {:.3f} mm, its depth within {:.2f} %, circle within "
               "{:.3f} radii\n",
               what, count, angle, plane, 100.0 * depth, circle);
  }
};

TEST(Boundary, OfABlockIsItsBroadSideAndTheMiddleOfTheOtherOne) {
  const SegmentedBody body =
      make_body_surface(make_phantom({.shape = "block", .size_mm = {60, 60, 30}, .spacing_mm = 1.5}), {}, 5.0);
  const Boundary found = find_boundary(body.surface, {});
  EXPECT_TRUE(found.flat_base);
  EXPECT_LT((body.surface.to_world().linear() * found.down - Vec3(0, 0, -1)).norm(), 1e-12);
  const Vec3 centre = body.surface.to_world() * found.centre;
  EXPECT_LT(centre.head<2>().norm(), 0.1);
  EXPECT_NEAR(centre.z(), 30.0, 0.2);
  EXPECT_NE(found.base_reason.find("inferior"), std::string::npos);
  EXPECT_TRUE(found.warnings.empty());
}

TEST(Boundary, OfALopsidedBrainTurnsWithItInTheScannerAndInTheLattice) {
  const Inside brain = [](const Vec3& x) { return in_brain(x, 0.04); };
  const SegmentedBody body = make_body_surface(image_of(brain, 52.0, 2.0), {}, 5.0);
  const Found first = find(body.surface);
  fmt::print("({:.2f} {:.2f} {:.2f}) {}\n", first.centre.x(), first.centre.y(), first.centre.z(), first.words);
  std::mt19937 random(11);
  Worst with_voxels, within_voxels;
  const int many = rotations(60), few = rotations(12);
  for (int k = 0; k < many; ++k) {
    const Mat3 R = random_rotation(random);
    with_voxels.add(first, find(turned(body.surface, R)), R, 5.0);
  }
  with_voxels.print("the organ and its voxels", many);
  EXPECT_LT(with_voxels.angle, 1e-5);
  EXPECT_LT(with_voxels.plane, 1e-9);
  EXPECT_LT(with_voxels.depth, 1e-12);
  EXPECT_LT(with_voxels.circle, 1e-9);
  for (int k = 0; k < few; ++k) {
    const Mat3 R = random_rotation(random);
    const SegmentedBody again =
        make_body_surface(image_of([&](const Vec3& x) { return brain(R.transpose() * x); }, 52.0, 2.0), {}, 5.0);
    const Found f = find(again.surface);
    const Vec3 c = R.transpose() * f.centre;
    if (std::getenv("DIMPLE_VERBOSE")) fmt::print("({:.2f} {:.2f} {:.2f}) room {:.2f}; {}\n", c.x(), c.y(), c.z(), f.room, f.words);
    within_voxels.add(first, f, R, 5.0);
  }
  within_voxels.print("the organ within its voxels", few);
  EXPECT_LT(within_voxels.angle, 0.5);
  EXPECT_LT(within_voxels.plane, 0.2);
  EXPECT_LT(within_voxels.depth, 0.01);
  EXPECT_LT(within_voxels.circle, 0.2);
}

}  // namespace
}  // namespace dimple
