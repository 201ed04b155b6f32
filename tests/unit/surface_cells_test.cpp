#include "preprocess/surface/surface_cells.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

// Distance to a triangle's plane, or else to the nearest of its edges, by the plainest method.
double distance_to(const Vec3& x, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 n = (b - a).cross(c - a);
  const Vec3 foot = x - n.dot(x - a) / n.squaredNorm() * n;
  const auto left_of = [&](const Vec3& p, const Vec3& q) { return n.dot((q - p).cross(foot - p)) >= 0.0; };
  if (left_of(a, b) && left_of(b, c) && left_of(c, a)) return (foot - x).norm();
  const auto to_edge = [&](const Vec3& p, const Vec3& q) {
    const double t = std::clamp((x - p).dot(q - p) / (q - p).squaredNorm(), 0.0, 1.0);
    return (p + t * (q - p) - x).norm();
  };
  return std::min({to_edge(a, b), to_edge(b, c), to_edge(c, a)});
}

struct Body {
  BodySurface surface = cut_ellipsoid_surface({46.0, 31.0, 17.0}, -11.0, 48);
  SurfaceCells cells{surface.vertex(), surface.triangles()};

  double distance(const Vec3& x, Index t) const {
    const auto corner = [&](int k) { return Vec3(surface.vertex().col(surface.triangles()(k, t))); };
    return distance_to(x, corner(0), corner(1), corner(2));
  }
  double distance(const Vec3& x) const {
    double least = std::numeric_limits<double>::infinity();
    for (Index t = 0; t < surface.triangles().cols(); ++t) least = std::min(least, distance(x, t));
    return least;
  }
  // The triangulated body is convex: inside is behind the plane of every triangle.
  bool contains(const Vec3& x) const {
    for (Index t = 0; t < surface.triangles().cols(); ++t)
      if (surface.normal().col(t).dot(x - surface.vertex().col(surface.triangles()(0, t))) > 0.0)
        return false;
    return true;
  }
};

Vec3 random_place(std::mt19937& random) {
  std::uniform_real_distribution<double> part(-1.1, 1.1);
  const double x = part(random), y = part(random), z = part(random);
  return {46.0 * x, 31.0 * y, 17.0 * z};
}

// Every triangle within reach is visited, and none twice, from inside, far outside and on a corner.
TEST(BoxTree, MeetsEachTriangleWithinReachOnce) {
  const Body body;
  const BoxTree tree(body.surface.vertex(), body.surface.triangles());
  std::mt19937 random(7);
  std::vector<Vec3> places = {body.surface.vertex().col(0), {500.0, -300.0, 200.0}, {0.0, 0.0, 3.0}};
  for (int k = 0; k < 30; ++k) places.push_back(random_place(random));
  for (const Vec3& x : places)
    for (const double reach : {0.0, 1.5, 12.0, 700.0}) {
      struct Visit {
        double within;
        std::vector<int> met = {};
        double reach() const { return within; }
        void triangle(int t) { met.push_back(t); }
      } visit{reach};
      tree.around(x, visit);
      std::sort(visit.met.begin(), visit.met.end());
      EXPECT_EQ(std::adjacent_find(visit.met.begin(), visit.met.end()), visit.met.end());
      for (const int t : visit.met) {  // nor what its own box says to be farther
        const auto corner = [&](int k) {
          return Vec3(body.surface.vertex().col(body.surface.triangles()(k, t)));
        };
        const Vec3 low = corner(0).cwiseMin(corner(1)).cwiseMin(corner(2)),
                   high = corner(0).cwiseMax(corner(1)).cwiseMax(corner(2));
        EXPECT_LE((low - x).cwiseMax(x - high).cwiseMax(0.0).norm(), reach + 0.01);
      }
      for (Index t = 0; t < body.surface.triangles().cols(); ++t) {
        if (body.distance(x, t) > reach) continue;
        ASSERT_TRUE(std::binary_search(visit.met.begin(), visit.met.end(), static_cast<int>(t)))
            << t << " from " << x.transpose() << " within " << reach;
      }
    }
}

TEST(BoxTree, OfNoTrianglesMeetsNone) {
  struct Visit {
    double reach() const { return 1e3; }
    void triangle(int) { ADD_FAILURE(); }
  };
  BoxTree().around(Vec3::Zero(), Visit{});
  BoxTree(Points(3, 0), Triangles(3, 0)).around(Vec3::Zero(), Visit{});
}

TEST(SurfaceCells, DistinguishInsideFromOutsideAsThePlanesOfAConvexBodyDo) {
  Body body;
  int unmarked_queries = 0;
  std::mt19937 random(1);
  for (const bool marked : {false, true}) {
    SCOPED_TRACE(marked);
    if (marked)
      body.cells.mark_clear_cells([&](const Vec3& x) {
        ++unmarked_queries;
        return body.contains(x);
      });
    int unsaid = 0;
    constexpr int count = 4000;
    for (int k = 0; k < count; ++k) {
      const Vec3 x = random_place(random);
      const std::optional<bool> said = body.cells.contains(x);
      if (said)
        ASSERT_EQ(*said, body.contains(x)) << x.transpose();
      else
        ++unsaid;
    }
    EXPECT_LT(unsaid, count / 100);
  }
  EXPECT_EQ(unmarked_queries, 0);  // lines along the axes decide; they meet no edge here
}

TEST(SurfaceCells, LeaveAPlaceOnTheSurfaceToAnExactAnswer) {
  const Body body;
  for (Index t = 0; t < body.surface.triangles().cols(); t += 7) {
    Vec3 middle = Vec3::Zero();
    for (int k = 0; k < 3; ++k) middle += body.surface.vertex().col(body.surface.triangles()(k, t)) / 3.0;
    EXPECT_FALSE(body.cells.contains(middle).has_value()) << t;
    EXPECT_FALSE(body.cells.farther(middle, 0.0).value_or(false)) << t;
  }
}

TEST(SurfaceCells, NameTheNearestTriangleAmongTheSameCandidatesWhateverWasRequestedBefore) {
  const Body body;
  std::mt19937 random(5);
  std::vector<Index> first, again, elsewhere;
  for (int k = 0; k < 1000; ++k) {
    const Vec3 x = (k % 2 == 0 ? 2.0 : 1.0) * random_place(random);  // far outside of the grid too
    const double nearest = body.distance(x), near = body.cells.nearest(x, first);
    EXPECT_NEAR(near, nearest, 1e-9);
    ASSERT_FALSE(first.empty());
    double among = std::numeric_limits<double>::infinity();
    for (const Index t : first) among = std::min(among, body.distance(x, t));
    EXPECT_NEAR(among, nearest, 1e-9) << x.transpose();
    body.cells.nearest(random_place(random), elsewhere);
    EXPECT_EQ(body.cells.nearest(x, again), near);
    EXPECT_EQ(again, first);
  }
}

TEST(SurfaceCells, SayWhatIsFartherThanADistance) {
  const Body body;
  std::mt19937 random(3);
  for (int k = 0; k < 500; ++k) {
    const Vec3 x = random_place(random);
    const double away = body.distance(x);
    for (const double part : {0.3, 0.999, 1.001, 3.0})
      EXPECT_EQ(body.cells.farther(x, part * away), std::optional<bool>(part < 1.0)) << x.transpose();
  }
}

TEST(SurfaceCells, FindWhereALineAlongAnAxisPassesThrough) {
  const Body body;
  std::mt19937 random(4);
  std::vector<SurfaceCells::Hit> hits;
  int through = 0;
  for (int k = 0; k < 1000; ++k) {
    const Vec3 x = random_place(random);
    const int axis = k % 3;
    if (!body.cells.line(x, axis, -100.0, 100.0, hits)) continue;
    ASSERT_TRUE(hits.empty() || hits.size() == 2) << x.transpose();  // of a convex body
    for (const SurfaceCells::Hit& hit : hits) {
      Vec3 place = x;
      place[axis] = hit.at;
      EXPECT_LT(body.distance(place, hit.triangle), 1e-9);
    }
    through += !hits.empty();
    if (hits.size() == 2) {
      Vec3 between = x;
      between[axis] = 0.5 * (hits[0].at + hits[1].at);
      EXPECT_TRUE(body.contains(between));
    } else {
      EXPECT_FALSE(body.contains(x));
    }
  }
  EXPECT_GT(through, 300);
}

}  // namespace
}  // namespace dimple
