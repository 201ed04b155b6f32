#include "preprocess/supports/support.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/error.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/report.hpp"

namespace dimple {
namespace {

using namespace testing_bodies;
using testing::HasSubstr;

TEST(Support, HoldsExactlyTheNodesWhoseRadiusReachesThePoint) {
  Model model = block(5);
  const SupportReport report = find_supports(model, {.radius_factor = 2.1});
  ASSERT_EQ(report.grown, 0);
  Index fewest = model.node_count(), most = 0;
  for (Index q = 0; q < model.point_count(); ++q) {
    std::vector<int> expected;
    for (int a = 0; a < model.node_count(); ++a)
      if ((model.X.col(a) - model.point.col(q)).norm() < 2.1 * model.spacing[a]) expected.push_back(a);
    const auto members = model.support.member.segment(model.support.offset[q], model.support.count(q));
    ASSERT_THAT(members, testing::ElementsAreArray(expected)) << "point " << q;
    fewest = std::min(fewest, model.support.count(q));
    most = std::max(most, model.support.count(q));
  }
  EXPECT_EQ(report.fewest, fewest);
  EXPECT_EQ(report.most, most);
  EXPECT_EQ(model.dphi.cols(), model.support.member.size());
  EXPECT_LT(report.linear_error, 1e-10);
}

TEST(Support, GrowsUntilThereAreTwiceAsManyNodesAsTheBasisHasTermsAndSaysSo) {
  Model model = block(5);
  const SupportReport report = find_supports(model, {.radius_factor = 1.0});
  EXPECT_GT(report.grown, 0);
  EXPECT_GT(report.largest_growth, 1.0);
  EXPECT_LE(report.largest_growth, 2.5);
  EXPECT_GE(report.fewest, 8);
  EXPECT_LT(report.linear_error, 1e-10);
}

// Supports are computed at eight points of each cell; an integration point counts once.
TEST(Support, HasGrownAtNoMorePointsThanThereAre) {
  Model model = testing_bodies::averaged_block(5);
  const SupportReport report = find_supports(model, {.radius_factor = 0.9});
  EXPECT_GT(report.grown, model.point_count() / 2);
  EXPECT_LE(report.grown, model.point_count());
}

// Two sheets of nodes, the upper one out of reach at first: no gradient across the sheet without growth.
TEST(Support, GrowsWhereTheNodesInReachLieInOnePlane) {
  Model model;
  model.scheme = horton2007;
  model.X.resize(3, 2 * 49);
  for (int a = 0; a < 98; ++a) model.X.col(a) = 1e-3 * Vec3(a % 7, (a / 7) % 7, a < 49 ? 0.0 : 2.3);
  model.spacing = Eigen::VectorXd::Constant(98, 1e-3);
  model.point = 1e-3 * Vec3(3.2, 3.1, 0.0);
  model.volume = Eigen::VectorXd::Constant(1, 1e-9);
  const SupportReport report = find_supports(model, {.radius_factor = 1.9});
  EXPECT_EQ(report.grown, 1);
  EXPECT_LT(report.linear_error, 1e-10);
  EXPECT_GE(model.support.member.maxCoeff(), 49);
}

TEST(Support, WhereNoGrowthHelpsTheMessageSaysWhereAndNamesTheOption) {
  Model model;
  model.scheme = horton2007;
  model.X.resize(3, 49);
  for (int a = 0; a < 49; ++a) model.X.col(a) = 1e-3 * Vec3(a % 7, a / 7, 0.0);  // one sheet
  model.spacing = Eigen::VectorXd::Constant(49, 1e-3);
  model.point = 1e-3 * Vec3(3.2, 3.1, 0.0);
  model.volume = Eigen::VectorXd::Constant(1, 1e-9);
  const Report report = report_of<ModelError>([&] { find_supports(model, {.radius_factor = 1.8}); });
  EXPECT_THAT(report.fact, HasSubstr("integration point 0"));
  EXPECT_THAT(report.where, HasSubstr("(3.20, 3.10, 0.00) mm"));
  EXPECT_THAT(report.remedy, HasSubstr("support.radius_factor"));
  EXPECT_FALSE(report.why.empty());
}

TEST(Interpolation, ReproducesLinearFieldsAtPlacesOfItsOwn) {
  const Model model = block(5);
  Points places(3, 4);
  places << 1, 15, 29.5, 7, 2, 15, 29, 22, 0.5, 10, 19.5, 13;
  places *= 1e-3;
  const Interpolation at = make_interpolation(model, {}, places);
  const Mat3 A = (Mat3() << 1, 2, 3, 4, 5, 6, 7, 8, 10).finished();
  const Points exact = (A * places).colwise() + Vec3(1, 2, 3);
  const Points nodal = (A * model.X).colwise() + Vec3(1, 2, 3);
  EXPECT_LT((at(nodal) - exact).cwiseAbs().maxCoeff(), 1e-10 * exact.cwiseAbs().maxCoeff());
}

TEST(Interpolation, IsTheSameFieldAtNodesInsideAndOnTheSurface) {
  Model model = block(5);
  model.surface.vertex_mm = 1e3 * model.X;  // one set of places in three files
  const Points nodal = model.X.unaryExpr([](double x) { return std::sin(300.0 * x); });
  const Points at_nodes = node_interpolation(model)(nodal);
  EXPECT_LT((at_nodes - surface_interpolation(model)(nodal)).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_LT((at_nodes - inner_interpolation(model, model.X)(nodal)).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Interpolation, TakesTheNearestNodeWherePlacesLieFarOut) {
  const Model model = block(5);
  const Interpolation at = make_interpolation(model, {}, Vec3(1.0, 1.0, 1.0));
  ASSERT_EQ(at.weight.size(), 1);
  EXPECT_EQ(at.rows.member[0], static_cast<int>(model.node_count()) - 1);  // the corner
}

}  // namespace
}  // namespace dimple
