// All groups of dimple_verify, one per test, so that ctest runs them in parallel.

#include "tests/verification/verify.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "io/error.hpp"
#include "tests/helpers/report.hpp"
#include "tests/verification/verify_bodies.hpp"

namespace dimple {
namespace {

constexpr Index standard_nodes = 4250, few_nodes = 1000;

void expect_within(const std::vector<VerifyCase>& rows, double more) {
  EXPECT_FALSE(rows.empty());
  for (const VerifyCase& row : rows)
    EXPECT_LE(row.error, row.tolerance + more)
        << row.name << ": " << row.ours << " " << row.unit << ", known " << row.reference;
}

std::vector<std::string> group_names() {
  std::vector<std::string> names;
  for (const VerifyGroup& group : verify_groups()) names.push_back(group.name);
  return names;
}

class EveryRow : public testing::TestWithParam<std::string> {};

TEST_P(EveryRow, IsWithinItsTolerance) {
#ifdef DIMPLE_QUICK_GROUPS_ONLY
  const std::vector<std::string> slow = {"inclusion", "manufactured", "hayes", "compressibility"};
  if (std::find(slow.begin(), slow.end(), GetParam()) != slow.end())
    GTEST_SKIP() << "skipped: too slow under a sanitizer";
#endif
  expect_within(verify({GetParam()}, standard_nodes), 0.0);
}

INSTANTIATE_TEST_SUITE_P(Verify, EveryRow, testing::ValuesIn(group_names()),
                         [](const auto& name) { return name.param; });

// With half as many nodes the scheme's error is larger.
TEST(Verify, ForcesOfHalfAsManyNodesAreAPercentFartherFromTheReferencesAtMost) {
  expect_within(verify({"scene_a", "scene_b"}, 2000), 0.01);
}

// Hayes et al. 1972, table 1; and a half-space, where the layer has no effect.
TEST(Verify, ThePunchOnALayerIsAsHayesPrintedItAndOnAHalfSpaceAsBoussinesqFoundIt) {
  EXPECT_NEAR(hayes_factor(0.2, 0.3), 1.207, 0.001);
  EXPECT_NEAR(hayes_factor(0.2, 0.5), 1.281, 0.001);
  EXPECT_NEAR(hayes_factor(1.0, 0.3), 2.480, 0.005);
  EXPECT_NEAR(hayes_factor(1.0, 0.5), 3.609, 0.011);
  EXPECT_NEAR(hayes_factor(0.001, 0.3), 1.0, 0.001);
}

// Two tissues, jittered nodes and an interface that cuts cells: results must not depend on which tissue is
// number 0.
TEST(Verify, SwappingTheNumbersOfTwoTissuesChangesNothing) {
  const std::vector<Material> material = {neo_hookean(210.0, 0.499, 1000.0),
                                          neo_hookean(900.0, 0.45, 1100.0)};
  const auto force = [&](bool swapped) {
    Lattice lattice = box_lattice(Vec3::Constant(0.02), 6);
    const auto inner = [](const Vec3& x) { return (x - Vec3::Constant(0.01)).norm() < 0.006; };
    lattice.tissue = [=](const Vec3& x) { return inner(x) != swapped ? 1 : 0; };
    LatticeBody body = make_lattice(lattice);
    auto held = boundary_fixed(body);
    const Statics cube(std::move(body), std::move(held),
                       swapped ? std::vector<Material>{material[1], material[0]} : material);
    const Mat3 F = (Mat3() << 1.0, 0.2, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0).finished();
    const Equilibrium found = cube.solve(
        {.displacement =
             [&](double fraction) {
               return affine_displacement(cube.model(), Mat3::Identity() + fraction * (F - Mat3::Identity()));
             }},
        1, 1e-8);
    return mean_stress(cube.model(), found.f);
  };
  const Mat3 one = force(false), other = force(true);
  EXPECT_LT((one - other).norm(), 1e-5 * one.norm()) << one << "\n\n" << other;
}

TEST(Verify, AnUnknownCaseIsRefusedWithASuggestion) {
  expect_error<UsageError>([&] { verify({"hays"}, few_nodes); }, {.fact = "hayes"});
}

TEST(Verify, RowsThatFailAreNamedInTheError) {
  const std::vector<VerifyCase> rows = {compared("a/good", "good", 1.0, 1.01, 0.02, "N", "us"),
                                        compared("a/bad", "bad", 1.0, 2.0, 0.02, "N", "us")};
  const std::string where = report_of<SolveError>([&] { require_passed(rows); }).where;
  EXPECT_NE(where.find("a/bad"), std::string::npos);
  EXPECT_EQ(where.find("a/good"), std::string::npos);
  EXPECT_NO_THROW(require_passed({rows.front()}));
}

}  // namespace
}  // namespace dimple
