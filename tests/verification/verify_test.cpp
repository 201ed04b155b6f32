// The cases of `dimple verify` that take seconds, through its functions.

#include "apps/verify.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "apps/verify_bodies.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

constexpr Index few_nodes = 1000;

std::vector<VerifyCase> rows_of(const std::string& group, const std::string& beginning = "") {
  std::vector<VerifyCase> rows = verify({group}, few_nodes, {});
  std::erase_if(rows, [&](const VerifyCase& row) { return row.name.rfind(group + "/" + beginning, 0) != 0; });
  return rows;
}

void expect_passed(const std::vector<VerifyCase>& rows) {
  EXPECT_FALSE(rows.empty());
  for (const VerifyCase& row : rows)
    EXPECT_TRUE(row.passed) << row.name << ": " << row.ours << " " << row.unit << ", known " << row.reference
                            << ", error " << row.error << ", tolerance " << row.tolerance;
}

TEST(Verify, ABarWithFreeSidesIsStretchedAsInClosedForm) {
  expect_passed(rows_of("homogeneous", "free_sides"));
}

TEST(Verify, AHeldCubeCarriesTheStressOfItsStretchAlsoUnderGreatPressure) {
  for (const char* stretch : {"uniaxial", "confined", "equibiaxial"})
    expect_passed(rows_of("homogeneous", stretch));
}

TEST(Verify, OgdenBarsAndCubesCarryTheirClosedFormStress) {
  expect_passed(rows_of("ogden"));
}

TEST(Verify, AShearedCubeRelaxesAsItsPronySeriesSays) {
  expect_passed(rows_of("viscoelastic"));
}

TEST(Verify, TwoLayersInSeriesShareTheirStress) {
  expect_passed(rows_of("layers"));
}

// Two tissues, a jittered cloud and an interface that cuts cells: who is called 0 and who 1 is nobody's
// business.
TEST(Verify, SwappingTheNumbersOfTwoTissuesChangesNothing) {
  const std::vector<Material> material = {neo_hookean(210.0, 0.499, 1000.0),
                                          neo_hookean(900.0, 0.45, 1100.0)};
  const auto force = [&](bool swapped) {
    Lattice lattice = box_lattice(Vec3::Constant(0.02), 6);
    const auto inner = [](const Vec3& x) { return (x - Vec3::Constant(0.01)).norm() < 0.006; };
    lattice.tissue = [=](const Vec3& x) { return inner(x) != swapped ? 1 : 0; };
    LatticeBody body = make_lattice(lattice);
    auto kind = boundary_fixed(body);
    const Statics cube(std::move(body), std::move(kind),
                       swapped ? std::vector<Material>{material[1], material[0]} : material);
    const Mat3 F = (Mat3() << 1.0, 0.2, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0).finished();
    const Equilibrium found = cube.solve(
        {.displacement =
             [&](double share) {
               return affine_displacement(cube.model(), Mat3::Identity() + share * (F - Mat3::Identity()));
             }},
        1, 1e-8);
    return mean_stress(cube.model(), found.f);
  };
  const Mat3 one = force(false), other = force(true);
  EXPECT_LT((one - other).norm(), 1e-5 * one.norm()) << one << "\n\n" << other;
}

TEST(Verify, AnUnknownCaseIsRefusedWithASuggestion) {
  try {
    verify({"hays"}, few_nodes, {});
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_NE(error.report.fact.find("hayes"), std::string::npos) << error.report.fact;
  }
}

TEST(Verify, RowsThatFailAreNamedInTheError) {
  const std::vector<VerifyCase> rows = {compared("a/good", "good", 1.0, 1.01, 0.02, "N", "us"),
                                        compared("a/bad", "bad", 1.0, 2.0, 0.02, "N", "us")};
  try {
    require_passed(rows);
    FAIL();
  } catch (const SolveError& error) {
    EXPECT_NE(error.report.where.find("a/bad"), std::string::npos);
    EXPECT_EQ(error.report.where.find("a/good"), std::string::npos);
  }
  EXPECT_NO_THROW(require_passed({rows.front()}));
}

TEST(Verify, StopsWhenAsked) {
  EXPECT_TRUE(verify({}, few_nodes, [](const std::string&) { return false; }).empty());
}

}  // namespace
}  // namespace dimple
