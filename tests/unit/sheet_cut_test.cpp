// Cuts by a sheet between the nodes of a model, which keep their places.

#include "preprocess/supports/sheet_cut.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>

#include "io/error.hpp"
#include "preprocess/supports/support.hpp"
#include "preprocess/surface/sight.hpp"
#include "solver/session.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/report.hpp"

namespace dimple {
namespace {

const Material tissue = neo_hookean(210.0, 0.499, 1000.0);

// Sheet with n x m fields of two triangles between a corner and the ends of two edges.
std::shared_ptr<const Sheet> flat_sheet(const Vec3& corner, const Vec3& along, const Vec3& down, int n = 5,
                                        int m = 4) {
  Points vertex(3, (n + 1) * (m + 1));
  Triangles triangles(3, 2 * n * m);
  for (int j = 0; j <= m; ++j)
    for (int i = 0; i <= n; ++i) vertex.col(i + (n + 1) * j) = corner + along * i / n + down * j / m;
  Index t = 0;
  for (int j = 0; j < m; ++j)
    for (int i = 0; i < n; ++i) {
      const int a = i + (n + 1) * j, b = a + 1, c = b + n + 1, d = a + n + 1;
      triangles.col(t++) << a, b, c;
      triangles.col(t++) << a, c, d;
    }
  return std::make_shared<const Sheet>(std::move(vertex), std::move(triangles));
}

// Sheet next to the patch of the block of 30 x 30 x 20 mm, from above, 12 mm long and 8 deep.
std::shared_ptr<const Sheet> next_to_patch() {
  return flat_sheet({21.3e-3, 9e-3, 22e-3}, {0.0, 12e-3, 0.0}, {0.0, 0.0, -10e-3});
}

std::vector<Index> held_of(const Model& model) {
  std::vector<Index> held = model.base;
  held.insert(held.end(), model.bonded_patch.begin(), model.bonded_patch.end());
  return held;
}

SheetCut cut_of(const Model& model, const std::shared_ptr<const Sheet>& sheet,
                Looked looked = Looked::near_sheet) {
  return cut_by_sheet(model, sheet, {1000.0, 1000.0}, held_of(model), looked);
}

bool same_bits(const Model& a, const Model& b) {
  bool same =
      a.X == b.X && a.point == b.point && a.volume == b.volume && a.mass == b.mass &&
      a.second_moments == b.second_moments && a.support.offset == b.support.offset &&
      a.support.member == b.support.member && a.dphi == b.dphi && a.patches.psi == b.patches.psi &&
      a.patches.volume == b.patches.volume && a.patches.of_point.offset == b.patches.of_point.offset &&
      a.patches.of_point.member == b.patches.of_point.member && a.variance.size() == b.variance.size();
  for (std::size_t t = 0; same && t < a.variance.size(); ++t)
    same = a.variance[t].rows.offset == b.variance[t].rows.offset &&
           a.variance[t].rows.member == b.variance[t].rows.member && a.variance[t].K == b.variance[t].K;
  return same;
}

void expect_none_through(const Sheet& sheet, const Model& now) {
  ASSERT_TRUE(now.support_report.unconnected.empty());
  for (Index q = 0; q < now.point_count(); ++q)
    for (int k = now.support.offset[q]; k < now.support.offset[q + 1]; ++k)
      ASSERT_FALSE(sheet.between(now.X.col(now.support.member[k]), now.point.col(q))) << q;
}

TEST(ASheet, IsPassedByEverySegmentAcrossItAlsoThroughItsEdgesAndCorners) {
  const Vec3 corner(1.0, 2.0, 3.0);
  const auto sheet = flat_sheet(corner, {5.0, 0.0, 0.0}, {0.0, 4.0, 0.0});
  for (int k = 1; k < 40; ++k)  // half of them along a line of corners
    for (int l = 1; l < 32; ++l) {
      const Vec3 at = corner + Vec3(0.125 * k, 0.125 * l, 0.0);
      EXPECT_TRUE(sheet->between(at - Vec3::UnitZ(), at + Vec3::UnitZ())) << at.transpose();
      EXPECT_TRUE(sheet->between(at + Vec3(0.3, 0.1, 1.0), at - Vec3(0.3, 0.1, 1.0))) << at.transpose();
    }
  EXPECT_FALSE(sheet->between(corner + Vec3(-0.1, 1.0, -1.0), corner + Vec3(-0.1, 1.0, 1.0)));
  EXPECT_FALSE(sheet->between(corner + Vec3(1.0, 1.0, 0.5), corner + Vec3(4.0, 3.0, 0.6)));
}

// A valley z = |x| is as high as its extent along its mean normal.
TEST(ASheet, ThatIsBentIsPassedWhereverASegmentCrossesIt) {
  constexpr int half = 8;
  Points vertex(3, 2 * (2 * half + 1));
  Triangles triangles(3, 4 * half);
  for (int k = -half; k <= half; ++k)
    for (int end = 0; end < 2; ++end)
      vertex.col(2 * (k + half) + end) = Vec3(k, end == 0 ? -4.0 : 4.0, std::abs(k)) / half;
  for (int k = 0; k < 2 * half; ++k) {
    triangles.col(2 * k) << 2 * k, 2 * k + 2, 2 * k + 3;
    triangles.col(2 * k + 1) << 2 * k, 2 * k + 3, 2 * k + 1;
  }
  const Sheet sheet(vertex, triangles);
  for (const double x : {-0.93, -0.4, -0.07, 0.07, 0.31, 0.77}) {
    EXPECT_TRUE(sheet.between(Vec3(x, 0.1, 2.0), Vec3(x, 0.1, -1.0))) << x;
    EXPECT_TRUE(sheet.between(Vec3(x, 0.1, -1.0), Vec3(x, 0.1, 2.0))) << x;
    EXPECT_FALSE(sheet.between(Vec3(x, 0.1, 2.0), Vec3(x, 0.1, std::abs(x) + 0.01))) << x;
  }
  EXPECT_TRUE(sheet.between(Vec3(0.0, 0.1, 0.5), Vec3(0.9, 0.1, 0.5)));
  EXPECT_FALSE(sheet.between(Vec3(-0.3, 0.1, 0.5), Vec3(0.3, 0.1, 0.5)));
}

TEST(ASheet, HasAPlaceThatLiesOnItOnOneSideAlone) {
  const auto sheet = flat_sheet(Vec3::Zero(), {5.0, 0.0, 0.0}, {0.0, 4.0, 0.0});
  for (const Vec3& on : {Vec3(1.0, 1.0, 0.0), Vec3(2.3, 1.7, 0.0), Vec3(2.5, 0.5, 0.0)})
    EXPECT_NE(sheet->between(on, on + Vec3(0.1, 0.2, 1.0)), sheet->between(on, on + Vec3(0.1, 0.2, -1.0)));
}

TEST(ABodyThatASheetCuts, KeepsItsVolumeItsMiddleAndItsNodes) {
  const Model before = testing_bodies::averaged_block();
  const SheetCut cut = cut_of(before, next_to_patch());
  const Model& now = cut.model;
  EXPECT_GT(cut.divided, 20);
  EXPECT_EQ(now.point_count(), before.point_count() + cut.divided);
  EXPECT_NEAR(now.volume.sum(), before.volume.sum(), 1e-12 * before.volume.sum());
  EXPECT_LT((now.point * now.volume - before.point * before.volume).norm(), 1e-12 * before.volume.sum());
  EXPECT_NEAR(now.mass.sum(), before.mass.sum(), 1e-9 * before.mass.sum());
  EXPECT_NEAR(now.patches.volume.sum(), before.patches.volume.sum(), 1e-9 * before.volume.sum());
  EXPECT_TRUE(now.X.leftCols(before.node_count()) == before.X);
  EXPECT_GT(now.node_count(), before.node_count() + 5);
  EXPECT_NEAR(cut.area, 12e-3 * 8e-3, 0.15 * 12e-3 * 8e-3);
}

TEST(ABodyThatASheetCuts, HasTheGradientOfALinearFieldAtEveryPoint) {
  const SheetCut cut = cut_of(testing_bodies::averaged_block(), next_to_patch());
  const Model& now = cut.model;
  for (Index q = 0; q < now.point_count(); ++q) {
    Mat3 of_position = Mat3::Zero();
    Vec3 of_one = Vec3::Zero();
    for (int k = now.support.offset[q]; k < now.support.offset[q + 1]; ++k) {
      of_position += now.X.col(now.support.member[k]) * now.dphi.col(k).transpose();
      of_one += now.dphi.col(k);
    }
    ASSERT_LT((of_position - Mat3::Identity()).norm(), 1e-9) << q;
    ASSERT_LT(of_one.norm(), 1e-6) << q;
  }
}

// The weights of each point sum to one, and far from the cut they are the same to the bit.
TEST(ABodyThatASheetCuts, HasPatchesOnEachFaceAndTheOldOnesElsewhere) {
  const Model before = testing_bodies::averaged_block(9);
  const auto sheet = flat_sheet({21.3e-3, -1e-3, 22e-3}, {0.0, 32e-3, 0.0}, {0.0, 0.0, -16e-3}, 9, 6);
  const SheetCut cut = cut_of(before, sheet);
  const PressurePatches &now = cut.model.patches, &were = before.patches;
  ASSERT_GT(now.count(), were.count());
  ASSERT_EQ(static_cast<Index>(cut.of_patch.size()), now.count());
  EXPECT_GT(now.volume.minCoeff(), 0.0);
  Index same = 0;
  for (Index q = 0; q < cut.model.point_count(); ++q) {
    const auto psi = now.psi.segment(now.of_point.offset[q], now.of_point.count(q));
    ASSERT_NEAR(psi.sum(), 1.0, 1e-12);
    if (q >= before.point_count() || sheet->reaches(before.point.col(q), 9e-3)) continue;
    ++same;
    ASSERT_TRUE(psi == were.psi.segment(were.of_point.offset[q], were.of_point.count(q))) << q;
  }
  EXPECT_GT(same, before.point_count() / 3);
}

TEST(ABodyThatASheetCuts, IsTheSameToTheBitWhetherOneLooksNearTheSheetOrEverywhere) {
  for (const bool two_tissues : {false, true}) {
    const Model before = testing_bodies::averaged_block(
        8, 0.2, 1.8, [&](const Vec3& x) { return two_tissues && x.x() > 17e-3 ? 1 : 0; });
    const SheetCut near = cut_of(before, next_to_patch()),
                   all = cut_of(before, next_to_patch(), Looked::everywhere);
    EXPECT_EQ(near.changed, all.changed);
    EXPECT_EQ(near.of_patch, all.of_patch);
    EXPECT_EQ(near.model.variance.size(), two_tissues ? 2u : 1u);
    EXPECT_TRUE(same_bits(near.model, all.model));
    // A second cut across the first gives the same, too.
    const auto second = flat_sheet({17e-3, 14.2e-3, 22e-3}, {12e-3, 0.0, 0.0}, {0.0, 0.0, -10e-3});
    EXPECT_TRUE(
        same_bits(cut_of(near.model, second).model, cut_of(near.model, second, Looked::everywhere).model));
  }
}

// Supports that were not made consistent, as those of a body with folds, are recomputed fully. In a lattice
// many sums are zero, and remain where a cell has both nodes.
TEST(ABodyThatASheetCuts, HasTheSupportsAndTheVarianceThatAreFoundFromTheStart) {
  for (const double scatter : {0.2, 0.0}) {
    Model before = testing_bodies::averaged_block(8, scatter);
    find_supports(before);  // state before they were made consistent
    const SheetCut cut = cut_of(before, next_to_patch());
    Model whole = cut.model;
    find_supports(whole, *cut.model.sight);
    EXPECT_TRUE(whole.support.offset == cut.model.support.offset);
    EXPECT_TRUE(whole.support.member == cut.model.support.member);
    EXPECT_TRUE(whole.dphi == cut.model.dphi);
    EXPECT_TRUE(whole.variance[0].rows.member == cut.model.variance[0].rows.member);
    EXPECT_TRUE(whole.variance[0].K == cut.model.variance[0].K);
  }
}

// Block and blade are rotated about an axis of no symmetry.
TEST(ABodyThatASheetCuts, HasNoNodeThroughTheSheetHoweverItsImageIsTurned) {
  Discretisation places = testing_bodies::block_places(6, 0.2, 1.8);
  places.second_moments = SecondMoments::Zero(6, places.point_count());
  places.second_moments.topRows<3>().setConstant(std::pow(places.volume[0], 2.0 / 3.0) / 12.0);
  const Mat3 R = Eigen::AngleAxisd(0.7, Vec3(0.3, 0.5, 0.8).normalized()).toRotationMatrix();
  const auto sheet = next_to_patch();
  const auto turned_sheet = std::make_shared<const Sheet>(R * sheet->vertex(), sheet->triangles());
  places.X = (R * places.X).eval(), places.point = (R * places.point).eval();
  places.second_moments = turned(places.second_moments, R);
  places.surface.vertex_mm = (R * places.surface.vertex_mm).eval();
  places.tool.centre = R * places.tool.centre, places.tool.approach = R * places.tool.approach;
  places.axes = R;
  Eigen::VectorXi tissues = places.label;
  const Model before = make_model(std::move(places), converging, std::move(tissues), {1000.0});
  const SheetCut cut = cut_of(before, turned_sheet);
  const Model& now = cut.model;
  expect_none_through(*turned_sheet, now);
  EXPECT_TRUE(same_bits(now, cut_of(before, turned_sheet, Looked::everywhere).model));
}

TEST(ABodyThatASheetCuts, HasRowsForAllNodesAlsoInATissueFarFromTheSheet) {
  const Model before =
      testing_bodies::averaged_block(9, 0.2, 1.8, [](const Vec3& x) { return x.x() < 6e-3 ? 1 : 0; });
  const SheetCut cut = cut_of(before, next_to_patch());
  ASSERT_EQ(cut.model.variance.size(), 2u);
  for (const GradientVariance& v : cut.model.variance) {
    ASSERT_EQ(v.rows.rows(), cut.model.node_count());
    EXPECT_EQ(v.rows.offset[v.rows.rows()], v.K.size());
  }
  EXPECT_TRUE(cut.model.tissue.head(before.point_count()) == before.tissue);
  for (Index q = before.point_count(); q < cut.model.point_count(); ++q) EXPECT_EQ(cut.model.tissue[q], 0);
}

TEST(ABodyThatASheetCuts, IsRefusedWhereTheBladeMissesItOrPartsAPieceOff) {
  const Model before = testing_bodies::averaged_block();
  const auto code_of = [&](const std::shared_ptr<const Sheet>& sheet) {
    const Report report = report_of<ModelError>([&] { cut_of(before, sheet); });
    return report.code + ": " + report.fact;
  };
  EXPECT_EQ(code_of(flat_sheet({50e-3, 0.0, 0.0}, {0.0, 12e-3, 0.0}, {0.0, 0.0, 10e-3})),
            "cut: the blade meets no tissue");
  const std::string parted =
      code_of(flat_sheet({22.4e-3, -1e-3, 21e-3}, {0.0, 32e-3, 0.0}, {12e-3, 0.0, -14e-3}, 9, 9));
  EXPECT_NE(parted.find("from every held part"), std::string::npos) << parted;
}

TEST(ABodyThatASheetCuts, IsCutASecondTimeAcrossTheFirst) {
  const Model before = testing_bodies::averaged_block(8);
  const auto first = next_to_patch(),
             second = flat_sheet({17e-3, 14.2e-3, 22e-3}, {12e-3, 0.0, 0.0}, {0.0, 0.0, -10e-3});
  const SheetCut once = cut_of(before, first), twice = cut_of(once.model, second);
  const Model& now = twice.model;
  EXPECT_NEAR(now.volume.sum(), before.volume.sum(), 1e-12 * before.volume.sum());
  Index through = 0;
  for (Index q = 0; q < now.point_count(); ++q)
    for (int k = now.support.offset[q]; k < now.support.offset[q + 1]; ++k)
      through += first->between(now.X.col(now.support.member[k]), now.point.col(q)) ||
                 second->between(now.X.col(now.support.member[k]), now.point.col(q));
  // A point in the corner of both sheets may see too few nodes, and then uses nearby ones.
  const auto unconnected = static_cast<Index>(now.support_report.unconnected.size());
  EXPECT_LE(through, 40 * unconnected);
  EXPECT_LT(unconnected, 20);
}

Session session_on(const Model& model) {
  return Session(model, {tissue});
}

// A hand may repeat a cut: then no cell is between two sheets, and nothing becomes stiffer.
TEST(ABodyThatASheetCuts, IsNotCutAgainWhereItIsCut) {
  const SheetCut first = cut_of(testing_bodies::averaged_block(), next_to_patch());
  const auto next_to = [](double off, double down) {
    return flat_sheet({21.3e-3 + off, 9e-3, 22e-3}, {0.0, 12e-3, 0.0}, {0.0, 0.0, -down});
  };
  for (const double off : {0.0, 0.1e-3, -0.1e-3})
    EXPECT_THROW(cut_of(first.model, next_to(off, 9e-3)), ModelError) << off;
  // A deeper cut removes the remainder; one across it is complete.
  const SheetCut deeper = cut_of(first.model, next_to(0.1e-3, 15e-3));
  const SheetCut at_once = cut_of(testing_bodies::averaged_block(), next_to(0.0, 15e-3));
  EXPECT_GT(deeper.area, 0.0);
  EXPECT_LT(deeper.area + first.area, 1.3 * at_once.area);
  const auto across = flat_sheet({17e-3, 15.3e-3, 22e-3}, {9e-3, 0.0, 0.0}, {0.0, 0.0, -8e-3});
  const double whole = cut_of(testing_bodies::averaged_block(), across).area;
  EXPECT_NEAR(cut_of(first.model, across).area, whole, 0.15 * whole);
  const auto force = [](const SheetCut& cut) {
    Session session(cut.model, {tissue});
    session.equilibrate(1e-3);
    return session.force();
  };
  EXPECT_LT(force(deeper), force(first));
  EXPECT_NEAR(force(deeper), force(at_once), 0.01 * force(at_once));
}

TEST(ALiveBodyThatIsCut, ComesToTheForceOfTheBodyThatWasCutFromTheStart) {
  const Model before = testing_bodies::averaged_block(8);
  const SheetCut cut = cut_of(before, next_to_patch());
  Session whole = session_on(before), from_start = session_on(cut.model), live = session_on(cut.model);
  const double depth = 1.5e-3;
  for (int k = 1; k <= 15; ++k) whole.follow(1e-4 * k, {.evaluations = 40});
  for (int k = 1; k <= 15; ++k) from_start.follow(1e-4 * k, {.evaluations = 40});
  live.continue_from(whole, carried(cut, whole.nodal_parameters()), cut.of_patch);
  EXPECT_EQ(live.depth(), whole.depth());
  EXPECT_TRUE(live.nodal_parameters().leftCols(before.node_count()) == whole.nodal_parameters());
  LiveFrame frame;
  for (int k = 0; k < 12; ++k) frame = live.follow(depth, {.evaluations = 20});
  EXPECT_EQ(frame.tool, LiveFrame::Tool::there);
  const LiveFrame expected = from_start.follow(depth, {.evaluations = 40});
  EXPECT_NEAR(frame.force, expected.force, 2e-3 * expected.force);
  const LiveFrame uncut = whole.follow(depth, {.evaluations = 40});
  EXPECT_LT(frame.force, 0.99 * uncut.force) << "a cut beside the tool makes the body softer";
}

TEST(ALiveBodyThatIsCut, StatesAnErrorAsLargeAsTheForceUntilItHasFoundItsEquilibrium) {
  const Model before = testing_bodies::averaged_block(8);
  const SheetCut cut = cut_of(before, next_to_patch());
  Session whole = session_on(before), live = session_on(cut.model);
  for (int k = 1; k <= 15; ++k) whole.follow(1e-4 * k, {.evaluations = 40});
  live.continue_from(whole, carried(cut, whole.nodal_parameters()), cut.of_patch);
  const LiveFrame first = live.follow(1.5e-3, {.evaluations = 1});
  EXPECT_EQ(first.tool, LiveFrame::Tool::lags);
  EXPECT_GE(first.error, std::abs(first.force));
}

TEST(ALiveBodyThatIsCut, LiesAtRestWithoutAToolInIt) {
  const Model before = testing_bodies::averaged_block();
  const SheetCut cut = cut_of(before, next_to_patch());
  Session whole = session_on(before), live = session_on(cut.model);
  live.continue_from(whole, carried(cut, whole.nodal_parameters()), cut.of_patch);
  EXPECT_EQ(live.follow(0.0, {.evaluations = 5}).force, 0.0);
  EXPECT_EQ(live.nodal_parameters().norm(), 0.0);
}

}  // namespace
}  // namespace dimple
