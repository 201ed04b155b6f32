// The hexahedra that other programs get where a study compares them with ours.

#include "tests/bench/peer/hexahedra.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "io/error.hpp"
#include "tests/bench/peer/hexahedral_model.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST(CalculixInput, BreaksTheLongLinesOfHexahedra) {
  ElementModel model;
  model.X = Points::Random(3, 20);
  model.elements = Eigen::Matrix<Index, 20, 1>::LinSpaced(20, 0, 19);
  EXPECT_THAT(calculix_input(model, "C3D20R"),
              HasSubstr("TYPE=C3D20R, ELSET=tissue\n1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, "
                        "11, 12,\n13, 14, 15, 16, 17, 18, 19, 20\n"));
}

TEST(WithoutMiddles, KeepsTheCornersAndTheirSets) {
  ElementModel model;
  model.X = Points::Random(3, 20);
  model.elements = Eigen::Matrix<Index, 20, 1>::LinSpaced(20, 0, 19);
  model.base = {0, 1, 8};
  model.circle = {6, 7, 19};
  const ElementModel corners = without_middles(model, 8);
  EXPECT_EQ(corners.X.cols(), 8);
  EXPECT_THAT(corners.base, ElementsAre(0, 1));
  EXPECT_THAT(corners.circle, ElementsAre(6, 7));
  EXPECT_THAT(febio_input(corners, "hex8"), HasSubstr("<elem id=\"1\">1,2,3,4,5,6,7,8</elem>"));
}

TEST(Hexahedra, FillABlockExactlyAndMarkItsBaseAndCircle) {
  const BodySurface block = block_surface({-15, -20, 0}, {15, 20, 15});
  const Boundary boundary = find_boundary(block, {.base = "inferior", .indent_at = "0,0,top"});
  const GradingOptions grading{.rim = 0.1};
  const double spacing = hexahedra_spacing_for_count(block, boundary, grading, 1500);
  const HexahedralMesh mesh = make_hexahedra(block, boundary, grading, spacing);
  EXPECT_NEAR(static_cast<double>(mesh.X.cols()), 1500.0, 300.0);
  EXPECT_NEAR(mesh.volume_mm3, block.volume(), 1e-6 * block.volume());
  static constexpr int ends[12][2] = {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {4, 5}, {5, 6},
                                      {6, 7}, {7, 4}, {0, 4}, {1, 5}, {2, 6}, {3, 7}};
  for (Index e = 0; e < mesh.hexahedra.cols(); ++e) {
    Eigen::Matrix<double, 3, 20> x;
    for (Index v = 0; v < 20; ++v) x.col(v) = mesh.X.col(mesh.hexahedra(v, e));
    for (Index k = 0; k < 12; ++k) {
      const Vec3 a = x.col(ends[k][0]), b = x.col(ends[k][1]);
      EXPECT_LT((x.col(8 + k) - 0.5 * (a + b)).norm(), 0.25 * (a - b).norm());
    }
    for (const double xi : {-1.0, 0.0, 1.0})
      for (const double eta : {-1.0, 0.0, 1.0})
        for (const double zeta : {-1.0, 0.0, 1.0}) EXPECT_GT(jacobian(x, {xi, eta, zeta}), 0.0);
  }
  double on_rim = 0.0;
  for (const Index a : mesh.circle) {
    EXPECT_NEAR(mesh.X(2, a), 15.0, 1e-9);
    EXPECT_LT(mesh.X.col(a).head<2>().norm(), 5.0 + 1e-9);
    if (mesh.X.col(a).head<2>().norm() > 5.0 - 1e-9) ++on_rim;
  }
  EXPECT_GE(on_rim, 16);
  for (const Index a : mesh.base) EXPECT_NEAR(mesh.X(2, a), 0.0, 1e-9);
}

TEST(Hexahedra, FollowADomesTopAndFillMostOfIt) {
  const BodySurface dome = cut_ellipsoid_surface({46.25, 31.25, 16.7647}, -11.7353);
  const Boundary boundary = find_boundary(dome, {.base = "inferior", .indent_at = "0,0,top"});
  const GradingOptions grading{.rim = 0.1};
  const HexahedralMesh mesh =
      make_hexahedra(dome, boundary, grading, hexahedra_spacing_for_count(dome, boundary, grading, 2000));
  EXPECT_NEAR(mesh.volume_mm3, dome.volume(), 0.2 * dome.volume());
  for (const Index a : mesh.circle) EXPECT_LT(dome.closest(mesh.X.col(a)).distance, 0.1);
}

TEST(Hexahedra, ForACountEndWhereNoneCanBe) {
  const BodySurface body = block_surface(Vec3(0, 0, 0), Vec3(50, 50, 30));
  Boundary boundary = find_boundary(body, {});
  boundary.centre += 22.0 * boundary.push.unitOrthogonal();  // the circle hangs over the edge
  EXPECT_THROW(hexahedra_spacing_for_count(body, boundary, {.rim = 0.15}, 2000), ModelError);
}

}  // namespace
}  // namespace dimple
