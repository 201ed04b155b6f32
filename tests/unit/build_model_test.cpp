// Complete models: made, or refused at once with a message.

#include "preprocess/build_model.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <ctime>

#include "io/error.hpp"
#include "tests/helpers/image.hpp"
#include "tests/helpers/report.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

ModelOptions options_for(Index nodes) {
  ModelOptions options;
  options.node_set.count = nodes;
  return options;
}

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// A voxel extends half an edge to each side of its centre.
TEST(BuildModel, ALabelEndsHalfwayBetweenTheCentresOfItsVoxelsAndTheNext) {
  const Vec3 spacing(2.0, 1.0, 3.0);
  const LabelImage image = image_of({12, 14, 10}, spacing, [](Index i, Index j, Index k) {
    return (i < 5 ? 1 : 2) + (j < 7 ? 0 : 2) + (k < 6 ? 0 : 4);
  });
  const LabelAt label_at = label_finder(image, Eigen::Isometry3d::Identity());
  const Vec3 border = Vec3(4.5, 6.5, 5.5).cwiseProduct(spacing);
  for (int side = 0; side < 8; ++side) {
    const Vec3 away(side & 1 ? 0.1 : -0.1, side & 2 ? 0.1 : -0.1, side & 4 ? 0.1 : -0.1);
    EXPECT_EQ(label_at(border + away), 1 + side) << (border + away).transpose();
  }
  const Mat3 turn = Eigen::AngleAxisd(0.5, Vec3(1, 1, 2).normalized()).toRotationMatrix();
  Eigen::Isometry3d frame = Eigen::Isometry3d::Identity();
  frame.linear() = turn;
  const LabelAt in_frame = label_finder(image, frame);
  EXPECT_EQ(in_frame(turn.transpose() * (border + Vec3(0.1, -0.1, 0.1))), 6) << "of a frame of its own";
  const LabelAt some = label_finder(image, Eigen::Isometry3d::Identity(), {1});
  EXPECT_EQ(some(border + Vec3(0.1, -0.1, -0.1)), 1) << "the nearest of those that count";
}

TEST(BuildModel, RefusesTooFewNodesEachTimeInTheSameWordsAndAtOnce) {
  const BodySurface body = block_surface(Vec3(0, 0, 0), Vec3(50, 50, 30));
  std::string first;
  const double begin = cpu_seconds();
  for (int round = 0; round < 10; ++round) {
    const std::string fact = report_of<ModelError>([&] { discretise(body, options_for(80)); }).fact;
    if (round == 0) first = fact;
    EXPECT_EQ(fact, first);
  }
  EXPECT_LT(cpu_seconds() - begin, 10.0);
}

TEST(BuildModel, RefusesASheetThatItsNodesCannotFollowAndSaysHowManyCan) {
  const BodySurface sheet = block_surface(Vec3(0, 0, 0), Vec3(54, 54, 2.2));
  expect_error<ModelError>([&] { discretise(sheet, options_for(800)); },
                           {.remedy = "--nodes", .code = "thin"});
  EXPECT_NO_THROW(discretise(sheet, options_for(2000)));
  // The paper's scheme has the same limit: 2.2 and 2.8 spacings on a layer of 5 mm give forces 3.4 and 0.98
  // times that of a finer discretisation.
  const BodySurface layer = block_surface(Vec3(0, 0, 0), Vec3(40, 40, 5));
  ModelOptions paper = options_of(horton2007);
  paper.node_set.count = 1000;
  EXPECT_THROW(discretise(layer, paper), ModelError);
  paper.node_set.count = 2000;
  EXPECT_NO_THROW(discretise(layer, paper));
}

TEST(BuildModel, NodeSetsOfOneSiteAreThoseThatFindTheirOwn) {
  const BodySurface body = cut_ellipsoid_surface({46.0, 31.0, 27.0}, -5.0, 60);
  const Site site = find_site(body, options_for(300));
  for (const Index nodes : {300, 500}) {
    const Discretised own = discretise(body, options_for(nodes)),
                      shared = discretise(body, options_for(nodes), {}, site);
    EXPECT_EQ(shared.places.X, own.places.X);
    EXPECT_EQ(shared.places.point, own.places.point);
    EXPECT_EQ(shared.places.volume, own.places.volume);
    EXPECT_EQ(shared.places.base, own.places.base);
    EXPECT_EQ(shared.places.bonded_patch, own.places.bonded_patch);
    EXPECT_EQ(shared.places.tool.centre, own.places.tool.centre);
    EXPECT_EQ(shared.report.boundary.patch_reason, own.report.boundary.patch_reason);
  }
}

TEST(BuildModel, HoldsEveryNodeOnTheFaceThatSupportsABlock) {
  const Discretisation places =
      discretise(block_surface(Vec3(-20.0, -20.0, 0.0), Vec3(20.0, 20.0, 20.0)), options_for(600)).places;
  const double lowest = places.X.row(2).minCoeff();
  Index there = 0;
  for (Index a = 0; a < places.node_count(); ++a) {
    if (places.X(2, a) > lowest + 1e-9) continue;
    ++there;
    EXPECT_TRUE(std::binary_search(places.base.begin(), places.base.end(), a)) << places.X.col(a).transpose();
  }
  EXPECT_GT(there, 20);
}

TEST(BuildModel, RefusesMoreThanTheMemoryAtHandBeforeItBegins) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "memory is limited here, and a sanitizer's shadow alone is larger";
#endif
  const BodySurface body = block_surface(Vec3(0, 0, 0), Vec3(50, 50, 30));
  rlimit limit{};
  getrlimit(RLIMIT_AS, &limit);
  const rlimit less{std::min<rlim_t>(limit.rlim_max, 8'000'000'000), limit.rlim_max};
  setrlimit(RLIMIT_AS, &less);
  const double begin = cpu_seconds();
  expect_error<ModelError>([&] { discretise(body, options_for(1'000'000)); },
                           {.where = "--nodes", .code = "memory"});
  EXPECT_LT(cpu_seconds() - begin, 1.0);
  setrlimit(RLIMIT_AS, &limit);
}

}  // namespace
}  // namespace dimple
