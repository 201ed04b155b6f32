// Node sets, sizings and their bounds.

#include "preprocess/nodes/node_set.hpp"

#include <gtest/gtest.h>
#include <tbb/parallel_for.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>

#include "io/error.hpp"
#include "preprocess/side_by_side.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

BodySurface block() {
  return block_surface(Vec3(0, 0, 0), Vec3(50, 50, 30));
}

TEST(SideBySide, LetsTheOneFinishItsLoopsThoughTheOtherHasFailed) {
  for (int round = 0; round < 20; ++round) {
    std::atomic<bool> failing = false;
    std::vector<char> done(1000, 0);
    EXPECT_THROW(side_by_side(
                     [&] {
                       failing = true;
                       throw std::runtime_error("one");
                     },
                     [&] {
                       for (int wait = 0; wait < 50 && !failing; ++wait)
                         std::this_thread::sleep_for(std::chrono::milliseconds(1));
                       std::this_thread::sleep_for(std::chrono::milliseconds(2));
                       tbb::parallel_for(std::size_t{0}, done.size(), [&](std::size_t k) { done[k] = 1; });
                     }),
                 std::runtime_error);
    EXPECT_EQ(std::count(done.begin(), done.end(), 1), 1000);
  }
}

TEST(Bisection, GivesUpBeyondItsBound) {
  const BodySurface body = block();
  const auto cube = [](double) { return 1.0; };
  const auto all = bisect(body, 5.0, {}, cube, 200000);
  ASSERT_TRUE(all);
  EXPECT_GT(all->size(), 50000u);
  EXPECT_FALSE(bisect(body, 5.0, {}, cube, 10000));
  EXPECT_FALSE(bisect(body, 0.0, {}, cube, 10000));
  EXPECT_FALSE(bisect(
      body, 5.0, {}, [](double) { return 0.0; }, 10000));
}

TEST(Bisection, OfAThinPlateIsTheSameFromACoarserBeginning) {
  const BodySurface body = block_surface(Vec3(0, 0, 0), Vec3(64, 64, 1));
  const auto requested = [](double) { return 1.0; };
  const auto fine = bisect(body, 1.0, {}, requested, 1000000),
             coarse = bisect(body, 1.0, {}, requested, 4096);
  ASSERT_TRUE(fine && coarse);
  double volume = 0.0;
  for (const Leaf& leaf : *coarse) volume += leaf.volume();
  EXPECT_NEAR(volume, 4096.0, 1e-6);
  EXPECT_EQ(fine->size(), coarse->size());
}

TEST(NodeSet, RefusesAPatchEdgeFinerThanItsNodesAtOnce) {
  const BodySurface body = block();
  const Boundary boundary = find_boundary(body, {});
  for (const double patch_edge : {1e-12, 1e-6, 1e-3}) {
    const NodeSetOptions options{.count = 1000, .grading = {.patch_edge = patch_edge}};
    const Sizing sizing(body, boundary, options.grading);
    EXPECT_THROW(node_set_size(body, sizing, options), ModelError);
  }
}

TEST(NodeSet, RefusesSpacingsThatTakeMoreNodesThanListsCanHold) {
  const BodySurface body = block();
  const Boundary boundary = find_boundary(body, {});
  for (const double spacing : {1e-300, 1e-9, 1e-3, 0.02}) {
    const NodeSetOptions options{.spacing_mm = spacing, .grading = {.patch_edge = 0.15}};
    const Sizing sizing(body, boundary, options.grading);
    EXPECT_THROW(node_set_size(body, sizing, options), ModelError);
    EXPECT_THROW(node_set_size(body, {}, options), ModelError);
  }
}

TEST(NodeSet, OfManyNodesBySpacingIsAsLargeAsThatByNumber) {
  const BodySurface body = block();
  const Boundary boundary = find_boundary(body, {});
  const Sizing sizing(body, boundary, {.patch_edge = 0.15});
  const NodeSetSize size = node_set_size(body, sizing, {.count = 300000, .grading = {.patch_edge = 0.15}});
  const NodeSetSize back =
      node_set_size(body, sizing, {.spacing_mm = size.far_spacing, .grading = {.patch_edge = 0.15}});
  EXPECT_NEAR(static_cast<double>(back.count), 300000.0, 3000.0);
}

}  // namespace
}  // namespace dimple
