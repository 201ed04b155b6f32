// The mission as one function: from a case to its result, and nothing beside it.

#include "apps/run/simulate.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <iostream>
#include <thread>

#include "apps/run/model_files.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/phantom.hpp"
#include "tests/helpers/folder.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

Case small_case() {
  const fs::path image = fresh_folder() / "block.nrrd";
  write_label_image(image, make_phantom({.shape = "block", .size_mm = {50, 50, 30}, .spacing_mm = 2.5}));
  Config config;
  config.image.file = image.string();
  config.cloud.nodes = 400;
  config.load.depth_mm = 1.0;
  config.solver.frames = 2;
  return {.config = config};
}

TEST(Simulate, PrintsNothingAndWritesNoFile) {
  const Case given = small_case();
  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const Result result = simulate(given);
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(std::distance(fs::directory_iterator(test_folder()), fs::directory_iterator{}), 1);
  EXPECT_FALSE(result.history.interrupted);
  EXPECT_NEAR(result.history.force.back().depth, 1e-3, 1e-12);
  EXPECT_GT(result.history.force.back().force, 0.0);
  EXPECT_EQ(result.model.node_count(), 400);
  EXPECT_EQ(result.model.tissue.size(), result.model.point_count());
}

TEST(Simulate, TellsItsObserverWhatItDoesInOrder) {
  std::vector<std::string> heard;
  std::vector<int> frames;
  RunObserver observer;
  observer.line = [&](RunObserver::Line kind, const std::string& text) {
    if (kind == RunObserver::Line::said || kind == RunObserver::Line::detail)
      heard.push_back(text.substr(0, text.find(' ')));
  };
  observer.placed = [&](const Discretisation& places, const Scheme& scheme) {
    heard.push_back("placed");
    EXPECT_EQ(places.node_count(), 400);
    EXPECT_EQ(scheme.name, "converging");
  };
  observer.begin = [&](Result& result) {
    heard.push_back("begin");
    EXPECT_GT(result.model.mass.sum(), 0.0);
    EXPECT_GT(result.model.dphi.cols(), 0);
  };
  observer.march.frame = [&](const Frame& frame) { frames.push_back(frame.number); };
  simulate(small_case(), observer);
  EXPECT_EQ(frames, (std::vector<int>{0, 1, 2}));
  EXPECT_THAT(heard, testing::IsSupersetOf({"image", "organ", "nodes", "placed", "support", "begin"}));
  EXPECT_LT(std::find(heard.begin(), heard.end(), "placed"),
            std::find(heard.begin(), heard.end(), "support"));
}

TEST(Simulate, AModelFromFilesGivesTheForceOfItsImageToTheBit) {
  const Case from_image = small_case();
  Result built;
  build_case(from_image, {}, built);
  write_model(test_folder() / "model", built.model, built.model.scheme, built.provenance);
  const Result first = simulate(from_image);
  const Result second = simulate({.config = from_image.config, .model = read_model(test_folder() / "model")});
  ASSERT_EQ(first.history.force.size(), second.history.force.size());
  for (std::size_t k = 0; k < first.history.force.size(); ++k)
    EXPECT_EQ(first.history.force[k].force, second.history.force[k].force);
}

TEST(Simulate, AskedToStopAmidTheMarchReturnsWhatThereIs) {
  RunObserver observer;
  observer.march.sample = [](const ForceSample& now, const History&) { return now.depth < 0.4e-3; };
  const Result result = simulate(small_case(), observer);
  EXPECT_TRUE(result.history.interrupted);
  EXPECT_NEAR(result.history.force.back().depth, 0.5e-3, 1e-12);
}

// The libraries behind the readers print and warn by way of the whole process.
TEST(Simulate, ManyAtOnceGiveWhatOneGivesAndLeaveTheStreamsAlone) {
  const Case given = small_case();
  const double alone = simulate(given).history.force.back().force;
  const std::streambuf *out = std::cout.rdbuf(), *err = std::cerr.rdbuf();
  std::array<double, 8> force{};
  {
    std::vector<std::jthread> threads;
    for (std::size_t t = 0; t < 4; ++t)
      threads.emplace_back([&, t] {
        for (std::size_t k = t; k < force.size(); k += 4)
          force[k] = simulate(given).history.force.back().force;
      });
  }
  for (const double each : force) EXPECT_EQ(each, alone);
  EXPECT_EQ(std::cout.rdbuf(), out);
  EXPECT_EQ(std::cerr.rdbuf(), err);
}

// The block stands on its base, and its top is at 30 mm.
TEST(Simulate, APlaceBelowTheToolGoesWithItAndOneAboveTheBaseStays) {
  Case given = small_case();
  given.config.boundary.base = "inferior";
  given.config.boundary.indent_at = "0,0,top";
  Result built;
  build_case(given, {}, built);
  const Vec3 centre = built.model.tool.centre, push = built.model.tool.push;
  const auto displacement_at = [&](const Vec3& place) {
    given.config.accuracy.quantity =
        fmt::format("displacement@{},{},{}", 1e3 * place.x(), 1e3 * place.y(), 1e3 * place.z());
    const Result result = simulate(given);
    EXPECT_TRUE(result.followed.has_value());
    return result.followed->u;
  };
  const Vec3 below = displacement_at(centre + 0.5e-3 * push);
  EXPECT_NEAR(below.dot(push), 1e-3, 0.1e-3);
  EXPECT_LT((below - below.dot(push) * push).norm(), 0.05e-3);
  EXPECT_LT(displacement_at(centre + 29.5e-3 * push).norm(), 0.02e-3);
}

TEST(Simulate, RefusesAPlaceOutsideOfTheBodyAndAQuantityThatIsNone) {
  Case given = small_case();
  for (const char* quantity : {"displacement@500,0,0", "displacement@1,2", "displacement@", "stress", ""}) {
    given.config.accuracy.quantity = quantity;
    EXPECT_THROW(simulate(given), UsageError) << quantity;
  }
}

TEST(Simulate, ThrowsWhatIsWrongWithTheCase) {
  Case given = small_case();
  given.config.load.depth_mm = 40.0;
  EXPECT_THROW(simulate(given), ModelError);
  given.config.image.file = "nothere.nrrd";
  EXPECT_THROW(simulate(given), InputError);
  given.config.image.file.clear();
  EXPECT_THROW(simulate(given), UsageError);
}

}  // namespace
}  // namespace dimple
