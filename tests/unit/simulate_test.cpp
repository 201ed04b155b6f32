// The whole computation as one function: a case gives its result, without side effects.

#include "apps/run/simulate.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <array>
#include <filesystem>
#include <iostream>
#include <numbers>
#include <stdexcept>
#include <thread>

#include "apps/run/error_bounds.hpp"
#include "apps/run/model_files.hpp"
#include "apps/run/organ.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/image/phantom.hpp"
#include "preprocess/make_model.hpp"
#include "preprocess/supports/support.hpp"
#include "solver/system.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/image.hpp"
#include "tests/helpers/report.hpp"
#include "tests/helpers/scene_with.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

// Case of few nodes with the given options.
Case small_case(OptionTexts options = {}) {
  const fs::path image = fresh_folder() / "block.nrrd";
  write_label_image(image, make_phantom({.shape = "block", .size_mm = {50, 50, 30}, .spacing_mm = 2.5}));
  options.insert({{"image.file", image.string()},
                  {"cloud.nodes", "400"},
                  {"load.depth_mm", "1"},
                  {"solver.frames", "2"}});
  return {.scene = scene_with(options)};
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

// A block of 50 x 50 x 30 mm is shortened by 1 mm by its weight, and a sponge by more.
TEST(Simulate, FindsTheShapeWithoutLoadsFromWhichTheyBringABodyBackToItsImage) {
  for (const double nu : {0.499, 0.3}) {
    Case given = small_case({{"material.mu_Pa", "600"},
                             {"material.nu", fmt::format("{}", nu)},
                             {"load.gravity", "inferior"},
                             {"cloud.nodes", "800"}});
    const Result as_it_is = simulate(given);
    given.scene.imaged_loaded = true;
    const Result unloaded = simulate(given);
    ASSERT_TRUE(unloaded.unloaded);
    EXPECT_FALSE(as_it_is.unloaded);
    // The march has moved the gradients out of the model.
    const Model model = make_model(unloaded.model, unloaded.model.scheme, unloaded.model.tissue, {1000.0});
    const ForceSystem tissue(model, unloaded.tissues);
    const auto system =
        make_system(tissue, model, Contact::bonded, {}, {.gravity = {0.0, 0.0, -9.81}, .pressure = {}});
    const Points u = system->step_start().u.topRows<3>();
    const Points x = model.X + node_interpolation(model)(u),
                 vertex = model.surface.vertex_mm + 1e3 * surface_interpolation(model)(u);
    EXPECT_LT((x - as_it_is.model.X).colwise().norm().maxCoeff(), 0.08e-3) << nu;
    EXPECT_LT((vertex - as_it_is.model.surface.vertex_mm).colwise().norm().maxCoeff(), 0.08) << nu;
    EXPECT_GT((model.X - as_it_is.model.X).colwise().norm().maxCoeff(), 0.5e-3) << nu;
    // The centre of the patch moves with its nodes: moments are about it.
    Vec3 displacement = Vec3::Zero();
    for (const Index a : model.bonded_patch) displacement += model.X.col(a) - as_it_is.model.X.col(a);
    displacement /= static_cast<double>(model.bonded_patch.size());
    EXPECT_GT(displacement.norm(), 0.3e-3);
    EXPECT_LT((model.tool.centre - as_it_is.model.tool.centre - displacement).norm(), 1e-9);
    EXPECT_EQ(unloaded.unloaded->imaged_centre, as_it_is.model.tool.centre);
    EXPECT_GT(model.surface.vertex_mm.row(2).maxCoeff(),
              as_it_is.model.surface.vertex_mm.row(2).maxCoeff() + 0.5);
    // Without loads incompressible tissue has the same mass; compressible tissue expands.
    const double mass = as_it_is.model.mass.sum();
    if (nu > 0.49) {
      EXPECT_NEAR(model.mass.sum(), mass, 2e-3 * mass);
    } else {
      EXPECT_GT(model.volume.sum(), 1.005 * as_it_is.model.volume.sum());
    }
    Case again = given;
    again.model = ModelFiles{.places = model,
                             .scheme = model.scheme,
                             .label_names = {},
                             .provenance = unloaded.provenance,
                             .notes = {}};
    EXPECT_THROW(simulate(again), UsageError) << "they would be taken off twice";
    again.scene.imaged_loaded = false;
    EXPECT_EQ(simulate(again).history.force.back().force, unloaded.history.force.back().force);
    again.scene.supports = scene_with({{"support.strap.on", "left"}}).supports;
    EXPECT_THROW(simulate(again), UsageError) << "which part is on the left was decided on the image";
    EXPECT_NE(unloaded.history.force.back().force, as_it_is.history.force.back().force);
  }
}

// Cells of a rotated body have second moments off the diagonal.
TEST(Simulate, FindsTheSameShapeWithoutLoadsHoweverTheBodyIsTurned) {
  const LabelImage straight = make_phantom({.shape = "block", .size_mm = {50, 50, 30}, .spacing_mm = 2.5});
  const auto force = [&](const Mat3& turn) {
    LabelImage image = straight;
    image.to_world = Eigen::Affine3d(turn) * straight.to_world;
    const auto words = [](const Vec3& x) { return fmt::format("{:.15g},{:.15g},{:.15g}", x[0], x[1], x[2]); };
    Case given = small_case({{"material.mu_Pa", "600"},
                             {"boundary.base", words(turn * -Vec3::UnitZ())},
                             {"load.gravity", words(turn * Vec3(1.0, 2.0, -9.0))},
                             {"load.imaged", "loaded"}});
    given.image = &image;
    return simulate(given).history.force.back().force;
  };
  const Mat3 turn =
      Eigen::AngleAxisd(std::numbers::pi / 6.0, Vec3(2.0, 1.0, 2.0).normalized()).toRotationMatrix();
  const double as_it_is = force(Mat3::Identity());
  EXPECT_NEAR(force(turn), as_it_is, 2e-3 * as_it_is);  // the search ends within 0.08 mm
}

TEST(Simulate, ChoosesWhereLoadsActOnTheImageOfABodyThatWasImagedUnderThem) {
  // The ball reaches half a millimetre below the image's top, and the top of the load-free configuration is
  // above the ball.
  Case given = small_case({{"material.mu_Pa", "600"},
                           {"load.gravity", "inferior"},
                           {"load.pressure.pad.pressure_Pa", "1"},
                           {"load.pressure.pad.on", "0,0,19.7,11"},
                           {"membrane.film.on", "0,0,19.7,11"},
                           {"membrane.film.tension_N_per_m", "0.001"}});
  const Loads as_it_is = simulate(given).loading.loads;
  given.scene.imaged_loaded = true;
  const Result unloaded = simulate(given);
  EXPECT_GT(unloaded.unloaded->taken_back, 0.5e-3);
  EXPECT_EQ(unloaded.loading.loads.pressure.at(0).patch.triangles.cols(),
            as_it_is.pressure.at(0).patch.triangles.cols());
  EXPECT_EQ(unloaded.loading.loads.membrane.at(0).patch.triangles.cols(),
            as_it_is.membrane.at(0).patch.triangles.cols());
}

TEST(Simulate, ReportsToItsObserverWhatItDoesInOrder) {
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

TEST(Simulate, StoppedAmidTheMarchReturnsWhatThereIs) {
  RunObserver observer;
  observer.march.sample = [](const ForceSample& now, const History&) { return now.depth < 0.4e-3; };
  const Result result = simulate(small_case(), observer);
  EXPECT_TRUE(result.history.interrupted);
  EXPECT_NEAR(result.history.force.back().depth, 0.5e-3, 1e-12);
}

// Libraries behind the readers print and warn through process-wide streams.
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

// The block is on its base, and its top is at 30 mm.
TEST(Simulate, APlaceBelowTheToolGoesWithItAndOneAboveTheBaseStays) {
  Case given = small_case({{"boundary.base", "inferior"}, {"boundary.indent_at", "0,0,top"}});
  Result built;
  build_case(given, {}, built);
  const Vec3 centre = built.model.tool.centre, approach = built.model.tool.approach;
  const auto displacement_at = [&](const Vec3& place) {
    given.scene.followed = place;
    const Result result = simulate(given);
    EXPECT_TRUE(result.followed.has_value());
    return result.followed->u;
  };
  const Vec3 below = displacement_at(centre + 0.5e-3 * approach);
  EXPECT_NEAR(below.dot(approach), 1e-3, 0.1e-3);
  EXPECT_LT((below - below.dot(approach) * approach).norm(), 0.05e-3);
  EXPECT_LT(displacement_at(centre + 29.5e-3 * approach).norm(), 0.02e-3);
}

TEST(Simulate, RefusesAPlaceOutsideOfTheBodyAndAQuantityThatIsNone) {
  for (const char* quantity : {"displacement@500,0,0", "displacement@1,2", "displacement@", "stress", ""})
    EXPECT_THROW(simulate(small_case({{"accuracy.quantity", quantity}})), UsageError) << quantity;
}

// Case with tissues in layers of 10 mm, label 1 on the base.
Case layered_case(const OptionTexts& options = {}) {
  Case given = small_case(options);
  const fs::path image = test_folder() / "layers.nrrd";
  write_label_image(image, image_of({24, 24, 16}, Vec3::Constant(2.5), [](Index i, Index j, Index k) {
                      const bool inside = i > 1 && i < 22 && j > 1 && j < 22 && k > 1 && k < 14;
                      return inside ? 1 + static_cast<int>((k - 2) / 4) : 0;
                    }));
  given.scene.image.file = image.string();
  given.scene.node_set.nodes = 1000;
  given.error_bounds = true;
  return given;
}

// Other reasons: Run.SaysWhyItsBandIsUnknown and Run.HasNoBandDeeperThanItWasMeasured.
TEST(Simulate, ShowsNoErrorBoundsOutsideOfWhatTheyWereMeasuredFor) {
  const auto why = [](auto change) {
    Case given = small_case();
    given.error_bounds = true;
    change(given.scene);
    const Result result = simulate(given);
    EXPECT_TRUE(result.error_bounds.half.empty());
    return result.error_bounds.unknown;
  };
  EXPECT_THAT(why([](Scene& s) { s.solver.tolerance = 1e-3; }), HasSubstr("tolerance"));
  EXPECT_THAT(why([](Scene& s) { s.solver.step_radii = 0.5; }), HasSubstr("load steps above 0.2"));
  EXPECT_THAT(why([](Scene& s) { s.boundary.direction = "0.1,0,-1"; }), HasSubstr("oblique"));
}

// The coarser node set has a preload and walls of its own, as a run by itself has.
TEST(Simulate, ErrorBoundsWithGravityAndWallsCompareWithARunOfHalfTheNodes) {
  for (const OptionTexts& terms : std::vector<OptionTexts>{
           {{"load.gravity", "inferior"}},
           {{"wall.side.shape", "plane:25.1,0,0,-1,0,0"}},
           {{"boundary.base_hold", "none"}, {"wall.floor.shape", "plane:0,0,0,0,0,1"}}}) {
    SCOPED_TRACE(terms.begin()->first);
    OptionTexts options = terms;
    options.insert({{"cloud.nodes", "1000"}, {"boundary.base", "inferior"}});
    Case given = small_case(options);
    given.error_bounds = true;
    const Result fine = simulate(given);
    ASSERT_TRUE(fine.error_bounds.known()) << fine.error_bounds.unknown;
    given.error_bounds = false;
    given.scene.node_set.nodes = 500;
    given.scene.solver.frames = 1;
    const Result coarse = simulate(given);
    const double radius = fine.model.tool.radius;
    EXPECT_EQ(fine.error_bounds.half,
              half_widths(fine.history.force, 1000, coarse.history.force, radius, false));
  }
}

TEST(Simulate, ErrorBoundsAreTheSameHoweverManyFramesAreWritten) {
  Case given = small_case({{"cloud.nodes", "1000"}, {"load.depth_mm", "2"}, {"solver.frames", "1"}});
  given.error_bounds = true;
  const Result few = simulate(given);
  ASSERT_TRUE(few.error_bounds.known()) << few.error_bounds.unknown;
  given.scene.solver.frames = 7;
  const Result many = simulate(given);
  EXPECT_EQ(few.history.force.back().force, many.history.force.back().force);
  EXPECT_EQ(few.error_bounds.half.back(), many.error_bounds.half.back());
  EXPECT_GT(few.error_bounds.half.back(), 0.0);
}

TEST(Simulate, ErrorBoundsAreTheSameWhetherTheirNodesAreMarchedInParallelOrAfterwards) {
  Case given = small_case({{"cloud.nodes", "1000"}});
  given.error_bounds = true;
  const auto with_threads = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return simulate(given);
  };
  const Result afterwards = with_threads(1), next_to = with_threads(2);
  ASSERT_TRUE(next_to.error_bounds.known()) << next_to.error_bounds.unknown;
  EXPECT_EQ(next_to.error_bounds.half, afterwards.error_bounds.half);
  EXPECT_EQ(next_to.history.force.back().force, afterwards.history.force.back().force);
  EXPECT_EQ(next_to.warnings, afterwards.warnings);
}

TEST(Simulate, AMarchThatFailsDoesNotWaitForAllOfItsErrorBounds) {
  Case given = small_case({{"cloud.nodes", "8000"}});
  given.error_bounds = true;
  RunObserver observer;
  observer.march.sample = [](const ForceSample&, const History&) -> bool {
    throw std::runtime_error("full");
  };
  Result result;
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 2);
  EXPECT_THROW(simulate(given, observer, result), std::runtime_error);
  EXPECT_EQ(result.error_bounds.unknown, "the run ended first");
}

TEST(Simulate, AnAccuracyIsReachedWithOneFrame) {
  Case given = small_case({{"cloud.nodes", "1500"}, {"solver.frames", "1"}, {"accuracy.goal", "10%"}});
  const Result result = simulate(given);
  EXPECT_TRUE(result.error_bounds.known()) << result.error_bounds.unknown;
  EXPECT_LE(result.error_bounds.half.back(), 0.1 * result.history.force.back().force);
}

TEST(Simulate, AModelThatIsKeptInMemoryHasTheErrorBoundsOfItsImage) {
  const Case given = layered_case({{"tissue.2.mu_Pa", "400"}});
  const Result whole = simulate(given);
  ASSERT_TRUE(whole.error_bounds.known()) << whole.error_bounds.unknown;
  Result built;
  build_case({.scene = given.scene}, {}, built);
  ASSERT_TRUE(built.origin);
  Case kept{.scene = given.scene};
  kept.origin = built.origin;
  kept.error_bounds = true;
  kept.model = ModelFiles{
      .places = built.model, .scheme = built.model.scheme, .label_names = {}, .provenance = {}, .notes = {}};
  const Result solved = simulate(kept);
  EXPECT_EQ(solved.error_bounds.half, whole.error_bounds.half) << solved.error_bounds.unknown;
  kept.origin = nullptr;
  EXPECT_FALSE(simulate(kept).error_bounds.known());
}

// The image has walls of 5 mm with 2.5 mm of air between them, on a slab.
TEST(Simulate, AFoldedBodyTakesTheNodesThatItsErrorBoundsNeedUnlessTheyAreGiven) {
  Case given = small_case();
  const fs::path image = test_folder() / "folded.nrrd";
  write_label_image(image, image_of({28, 28, 16}, Vec3::Constant(2.5), [](Index i, Index j, Index k) {
                      return i > 1 && i < 26 && j > 1 && j < 26 && k > 1 && k < 14 &&
                             (k < 7 || i % 3 != 0 || (i > 9 && i < 18));
                    }));
  given.scene.image.file = image.string();
  given.scene.node_set.nodes = 1500;
  given.scene.given.nodes = false;
  std::string said;
  const RunObserver observer{
      .line = [&](RunObserver::Line, const std::string& text) { said += text + "\n"; }};
  Result folded;
  build_case(given, observer, folded);
  ASSERT_GT(folded.facing_fraction, most_facing);
  EXPECT_EQ(folded.required_nodes, 4000);
  EXPECT_NEAR(static_cast<double>(folded.model.node_count()), 4000.0, 40.0);
  EXPECT_THAT(said, HasSubstr("4000 instead of 1500, as none were given"));
  given.scene.given.nodes = true;
  Result requested;
  build_case(given, {}, requested);
  EXPECT_EQ(requested.required_nodes, 0);
  EXPECT_NEAR(static_cast<double>(requested.model.node_count()), 1500.0, 15.0);
}

// Cases on one prepared organ have their own force each, with the same bits as alone.
TEST(Simulate, OnAnOrganThatWasReadBeforeIsAsAlone) {
  const Case first = small_case();
  PreparedOrgan organ = read_once(first, {});
  Case on_organ = first;
  on_organ.organ = &organ;
  const Result found = simulate(on_organ);
  EXPECT_EQ(found.history.force.back().force, simulate(first).history.force.back().force);
  organ.made = made_in(first.scene, found);
  ASSERT_TRUE(organ.made);
  for (const auto& [key, value] : {std::pair("material.nu", "0.4"),
                                   {"load.contact", "frictionless"},
                                   {"solver.tolerance", "1e-5"},
                                   {"cloud.seed", "2"},
                                   {"cloud.nodes", "500"},
                                   {"grid.ratio", "9"},
                                   {"boundary.base_depth_mm", "6"},
                                   {"boundary.indent_at", "5,0,top"},
                                   {"load.depth_mm", "0.5"},
                                   {"tool.shape", "sphere:5mm"}}) {
    SCOPED_TRACE(key);
    Case other = small_case({{key, value}});
    const double alone = simulate(other).history.force.back().force;
    EXPECT_NE(alone, found.history.force.back().force);
    other.organ = &organ;
    EXPECT_EQ(simulate(other).history.force.back().force, alone);
  }
  const Case cut = small_case({{"image.cut", "plane:0,0,15,1,0,0,radius=5mm"}});
  EXPECT_FALSE(made_in(cut.scene, found)) << "its surface is another";
}

}  // namespace
}  // namespace dimple
