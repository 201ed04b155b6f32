#include "preprocess/nodes/neighbours.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace dimple {
namespace {

Points scattered(Index count, unsigned seed = 11) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> place(-1.0, 1.0);
  return Points::NullaryExpr(3, count, [&] { return place(random); });
}

Points lattice(int n) {
  Points result(3, n * n * n);
  for (int a = 0; a < n * n * n; ++a) result.col(a) = Vec3(a % n, (a / n) % n, a / (n * n));
  return result;
}

TEST(Neighbours, WithinARadiusAreThoseThatATestOfAllFindsAscending) {
  const Points points = scattered(500);
  const Neighbours tree(points);
  std::vector<int> found;
  for (const Vec3& x : {Vec3(0, 0, 0), Vec3(0.9, -0.8, 0.2), Vec3(5, 0, 0)})
    for (const double radius : {0.0, 0.1, 0.4, 10.0}) {
      SCOPED_TRACE(radius);
      std::vector<int> expected;
      for (int a = 0; a < points.cols(); ++a)
        if ((points.col(a) - x).squaredNorm() < radius * radius) expected.push_back(a);
      tree.within(x, radius, found);
      EXPECT_EQ(found, expected);
    }
}

TEST(Neighbours, NearestComeNearestFirst) {
  const Points points = scattered(300);
  const Neighbours tree(points);
  const Vec3 x(0.1, 0.2, -0.3);
  std::vector<int> expected(300);
  for (int a = 0; a < 300; ++a) expected[static_cast<std::size_t>(a)] = a;
  std::sort(expected.begin(), expected.end(), [&](int a, int b) {
    return (points.col(a) - x).squaredNorm() < (points.col(b) - x).squaredNorm();
  });
  expected.resize(20);
  EXPECT_EQ(tree.nearest(x, 20), expected);
}

// The eight corners of a lattice cell are equally far from its middle: only their numbers can break the tie.
TEST(Neighbours, TiesAreDecidedByNumberWhereverTheLastOneRequestedFalls) {
  const Points points = lattice(6);
  const Neighbours tree(points);
  for (const Vec3& x : {Vec3(2.5, 2.5, 2.5), Vec3(0.5, 4.5, 3.5), Vec3(3, 3, 3)}) {
    std::vector<std::pair<double, int>> order;
    for (int a = 0; a < points.cols(); ++a) order.push_back({(points.col(a) - x).squaredNorm(), a});
    std::sort(order.begin(), order.end());
    for (const int count : {1, 3, 5, 8, 11}) {
      SCOPED_TRACE(count);
      std::vector<int> expected;
      for (int k = 0; k < count; ++k) expected.push_back(order[static_cast<std::size_t>(k)].second);
      EXPECT_EQ(tree.nearest(x, count), expected);
    }
  }
}

TEST(Neighbours, AskingForMoreThanThereAreGivesAll) {
  const Neighbours tree(scattered(5));
  EXPECT_EQ(tree.nearest(Vec3::Zero(), 50).size(), 5u);
}

TEST(Neighbours, TheDistanceToTheNearestLeavesOutThePointItself) {
  const Points points = lattice(3);
  const Neighbours tree(points);
  EXPECT_EQ(tree.distance_to_nearest(points.col(13), 13), 1.0);
  EXPECT_EQ(tree.distance_to_nearest(points.col(13)), 0.0);
  EXPECT_EQ(Neighbours(points.leftCols(1)).distance_to_nearest(points.col(0), 0),
            std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace dimple
