// Blades that are drawn in a deformed body, mapped back to the tissue at rest.

#include "preprocess/output/carry_back.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "io/error.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/supports/support.hpp"
#include "preprocess/surface/cut.hpp"
#include "tests/helpers/image.hpp"
#include "tests/helpers/report.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

const Vec3 low_corner(-30.0, -30.0, 0.0), high_corner(30.0, 30.0, 30.0);

const Model& whole_block() {
  static const Model model = [] {
    ModelOptions options;
    options.node_set.count = 800;
    return build_model(block_surface(low_corner, high_corner), options).model;
  }();
  return model;
}

LabelImage block_image() {
  return image_of({24, 24, 14}, Vec3::Constant(3.0), [](Index i, Index j, Index k) {
    return i > 1 && i < 22 && j > 1 && j < 22 && k > 1 && k < 12 ? 1 : 0;
  });
}

Points shifted_by(const Model& model, const std::function<Vec3(const Vec3&)>& u) {
  Points result(3, model.node_count());
  for (Index a = 0; a < result.cols(); ++a) result.col(a) = u(model.X.col(a));
  return result;
}

std::string refusal_of(const TriangleMesh& sheet, const Model& model, const Points& u) {
  const Report report = report_of<ModelError>([&] { carried_back(sheet, model, u); });
  EXPECT_EQ(report.code, "cut");
  return report.fact;
}

// The map x = A X + b is exact in moving least squares.
TEST(ABladeCarriedBack, UndoesAStretchThatTurnsAndShearsToTheLastMicrometre) {
  Mat3 A;
  A << 1.2, 0.3, 0.0, -0.1, 0.9, 0.2, 0.05, 0.0, 0.8;
  const Vec3 b(3e-3, -2e-3, 1e-3);
  const Points u = shifted_by(whole_block(), [&](const Vec3& X) { return Vec3(A * X + b - X); });
  const TriangleMesh sheet = disc_sheet(A * Vec3(5.0, 2.0, 14.0) + 1e3 * b, {1.0, 0.4, 0.3}, 8.0, 1.5);
  const TriangleMesh undeformed = carried_back(sheet, whole_block(), u);
  ASSERT_EQ(undeformed.vertex.cols(), sheet.vertex.cols()) << "all of it lies in the body";
  const Points expected = A.inverse() * (sheet.vertex.colwise() - 1e3 * b);
  EXPECT_LT((undeformed.vertex - expected).cwiseAbs().maxCoeff(), 1e-3);
}

// The displacement is not uniform. The result is mapped forward with shape functions not used by the search.
TEST(ABladeCarriedBack, InABentAndPressedBodyEndsWhereTheTissueGoesThere) {
  ModelOptions options;
  options.node_set.count = 800;
  const Model model = build_model(block_image(), {}, options).model;
  const Vec3 middle(34.5, 34.5, 4.5);
  const Points u = shifted_by(model, [&](const Vec3& X) {
    const Vec3 x = 1e3 * X - middle;
    const double dent = 4.0 * std::exp(-(x.x() * x.x() + x.y() * x.y()) / 100.0) * x.z() / 30.0;
    return Vec3(1e-3 * Vec3(0.02 * x.z() * x.z() / 3.0, 0.1 * x.x(), -dent));
  });
  TriangleMesh sheet = swept_sheet(middle + Vec3(6.0, -40.0, 34.0), middle + Vec3(10.0, 40.0, 34.0),
                                   -Vec3::UnitZ(), 0.0, 20.0, 1.5);
  const TriangleMesh undeformed = carried_back(sheet, model, u);
  EXPECT_LT(undeformed.triangles.cols(), sheet.triangles.cols()) << "what lies far outside is left out";
  const BodySurface body(model.surface.vertex_mm, model.surface.triangles);
  const Points there = 1e3 * inner_interpolation(model, 1e-3 * undeformed.vertex)(u) + undeformed.vertex;
  int inside = 0;
  for (Index v = 0; v < undeformed.vertex.cols(); ++v) {
    if (!body.contains(undeformed.vertex.col(v))) continue;
    double nearest = 1e9;
    for (const auto& x : sheet.vertex.colwise()) nearest = std::min(nearest, (x - there.col(v)).norm());
    EXPECT_LT(nearest, 2e-3) << undeformed.vertex.col(v).transpose();
    ++inside;
  }
  EXPECT_GT(inside, 300);
}

TEST(ABladeCarriedBack, ThatMissesTheBodyAsItThenIsIsRefusedThoughItMetTheBodyAtRest) {
  const Points u = shifted_by(whole_block(), [](const Vec3&) { return Vec3(0.1, 0.0, 0.0); });
  const TriangleMesh sheet = disc_sheet({0.0, 0.0, 15.0}, Vec3::UnitX(), 10.0, 2.0);
  EXPECT_EQ(refusal_of(sheet, whole_block(), u), "a cut meets no tissue");
  EXPECT_NO_THROW(carried_back(disc_sheet({100.0, 0.0, 15.0}, Vec3::UnitX(), 10.0, 2.0), whole_block(), u));
}

// The faces of a slit have passed through each other by 12 mm: two pieces of tissue overlap there.
TEST(ABladeCarriedBack, IsRefusedWhereTwoPartsOfTheBodyHaveComeToLie) {
  ModelOptions options;
  options.node_set.count = 1500;
  const Model slit = build_model(slit_block_surface({60.0, 60.0, 30.0}, 12.0, 0.5, 28.0), options).model;
  const Points u = shifted_by(slit, [](const Vec3& X) {
    return X.z() > 6e-3 ? Vec3((X.x() > 12.2e-3 ? -1.0 : 1.0) * 6e-3 * (X.z() - 6e-3) / 20e-3, 0.0, 0.0)
                        : Vec3(0.0, 0.0, 0.0);
  });
  const TriangleMesh through = disc_sheet({12.25, 0.0, 26.0}, Vec3::UnitY(), 3.0, 1.0);
  EXPECT_NE(refusal_of(through, slit, u).find("two parts of the body"), std::string::npos);
  EXPECT_NO_THROW(carried_back(disc_sheet({-15.0, 0.0, 20.0}, Vec3::UnitY(), 3.0, 1.0), slit, u));
}

// In the gap there is no tissue to follow: between the faces of the cut the blade is straight.
TEST(ABladeCarriedBack, AcrossACutThatGapesGoesFromFaceToFaceWithHardlyAFold) {
  ModelOptions options;
  options.node_set.count = 1500;
  const BodySurface body = make_body_surface(block_image(), {}).surface;
  const Vec3 at(45.0, 34.5, 34.5);  // its middle is at x = y = 34.5, its top at z = 34.5
  const TriangleMesh slit =
      swept_sheet(at + Vec3(0.0, -40.0, 0.0), at + Vec3(0.0, 40.0, 0.0), -Vec3::UnitZ(), 3.0, 26.0, 2.0);
  const Eigen::Isometry3d to_body = body.to_world().inverse();
  const TriangleMesh there{(to_body * slit.vertex.colwise().homogeneous()).eval(), slit.triangles};
  const Model model =
      build_model(cut(body, {there}, 0.5, to_body * Vec3(34.5, 34.5, 34.5)).surface, options).model;
  const Points u = shifted_by(model, [&](const Vec3& X) {
    const double up = std::max(0.0, X.z() - 1e-3 * (at.z() - 24.0)) / 24e-3;
    return Vec3((X.x() > 1e-3 * at.x() ? 1.0 : -1.0) * 4e-3 * up, 0.0, 0.0);
  });
  const TriangleMesh across = carried_back(
      swept_sheet(at + Vec3(-9.0, 0.0, -3.0), at + Vec3(9.0, 0.0, -3.0), -Vec3::UnitZ(), 0.0, 8.0, 1.0),
      model, u);
  double area = 0.0;
  for (const auto& t : across.triangles.colwise()) {
    const Vec3 a = across.vertex.col(t[0]);
    const double twice = -Vec3(across.vertex.col(t[1]) - a).cross(Vec3(across.vertex.col(t[2]) - a)).y();
    EXPECT_GT(std::abs(twice), 1e-6);
    area += 0.5 * twice;
  }
  double turned = 0.0;
  for (const auto& t : across.triangles.colwise()) {
    const Vec3 a = across.vertex.col(t[0]);
    turned += 0.5 * std::abs(Vec3(across.vertex.col(t[1]) - a).cross(Vec3(across.vertex.col(t[2]) - a)).y());
  }
  EXPECT_LT(turned - std::abs(area), 0.04 * turned)
      << "the triangles face one way but for a twenty-fifth of their area";
}

TEST(ABladeCarriedBack, OfAClosedRegionStaysClosed) {
  const Points u = shifted_by(whole_block(), [](const Vec3& X) { return Vec3(0.2 * X.z(), 0.0, 0.0); });
  const BodySurface region = block_surface({5.0, -5.0, 20.0}, {15.0, 5.0, 40.0});
  const TriangleMesh undeformed = carried_back({region.vertex(), region.triangles()}, whole_block(), u);
  EXPECT_EQ(undeformed.triangles.cols(), region.triangles().cols());
  EXPECT_NO_THROW(BodySurface(undeformed.vertex, undeformed.triangles));
}

}  // namespace
}  // namespace dimple
