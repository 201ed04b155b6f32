#include "apps/run/error_bounds.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "apps/run/grading.hpp"
#include "apps/run/simulate.hpp"
#include "preprocess/image/phantom.hpp"
#include "tests/helpers/error_scenes.hpp"
#include "tests/helpers/scene_with.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

constexpr double radius = 5e-3;

// Samples with force k * depth at these depths [mm].
std::vector<ForceSample> curve(const std::vector<double>& depths_mm, double k) {
  std::vector<ForceSample> samples;
  for (const double mm : depths_mm) samples.push_back({mm, 1e-3 * mm, k * mm, k * mm});
  return samples;
}

TEST(ErrorBounds, HoldsTheForceOf95In100ScenesWithTheMultiplierThatItHas) {
  const ErrorScores scores = error_scores(error_scenes(DIMPLE_ERROR_SCENES));
  EXPECT_GE(std::count_if(scores.begin(), scores.end(),
                          [](const auto& of) { return of.second.size() >= least_scenes; }),
            4);
  EXPECT_NEAR(conformal(scores, 0.95, least_scenes), error_multiplier, 0.005);
}

TEST(ErrorBounds, OfADisplacementHasTheMultiplierOfItsScenesToo) {
  const ErrorScores scores = point_scores(point_scenes(DIMPLE_ERROR_POINTS));
  EXPECT_GE(scores.at(1000).size(), least_points);
  EXPECT_NEAR(conformal(scores, 0.95, least_points), displacement_multiplier, 0.005);
}

TEST(ErrorBounds, IsAsWideAsTheChangeAndTheFloorTimesTheMultiplier) {
  const std::vector<double> half =
      half_widths(curve({0, 1, 2, 3, 4}, 1.02), 4000, curve({0, 2, 4}, 1.0), radius, false);
  ASSERT_EQ(half.size(), 5u);
  EXPECT_EQ(half[0], 0.0);
  for (std::size_t k = 1; k < half.size(); ++k)
    EXPECT_NEAR(half[k],
                1.02 * static_cast<double>(k) * error_half_width(0.02, 4000, {0.2 * static_cast<double>(k)}),
                1e-12)
        << k;
  EXPECT_NEAR(error_half_width(0.02, 1000, {}), error_multiplier * (0.3 * 0.02 + 0.01), 1e-12);
  EXPECT_GT(error_half_width(0.0, 1000, {1.0}), error_half_width(0.0, 1000, {0.5})) << "deeper";
  EXPECT_GT(error_half_width(0.0, 1000, {0.5, true}), error_half_width(0.0, 1000, {0.5}))
      << "of several tissues";
}

TEST(ErrorBounds, OfADisplacementIsTheChangeAndTheFloorTimesItsMultiplier) {
  EXPECT_NEAR(displacement_half_width(2e-5, 3e-3, 1000), displacement_multiplier * (2e-5 + 0.01 * 3e-3),
              1e-12);
}

TEST(ErrorBounds, DoesNotTrustNodeSetsThatAgreeDeeperDown) {
  std::vector<ForceSample> coarse = curve({0, 1, 2}, 1.0);
  coarse[1].force = 0.9;
  const std::vector<double> half = half_widths(curve({0, 1, 2}, 1.0), 1000, coarse, radius, false);
  EXPECT_GE(half[2] / 2.0, half[1]);
}

TEST(ErrorBounds, IsNotKnownDeeperThanTheCoarserNodesGo) {
  EXPECT_TRUE(half_widths(curve({0, 1, 2}, 1.0), 1000, curve({0, 1}, 1.0), radius, false).empty());
  EXPECT_TRUE(half_widths({}, 1000, {}, radius, false).empty());
}

TEST(ErrorBounds, OfAContactingToolThatIsPressedEndAtZero) {
  const std::vector<ForceSample> force = {{0, 0, 1.0, 1.0}, {1, 1e-3, 3.0, 3.0}, {2, 2e-3, -1.0, -1.0}};
  ErrorBounds bounds{.unknown = "", .half = {2.0, 2.0, 2.0}};
  EXPECT_THAT(lower_bounds(force, bounds), testing::ElementsAre(-1.0, 1.0, -3.0));
  bounds.contacting = true;
  EXPECT_THAT(lower_bounds(force, bounds), testing::ElementsAre(0.0, 1.0, -3.0));
  bounds.unknown = "not requested";
  EXPECT_TRUE(lower_bounds(force, bounds).empty());
}

// Force [N] over the depth [mm], one second for each.
std::vector<ForceSample> path(const std::vector<std::pair<double, double>>& depth_and_force) {
  std::vector<ForceSample> samples;
  for (const auto& [mm, force] : depth_and_force)
    samples.push_back({static_cast<double>(samples.size()), 1e-3 * mm, force, force});
  return samples;
}

// The fraction of the largest force is the change plus a tenth of the depth in mm.
double fraction(double change, double deepest) {
  return change + 100.0 * deepest;
}

TEST(ErrorBounds, OfStepsReferToTheLargestForceChangeAndDepthSoFar) {
  const std::vector<ForceSample> fine = path({{0, 0}, {1, 1.0}, {2, 4.0}, {1, 0.5}, {-1, -2.0}});
  std::vector<ForceSample> coarse = path({{0, 0}, {1, 0.9}, {2, 4.0}, {1, 0.3}, {-1, -2.0}});
  const std::vector<double> half = half_widths_of_steps(fine, coarse, 0.0, fraction);
  ASSERT_EQ(half.size(), 5u);
  EXPECT_EQ(half[0], 0.0);
  EXPECT_NEAR(half[1], 1.0 * (0.1 + 0.1), 1e-12);
  for (const std::size_t k : {2u, 3u, 4u}) EXPECT_NEAR(half[k], 4.0 * (0.1 + 0.2), 1e-12) << k;
  coarse[3].force = -1.5;  // half of the largest force off, on the way back
  EXPECT_NEAR(half_widths_of_steps(fine, coarse, 0.0, fraction)[3], 4.0 * (0.5 + 0.2), 1e-12);
  // The coarser curve may have other times, where nothing is compared, but no earlier end.
  coarse[1].t = 0.9;
  EXPECT_NEAR(half_widths_of_steps(fine, coarse, 0.0, fraction)[1], 1.0 * 0.1, 1e-12);
  coarse.pop_back();
  EXPECT_TRUE(half_widths_of_steps(fine, coarse, 0.0, fraction).empty());
}

TEST(ErrorBounds, OfStepsReachFromNothingToTheFirstOnesWhereTheContactIsSlight) {
  const std::vector<ForceSample> fine = path({{0, 0}, {0.5, 0.1}, {1, 1.0}, {0.2, 0.05}}),
                                 coarse = path({{0, 0}, {0.5, 0.3}, {1, 1.0}, {0.2, 0.05}});
  const std::vector<double> half = half_widths_of_steps(fine, coarse, 1e-3, fraction);
  ASSERT_EQ(half.size(), 4u);
  EXPECT_EQ(half[0], 0.0);
  EXPECT_NEAR(half[2], 0.1, 1e-12) << "no change counts before that depth";
  EXPECT_NEAR(half[1], 1.0 + half[2] - 0.1, 1e-12);
  EXPECT_EQ(half[3], half[2]);
  EXPECT_TRUE(half_widths_of_steps(fine, coarse, 2e-3, fraction).empty()) << "never deep enough";
}

TEST(ErrorBounds, OfStepsStayAsTheToolLeavesTheBody) {
  const std::vector<ForceSample> fine = path({{0, 0}, {1, 1.0}, {-9, 0}});
  const std::vector<double> half = half_widths_of_steps(fine, fine, 0.5e-3, fraction);
  ASSERT_EQ(half.size(), 3u);
  EXPECT_EQ(half[2], half[1]);
}

TEST(ErrorBounds, ARefinementBeginsBelowTheNodesThatMayWellDo) {
  const auto first_two = [](double requested, double facing, double radii) {
    const Index expected = expected_nodes(requested, facing, floor_of_force({radii})),
                first = nodes_of_first_level(expected);
    return std::pair(first, nodes_of_second_level(first, expected));
  };
  EXPECT_EQ(first_two(0.05, 0.0, 1.0), std::pair(Index{500}, Index{1000}));
  EXPECT_EQ(first_two(0.02, 0.0, 1.0), std::pair(Index{2000}, Index{4000}));
  EXPECT_EQ(first_two(0.01, 0.0, 1.0), std::pair(Index{4000}, Index{16'000}))
      << "soon an answer, if not that one";
  EXPECT_EQ(first_two(0.05, 0.2, 1.0), std::pair(Index{2000}, Index{4000})) << "of a folded body";
  EXPECT_EQ(first_two(0.0, 0.0, 1.0), std::pair(Index{500}, Index{1000}))
      << "nobody knows how much of it that is";
  EXPECT_EQ(first_two(1e-9, 0.0, 2.0).first, 4000) << "too much to ask for";
}

TEST(ErrorBounds, ARefinementLeapsWhereItsErrorBoundsAreFarTooWide) {
  EXPECT_EQ(nodes_of_next_level(1000, 0.015, 0.01), 2000);
  EXPECT_EQ(nodes_of_next_level(1000, 0.05, 0.01), 4000);
}

// One row per scene, with the columns that are numbers.
struct CoveredBody {
  std::string set;
  double thickness, size, voxel, nu, tissues, ratio;
};
std::vector<CoveredBody> covered_bodies() {
  std::vector<CoveredBody> bodies;
  for (const std::vector<std::string>& field : rows_of(DIMPLE_ERROR_BODIES))
    bodies.push_back({field[1], std::stod(field[4]), std::stod(field[5]), std::stod(field[6]),
                      std::stod(field[7]), std::stod(field[8]), std::stod(field[9])});
  return bodies;
}

// Number of error bounds with 1000 and 2000 nodes, and of those that contain the truth.
struct Coverage {
  int bounds = 0, hold = 0;
};
std::map<std::string, Coverage> coverage_of_sets() {
  std::map<std::string, Coverage> coverage;
  for (const ErrorScene& scene : error_scenes(DIMPLE_ERROR_SCENES))
    for (const Index nodes : {1000, 2000})
      if (const std::optional<bool> holds = contains_truth(scene, nodes)) {
        ++coverage[scene.set].bounds;
        coverage[scene.set].hold += *holds;
      }
  return coverage;
}

// These scenes do not enter the multiplier.
TEST(ErrorBounds, HoldsTheForceOf95In100LargeBodies) {
  const Coverage large = coverage_of_sets().at("large");
  EXPECT_GE(large.bounds, 45);
  EXPECT_GE(large.hold, 0.95 * large.bounds);
}

// Error bounds are therefore not given for thin bodies.
TEST(ErrorBounds, DoesNotHoldTheForceOfThinBodies) {
  const Coverage thin = coverage_of_sets().at("thin");
  EXPECT_GE(thin.bounds, 25);
  EXPECT_LT(thin.hold, 0.95 * thin.bounds);
}

TEST(ErrorBounds, IsKnownWhereScenesHaveBeenAndNowhereElse) {
  std::vector<CoveredBody> bodies = covered_bodies();
  std::erase_if(bodies, [](const CoveredBody& body) { return body.set == "thin"; });
  ASSERT_GE(bodies.size(), 200u);                        // some images are not available everywhere
  const auto fifth = [&](double CoveredBody::*number) {  // from either end
    std::vector<double> values;
    for (const CoveredBody& body : bodies) values.push_back(body.*number);
    std::sort(values.begin(), values.end());
    return std::pair(values[4], values[values.size() - 5]);
  };
  const auto expect_inside = [](double ours, double limit, int side, const char* what) {
    EXPECT_GE(side * ours, side * limit) << what << ": fewer than five scenes lie beyond";
    EXPECT_NEAR(ours, limit, 0.01 * limit) << what << " is no limit of the scenes";
  };
  const auto [thin, thick] = fifth(&CoveredBody::thickness);
  expect_inside(covered_thickness.least, thin, 1, "thin");
  expect_inside(covered_thickness.most, thick, -1, "thick");
  const auto [small, large] = fifth(&CoveredBody::size);
  expect_inside(covered_size.least, small, 1, "small");
  expect_inside(covered_size.most, large, -1, "large");
  expect_inside(covered_voxel, fifth(&CoveredBody::voxel).second, -1, "voxels");
  EXPECT_EQ(covered_nu.least, fifth(&CoveredBody::nu).first);
  EXPECT_EQ(covered_nu.most, fifth(&CoveredBody::nu).second);
  EXPECT_EQ(covered_stiffness_ratio, fifth(&CoveredBody::ratio).second);
  EXPECT_EQ(static_cast<double>(covered_tissues), fifth(&CoveredBody::tissues).second);
}

TEST(ErrorBounds, IsNotShownOfABodyThatIsThinnerOrSmallerOrCoarserThanAnyThatItWasMeasuredFor) {
  const BodyUnderPatch usual{.thickness = 5.0, .size = 8.0, .voxel = 0.2};
  EXPECT_EQ(why_no_error_bounds(usual), "");
  const auto with = [&](double BodyUnderPatch::*number, double value) {
    BodyUnderPatch body = usual;
    body.*number = value;
    return why_no_error_bounds(body);
  };
  EXPECT_EQ(with(&BodyUnderPatch::thickness, 1.001 * covered_thickness.least), "");
  EXPECT_NE(with(&BodyUnderPatch::thickness, 0.999 * covered_thickness.least), "");
  EXPECT_NE(with(&BodyUnderPatch::thickness, 0.0), "") << "no way in was found";
  EXPECT_NE(with(&BodyUnderPatch::thickness, 1.001 * covered_thickness.most), "");
  EXPECT_NE(with(&BodyUnderPatch::size, 0.999 * covered_size.least), "");
  EXPECT_NE(with(&BodyUnderPatch::size, 1.001 * covered_size.most), "");
  EXPECT_EQ(with(&BodyUnderPatch::voxel, 0.999 * covered_voxel), "");
  EXPECT_NE(with(&BodyUnderPatch::voxel, 1.001 * covered_voxel), "");
}

TEST(ErrorBounds, SaysInOneShortSentenceWhyThereIsNone) {
  const std::string thin = why_no_error_bounds({.thickness = 1.0, .size = 8.0, .voxel = 0.2});
  EXPECT_EQ(thin, "not calibrated for a thickness below 2.66 radii of the contact patch (here 1)");
  EXPECT_EQ(why_no_error_bounds({.thickness = 5.0, .size = 300.0, .voxel = 0.2}),
            "not calibrated for a body size above 262 radii of the contact patch (here 300)");
}

TEST(Grading, OfALargeBodyReachesOutToItsSizeAndOfAnOrdinaryOneStays) {
  ModelOptions options;
  options.boundary.indenter_diameter_mm = 2.0;
  grade_to_size(block_surface({0, 0, 0}, {31, 31, 31}), options);
  EXPECT_EQ(options.node_set.grading.reach, converging.grading.reach);
  ModelOptions tool = options, other_edge = options;
  const BodySurface large = block_surface({0, 0, 0}, {100, 100, 100});
  grade_to_size(large, options);
  EXPECT_NEAR(options.node_set.grading.reach, 100.0, 1e-9);
  EXPECT_NEAR(options.node_set.grading.patch_edge * 100.0,
              converging.grading.patch_edge * converging.grading.reach, 1e-12);
  tool.boundary.contact_radius_mm = 1.0;
  other_edge.node_set.grading.patch_edge = 0.1;
  for (ModelOptions* unchanged : {&tool, &other_edge}) {
    grade_to_size(large, *unchanged);
    EXPECT_EQ(unchanged->node_set.grading.reach, converging.grading.reach);
  }
}

TEST(ErrorBounds, IsNotShownOfTissuesThatDifferMoreThanItsScenesDid) {
  const auto of = [](std::vector<double> moduli, double nu = 0.499) {
    std::vector<Material> materials;
    for (const double mu : moduli) materials.push_back(neo_hookean(mu, nu, 1000.0));
    return why_no_error_bounds(materials);
  };
  EXPECT_EQ(of({210.0}), "");
  EXPECT_EQ(of({210.0, 840.0}), "");
  EXPECT_EQ(of({840.0, 210.0}), "");
  EXPECT_NE(of({210.0, 850.0}), "");
  EXPECT_NE(of({850.0, 210.0}), "") << "the softer one inside";
  EXPECT_NE(of({210.0, 2100.0}).find("above 4 (here 10)"), std::string::npos);
  EXPECT_NE(of({210.0, 2100.0, 21'000.0}).find("more than 2 tissues"), std::string::npos);
  EXPECT_NE(of({210.0, 210.0, 210.0}), "") << "more of them than any scene had";
  for (const double nu : {0.45, 0.499}) EXPECT_EQ(of({210.0}, nu), "");
  for (const double nu : {0.3, 0.449, 0.4995}) EXPECT_NE(of({210.0}, nu), "");
}

TEST(ErrorBounds, IsNeverNarrowerWithSeveralTissuesNorDeeperNorWithOtherNodesFurtherAway) {
  for (const Index nodes : {1000, 1500, 4000, 16'000})
    for (const double change : {0.0, 0.01, 0.1})
      for (double radii = 0.1; radii < deepest_with_error_bounds; radii += 0.1) {
        const double here = error_half_width(change, nodes, {radii, false});
        EXPECT_GE(error_half_width(change, nodes, {radii, true}), here);
        EXPECT_GE(error_half_width(change, nodes, {radii + 0.1, false}), here);
        EXPECT_GE(error_half_width(change + 0.01, nodes, {radii, false}), here);
      }
}

// Result of a block of two labels, of one material or of two equal ones.
Result of_block(const OptionTexts& differing) {
  static const LabelImage image =
      make_phantom({.shape = "block", .size_mm = {60, 60, 30}, .spacing_mm = 3, .two_labels = true});
  OptionTexts options = {{"cloud.nodes", "1000"}, {"load.depth_mm", "1"}, {"solver.frames", "4"}};
  options.insert(differing.begin(), differing.end());
  return simulate({.scene = scene_with(options), .image = &image, .error_bounds = true});
}

// Two equal tissues give the force of one, but the error bounds that were calibrated where tissues meet.
TEST(ErrorBounds, OfTwoTissuesIsWiderThoughTheyAreAlike) {
  const Result one = of_block({}), two = of_block({{"tissue.2.mu_Pa", "210"}});
  ASSERT_TRUE(one.error_bounds.known()) << one.error_bounds.unknown;
  ASSERT_TRUE(two.error_bounds.known()) << two.error_bounds.unknown;
  const double force = one.history.force.back().force;
  EXPECT_NEAR(two.history.force.back().force, force, 0.01 * force);
  EXPECT_GT(two.error_bounds.half.back(), 1.2 * one.error_bounds.half.back());
}

// Bounds are wider than for two discretisations that agree: these two differ.
TEST(ErrorBounds, ComparesTheNodesWithOthers) {
  const Result result = of_block({});
  ASSERT_TRUE(result.error_bounds.known()) << result.error_bounds.unknown;
  const ForceSample& last = result.history.force.back();
  const double agreed = error_half_width(0.0, 1000, {last.depth / result.model.tool.radius});
  EXPECT_GT(result.error_bounds.half.back(), (agreed + 1e-4) * last.force);
  EXPECT_EQ(result.error_bounds.coarse_nodes, 500);
}

}  // namespace
}  // namespace dimple
