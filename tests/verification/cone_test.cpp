// Cone with a rounded tip: distances compared with its profile, and contact with Sneddon's solutions.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "solver/terms/tool_shape.hpp"

namespace dimple {
namespace {

constexpr double degree = std::numbers::pi / 180.0;

struct Cone {
  double angle, tip, radius;
  ToolShape shape() const { return cone_shape(angle, tip, radius); }
  double junction() const { return tip * std::cos(angle); }  // radius where the sphere meets the flank
};

// Slender, usual and blunt cones, and one whose sphere is wider than its shaft.
const std::vector<Cone> cones = {{10.0 * degree, 0.2, 1.0},
                                 {30.0 * degree, 0.1, 1.0},
                                 {80.0 * degree, 2.0, 1.0},
                                 {30.0 * degree, 1.5, 1.0}};

// Highest of all tangents of the sphere that are no steeper than the flank.
double lower_surface(const Cone& cone, double r) {
  constexpr int tangents = 4000;
  double highest = 0.0;
  for (int k = 0; k <= tangents; ++k) {
    const double t = (0.5 * std::numbers::pi - cone.angle) * k / tangents;
    highest = std::max(highest, cone.tip * (1.0 - std::cos(t)) + (r - cone.tip * std::sin(t)) * std::tan(t));
  }
  return highest;
}

TEST(ToolCone, HasTheDistanceToTheNearestPlaceOfItsProfile) {
  for (const Cone& cone : cones) {
    const ToolShape shape = cone.shape();
    std::vector<std::pair<double, double>> profile;
    constexpr int count = 2000;
    for (int k = 0; k <= count; ++k) {
      const double r = cone.radius * k / count;
      profile.emplace_back(r, lower_surface(cone, r));
    }
    const double patch_edge = profile.back().second;
    for (int k = 0; k <= 2 * count; ++k)
      profile.emplace_back(cone.radius, patch_edge + 4.0 * cone.radius * k / count);
    for (int k = 0; k < 300; ++k) {
      const double r = 1.8 * cone.radius * std::abs(std::sin(1.7 * k)),
                   z = (patch_edge + 2.0) * std::sin(2.3 * k) + 0.5;
      double nearest = 1e9;
      for (const auto& [at_r, at_z] : profile) nearest = std::min(nearest, std::hypot(r - at_r, z - at_z));
      const bool is_inside = r < cone.radius && z > lower_surface(cone, r);
      EXPECT_NEAR(shape.profile(r, z).distance, is_inside ? -nearest : nearest, 3e-3)
          << cone.angle << " at " << r << ", " << z;
    }
  }
}

TEST(ToolCone, HasTheGradientOfItsDistanceAsNormal) {
  constexpr double h = 1e-6;
  for (const Cone& cone : cones) {
    const ToolShape shape = cone.shape();
    for (int k = 0; k < 300; ++k) {
      const double r = 0.01 + 1.8 * cone.radius * std::abs(std::sin(1.7 * k)), z = 3.0 * std::sin(2.3 * k);
      const ProfileDistance here = shape.profile(r, z);
      EXPECT_NEAR(std::hypot(here.by_r, here.by_z), 1.0, 1e-12);
      if (here.distance < 0.0) continue;
      EXPECT_NEAR(shape.profile(r - here.distance * here.by_r, z - here.distance * here.by_z).distance, 0.0,
                  1e-12);
      EXPECT_NEAR((shape.profile(r + h, z).distance - shape.profile(r - h, z).distance) / (2.0 * h),
                  here.by_r, 1e-4);
      EXPECT_NEAR((shape.profile(r, z + h).distance - shape.profile(r, z - h).distance) / (2.0 * h),
                  here.by_z, 1e-4);
    }
  }
}

TEST(ToolCone, HasItsLowerSurfaceAndItsOutlineWhereItsDistanceIsZero) {
  for (const Cone& cone : cones) {
    const ToolShape shape = cone.shape();
    EXPECT_EQ(shape.radius, cone.radius);
    EXPECT_NEAR(shape.profile(0.0, 0.0).distance, 0.0, 1e-15);
    for (double r = 0.0; r < cone.radius; r += 0.01) {
      EXPECT_NEAR(height_of_tool(shape, r), lower_surface(cone, r), 1e-5);
      EXPECT_NEAR(shape.profile(r, height_of_tool(shape, r)).distance, 0.0, 1e-12);
    }
    EXPECT_TRUE(std::isinf(height_of_tool(shape, 1.01 * cone.radius)));
    const std::vector<std::pair<double, double>> outline = shape.outline(6);
    for (std::size_t k = 0; k + 1 < outline.size(); ++k)
      EXPECT_NEAR(shape.profile(outline[k].first, outline[k].second).distance, 0.0, 1e-12) << k;
    EXPECT_EQ(outline[outline.size() - 2].first, cone.radius);
    EXPECT_EQ(outline.back().first, 0.0);
    EXPECT_EQ(outline.back().second, outline[outline.size() - 2].second);
  }
}

TEST(ToolCone, HasATipThatIsTangentToItsFlank) {
  constexpr double h = 1e-5;
  const Cone cone{30.0 * degree, 0.1, 1.0};
  const ToolShape shape = cone.shape();
  const double r = cone.junction(), flank = 1.0 / std::tan(cone.angle);
  EXPECT_NEAR((shape.height(r) - shape.height(r - h)) / h, flank, 1e-3);
  EXPECT_NEAR((shape.height(r + h) - shape.height(r)) / h, flank, 1e-6);
  EXPECT_NEAR((shape.height(0.9) - shape.height(0.8)) / 0.1, flank, 1e-9);
  const ProfileDistance sphere = shape.profile(r - h, shape.height(r - h)),
                        side = shape.profile(r + h, shape.height(r + h));
  EXPECT_NEAR(sphere.by_r, std::cos(cone.angle), 1e-3);
  EXPECT_NEAR(side.by_r, std::cos(cone.angle), 1e-9);
  EXPECT_NEAR(side.by_z, -std::sin(cone.angle), 1e-9);
}

// Sneddon 1965 for a sharp cone: F = 2/pi E* tan(angle) depth^2, contact radius 2/pi tan(angle) depth.
TEST(ToolCone, HasTheForceOfSneddonsConeWhereItsTipIsSmallComparedWithTheDepth) {
  for (const double angle : {20.0 * degree, 45.0 * degree, 70.0 * degree}) {
    const ToolShape shape = cone_shape(angle, 1e-5, 10.0);
    for (const double depth : {0.3, 1.0, 2.0}) {
      const double force = 2.0 / std::numbers::pi * std::tan(angle) * depth * depth;
      EXPECT_NEAR(half_space_force(shape, depth).value(), force, 5e-4 * force);
      const double radius = 2.0 / std::numbers::pi * std::tan(angle) * depth;
      EXPECT_NEAR(contact_radius(shape, depth), radius, 5e-4 * radius);
    }
  }
}

TEST(ToolCone, HasTheForceOfASphereWhereItsTipAloneIsInContact) {
  const Cone cone{30.0 * degree, 0.4, 2.0};
  const ToolShape shape = cone.shape(), sphere = sphere_shape(cone.tip);
  const double until = sphere.contact_depth(cone.junction());
  for (const double depth : {0.1 * until, 0.5 * until, 0.99 * until}) {
    EXPECT_NEAR(contact_radius(shape, depth), contact_radius(sphere, depth), 1e-12);
    const double force = half_space_force(sphere, depth).value();
    EXPECT_NEAR(half_space_force(shape, depth).value(), force, 1e-9 * force);
  }
  EXPECT_GT(half_space_force(shape, 2.0 * until).value(), half_space_force(sphere, 2.0 * until).value())
      << "beyond, the flank is below the sphere";
}

// Sneddon 1965 for any body of revolution z = f(r), with r = a sin(t): depth = a int f' dt, F / E* = 2 int
// r^2 f' dt, for t from 0 to pi/2.
TEST(ToolCone, HasTheDepthAndTheForceOfSneddonsIntegrals) {
  constexpr int count = 100000;
  for (const Cone& cone : cones) {
    const ToolShape shape = cone.shape();
    for (const double a : {0.05, 0.12, 0.3, 0.9}) {
      double depth = 0.0, force = 0.0;
      for (int k = 0; k < count; ++k) {
        const double dt = 0.5 * std::numbers::pi / count, r = a * std::sin((k + 0.5) * dt);
        const double slope =
            r < cone.junction() ? r / std::sqrt(cone.tip * cone.tip - r * r) : 1.0 / std::tan(cone.angle);
        depth += a * slope * dt;
        force += 2.0 * r * r * slope * dt;
      }
      EXPECT_NEAR(shape.contact_depth(a), depth, 1e-5 * depth) << cone.angle << ", " << a;
      EXPECT_NEAR(shape.contact_force(a), force, 1e-5 * force) << cone.angle << ", " << a;
    }
    EXPECT_NEAR(contact_radius(shape, 50.0), cone.radius, 1e-9) << "contact ends at the shaft";
  }
}

}  // namespace
}  // namespace dimple
