#include "preprocess/output/reduce_surface.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "preprocess/surface/surface_cells.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

// Half an ellipsoid under a tool of 5 mm radius at its top.
const Surface& dome() {
  static const Surface surface = [] {
    const BodySurface body = cut_ellipsoid_surface({46.0, 31.0, 27.0}, -5.0, 240);
    return Surface{.vertex_mm = body.vertex(), .triangles = body.triangles()};
  }();
  return surface;
}
const ToolPlace tool{.centre = {0.0, 0.0, 27e-3}};

Vec3 corner(const ReducedSurface& reduced, Index triangle, int k) {
  return dome().vertex_mm.col(reduced.vertex[static_cast<std::size_t>(reduced.triangles(k, triangle))]);
}

double area(const ReducedSurface& reduced) {
  double sum = 0.0;
  for (Index t = 0; t < reduced.triangles.cols(); ++t) {
    const Vec3 a = corner(reduced, t, 0), b = corner(reduced, t, 1), c = corner(reduced, t, 2);
    sum += 0.5 * (b - a).cross(c - a).norm();
  }
  return sum;
}

ReducedSurface whole() {
  return reduced_surface(dome(), tool, dome().triangles.cols());
}

TEST(ReducedSurface, IsTheSurfaceItselfWhereThatIsSmallEnough) {
  const ReducedSurface same = whole();
  EXPECT_EQ(same.triangles, dome().triangles);
  ASSERT_EQ(static_cast<Index>(same.vertex.size()), dome().vertex_mm.cols());
  for (std::size_t v = 0; v < same.vertex.size(); ++v) EXPECT_EQ(same.vertex[v], static_cast<Index>(v));
}

TEST(ReducedSurface, HasAtMostAsManyTrianglesAsRequestedAndNotFarFewer) {
  for (const Index most : {200, 1000, 5000}) {
    const Index triangles = reduced_surface(dome(), tool, most).triangles.cols();
    EXPECT_LE(triangles, most);
    EXPECT_GE(triangles, most / 2) << most;
  }
  EXPECT_LE(reduced_surface(dome(), tool, 1).triangles.cols(), 1);
}

TEST(ReducedSurface, KeepsEveryVertexOnceAndEveryTriangleWhole) {
  const ReducedSurface reduced = reduced_surface(dome(), tool, 1000);
  EXPECT_EQ(std::set<Index>(reduced.vertex.begin(), reduced.vertex.end()).size(), reduced.vertex.size());
  EXPECT_GE(reduced.triangles.minCoeff(), 0);
  EXPECT_LT(reduced.triangles.maxCoeff(), static_cast<Index>(reduced.vertex.size()));
  for (const auto& t : reduced.triangles.colwise()) EXPECT_TRUE(t[0] != t[1] && t[1] != t[2] && t[2] != t[0]);
}

// Area that faces inwards, relative to the whole.
double turned_over(const ReducedSurface& reduced) {
  double sum = 0.0;
  for (Index t = 0; t < reduced.triangles.cols(); ++t) {
    const Vec3 a = corner(reduced, t, 0), b = corner(reduced, t, 1), c = corner(reduced, t, 2);
    const Vec3 normal = 0.5 * (b - a).cross(c - a), outwards = (a + b + c) / 3.0 - Vec3(0.0, 0.0, 5.0);
    if (normal.dot(outwards) < 0.0) sum += normal.norm();
  }
  return sum / area(reduced);
}

TEST(ReducedSurface, FacesOutwards) {
  for (const Index most : {1000, 4000, 16000})
    EXPECT_LT(turned_over(reduced_surface(dome(), tool, most)), 0.01) << most;
}

// Edges are cut off by one cube at most, so the lost area is proportional to the cube's edge: half.
TEST(ReducedSurface, LosesHalfAsMuchOfTheAreaWithFourTimesAsManyTriangles) {
  const auto lost = [](Index most) {
    return std::abs(1.0 - area(reduced_surface(dome(), tool, most)) / area(whole()));
  };
  EXPECT_LT(lost(4000), 0.5 * lost(1000));
  EXPECT_LT(lost(16000), 0.5 * lost(4000));
}

// The distance is checked for every triangle, not only near the vertex that represents others.
TEST(ReducedSurface, LiesAsNearToTheSurfaceAsItSays) {
  EXPECT_EQ(whole().within_mm, 0.0);
  double before = 0.0;
  for (const Index most : {4000, 1000}) {
    const ReducedSurface reduced = reduced_surface(dome(), tool, most);
    double farthest = 0.0;
    for (Index v = 0; v < dome().vertex_mm.cols(); v += 5) {
      double nearest2 = std::numeric_limits<double>::infinity();
      for (Index t = 0; t < reduced.triangles.cols(); ++t)
        nearest2 = std::min(nearest2, distance2_to_triangle(dome().vertex_mm.col(v), corner(reduced, t, 0),
                                                            corner(reduced, t, 1), corner(reduced, t, 2)));
      farthest = std::max(farthest, std::sqrt(nearest2));
    }
    EXPECT_LE(farthest, reduced.within_mm) << most;
    EXPECT_GT(reduced.within_mm, before) << "the fewer triangles the farther";
    EXPECT_LT(reduced.within_mm, 6.0) << most;
    before = reduced.within_mm;
  }
}

TEST(ReducedSurface, IsFinerUnderTheTool) {
  const ReducedSurface reduced = reduced_surface(dome(), tool, 1000);
  std::vector<double> near, far;
  for (Index t = 0; t < reduced.triangles.cols(); ++t) {
    const Vec3 a = corner(reduced, t, 0), b = corner(reduced, t, 1);
    const double distance = (a - 1e3 * tool.centre).norm() / (1e3 * tool.radius);
    if (distance < 2.0) near.push_back((b - a).norm());
    if (distance > 6.0) far.push_back((b - a).norm());
  }
  ASSERT_GT(near.size(), 20u);
  ASSERT_GT(far.size(), 20u);
  const auto median = [](std::vector<double>& of) {
    std::nth_element(of.begin(), of.begin() + static_cast<std::ptrdiff_t>(of.size() / 2), of.end());
    return of[of.size() / 2];
  };
  EXPECT_LT(median(near), 0.5 * median(far));
}

}  // namespace
}  // namespace dimple
