// Visibility through tissue and across air.

#include "preprocess/surface/sight.hpp"

#include <gtest/gtest.h>

#include <random>

#include "preprocess/build_model.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

constexpr double wall = 8.0, deep = 25.0;

BodySurface slit_block(double width) {
  return slit_block_surface({60.0, 60.0, 30.0}, wall, width, deep);
}

TEST(Sight, EndsAtASlitHoweverNarrowAndContinuesBelowIt) {
  for (const double width : {0.1, 0.5, 2.0}) {
    SCOPED_TRACE(width);
    const BodySurface body = slit_block(width);
    const double beyond = wall + width + 3.0;
    for (const double spacing : {0.5, 2.0, width / 0.05})  // the narrowest gap is a twenty-fifth of it
      for (const double y : {-20.0, 0.3, 11.0}) {
        EXPECT_FALSE(body.sees({5.0, y, 20.0}, {beyond, y + 1.0, 21.0}, spacing));
        EXPECT_FALSE(body.sees({wall, y, 20.0}, {wall + width, y, 20.0}, spacing)) << "from wall to wall";
        EXPECT_FALSE(body.sees({wall, y, 30.0}, {beyond, y, 29.0}, spacing)) << "from the edge";
        EXPECT_FALSE(body.sees({beyond, y, 29.0}, {wall, y, 30.0}, spacing)) << "to the edge";
        EXPECT_TRUE(body.sees({5.0, y, 3.0}, {beyond, y + 1.0, 2.0}, spacing));
        EXPECT_TRUE(body.sees({-20.0, y, 29.0}, {wall, y + 3.0, 10.0}, spacing)) << "up to the wall";
      }
  }
  EXPECT_TRUE(slit_block(0.1).sees({5.0, 0.0, 20.0}, {12.0, 0.0, 20.0}, 10.0)) << "a hair among far nodes";
}

TEST(Sight, ReachesEverywhereInAConvexBody) {
  const BodySurface body = cut_ellipsoid_surface({46.0, 31.0, 17.0}, -11.0, 48);
  const SurfaceCells cells(body.vertex(), body.triangles());
  std::mt19937 random(3);
  std::uniform_int_distribution<Index> any(0, body.vertex().cols() - 1);
  for (int k = 0; k < 2000; ++k) {
    const Vec3 x = body.vertex().col(any(random)), y = body.vertex().col(any(random));
    EXPECT_TRUE(sees(cells, x, y, 2.0)) << x.transpose() << " to " << y.transpose();
    if (k < 50) {
      EXPECT_TRUE(sees_all_within(cells, x, 30.0, 2.0));
    }
  }
}

TEST(Sight, PassesTheSurfaceWhereALineDoes) {
  const BodySurface body = slit_block(1.0);
  const SurfaceCells cells(body.vertex(), body.triangles());
  std::mt19937 random(5);
  std::uniform_real_distribution<double> part(-1.0, 1.0);
  std::vector<SurfaceCells::Crossing> crossings;
  const auto place = [&] {
    const double x = part(random), y = part(random), z = part(random);
    return Vec3(45.0 * x, 45.0 * y, 15.0 + 30.0 * z);  // some of them outside
  };
  for (int k = 0; k < 2000; ++k) {
    const Vec3 from = place(), to = place();
    cells.pass(from, to, crossings);
    std::vector<double> known = body.crossings(from, to - from);
    std::erase_if(known, [](double t) { return t < 0.0 || t > 1.0; });
    ASSERT_EQ(crossings.size(), known.size());
    for (std::size_t c = 0; c < known.size(); ++c) {
      EXPECT_NEAR(crossings[c].t, known[c], 1e-9);
      EXPECT_EQ(crossings[c].leave, body.contains(from) == (c % 2 == 0));
    }
    const auto first_entry = [&] {
      const auto entry =
          std::find_if(crossings.begin(), crossings.end(), [](const auto& one) { return !one.leave; });
      return entry == crossings.end() ? std::pair(Index{-1}, 0.0) : std::pair(entry->triangle, entry->t);
    };
    const auto of_all = first_entry();
    cells.pass(from, to, crossings, true);
    EXPECT_EQ(first_entry(), of_all);
  }
}

// A long triangle intersects the path at its far end, a small one before it.
TEST(Sight, FindsTheFirstEntryThoughAFartherOneIsInReachBefore) {
  Points vertex(3, 6 + 3 * 400);
  vertex.leftCols(6) << 0, 100, 0, 50, 50, 50,  //
      -30, 0, 30, -1, 1, 0,                     //
      0.9, -0.1, 0.9, -1, -1, 1;
  Triangles triangles(3, 402);
  triangles.leftCols(2) << 0, 5, 2, 4, 1, 3;
  for (int k = 0; k < 400; ++k) {  // small ones nearby, which make cells small
    triangles.col(2 + k) << 6 + 3 * k, 7 + 3 * k, 8 + 3 * k;
    const Vec3 at(0.25 * k, 40.0, 0.0);
    vertex.col(6 + 3 * k) = at;
    vertex.col(7 + 3 * k) = at + Vec3(1.0, 0.0, 0.0);
    vertex.col(8 + 3 * k) = at + Vec3(0.0, 1.0, 0.0);
  }
  const SurfaceCells cells(vertex, triangles);
  std::vector<SurfaceCells::Crossing> crossings;
  const Vec3 from(0.0, 0.0, 0.0), to(100.0, 0.0, 0.0);
  cells.pass(from, to, crossings);
  ASSERT_EQ(crossings.size(), 2u);
  EXPECT_FALSE(crossings[0].leave || crossings[1].leave);
  EXPECT_EQ(crossings[0].triangle, 1);
  cells.pass(from, to, crossings, true);
  ASSERT_FALSE(crossings.empty());
  EXPECT_EQ(crossings[0].triangle, 1);
}

// No support has nodes on both faces of the slit, except around its end; every node is in some support.
TEST(Sight, KeepsTheFacesOfASlitApartInAModel) {
  ModelOptions options;
  options.node_set.count = 1000;
  options.boundary = {.base = "inferior", .indent_at = "0,0,top", .indenter_diameter_mm = 10.0};
  const double width = 1.0;  // a twenty-fifth of a spacing is 0.8 mm far away
  const Model model = build_model(slit_block(width), options).model;
  EXPECT_GT(model.support_report.unseen, 1000);
  EXPECT_TRUE(model.support_report.unconnected.empty());
  Index both = 0, above = 0;
  for (Index q = 0; q < model.point_count(); ++q) {
    if (model.point(2, q) < 0.012) continue;  // m: 7 mm above the end
    ++above;
    bool near = false, far = false;
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k) {
      const Vec3 X = model.X.col(model.support.member[k]);
      if (X.z() < 0.012) continue;
      near = near || X.x() < 1e-3 * wall + 1e-6;
      far = far || X.x() > 1e-3 * (wall + width) - 1e-6;
    }
    both += near && far;
  }
  EXPECT_GT(above, 1000);
  EXPECT_EQ(both, 0);
}

}  // namespace
}  // namespace dimple
