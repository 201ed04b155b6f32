#include "preprocess/output/section.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

namespace dimple {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// A box of 60 x 40 x 30 mm on z = 0, with nodes at its corners, pressed at the middle of its top; rotated.
Discretisation box(const Eigen::Isometry3d& turned = Eigen::Isometry3d::Identity()) {
  Discretisation body;
  Points corner(3, 8);
  for (Index c = 0; c < 8; ++c)
    corner.col(c) = Vec3(c & 1 ? 60.0 : 0.0, c & 2 ? 40.0 : 0.0, c & 4 ? 30.0 : 0.0);
  body.surface.vertex_mm = turned * corner.colwise().homogeneous();
  body.surface.triangles.resize(3, 12);
  body.surface.triangles << 0, 0, 4, 4, 0, 0, 2, 2, 0, 0, 1, 1,  //
      2, 3, 5, 7, 1, 5, 6, 7, 4, 6, 3, 7,                        //
      3, 1, 7, 6, 5, 4, 7, 3, 6, 2, 7, 5;
  body.X = 1e-3 * body.surface.vertex_mm;
  body.tool = {.centre = 1e-3 * (turned * Vec3(30, 20, 30)),
               .approach = turned.linear() * Vec3(0, 0, -1),
               .radius = 5e-3};
  return body;
}

double area_seen_from(const Vec3& front, const Section& section) {
  double area = 0.0;
  for (const auto& t : section.triangles.colwise()) {
    const Vec3 a = section.place.col(t[0]), b = section.place.col(t[1]), c = section.place.col(t[2]);
    area += 0.5 * (b - a).cross(c - a).dot(front);
  }
  return area;
}

TEST(Section, FillsTheBodysLongestPlaneThroughTheTool) {
  const Eigen::Isometry3d turned(Eigen::Translation3d(5, -90, 40) *
                                 Eigen::AngleAxisd(0.7, Vec3(1, 2, -1).normalized()));
  for (const Eigen::Isometry3d& pose : {Eigen::Isometry3d::Identity(), turned}) {
    const Section section = cut_open(box(pose));
    EXPECT_NEAR(std::abs(section.front.dot(pose.linear() * Vec3::UnitY())), 1.0, 1e-9);
    const Points at = pose.inverse() * section.place.colwise().homogeneous();
    EXPECT_LT((at.row(1).array() - 20.0).abs().maxCoeff(), 1e-9) << "in the plane";
    EXPECT_NEAR(area_seen_from(section.front, section), 60.0 * 30.0, 1.0) << "but for the corners";
    EXPECT_NEAR(at.row(2).maxCoeff(), 30.0, 1e-9) << "outline on the surface";
    EXPECT_LT(section.triangles.cols(), 20000);
  }
}

TEST(Section, HasNothingToFillWhereThereIsNoSurface) {
  Discretisation body = box();
  body.surface = {};
  EXPECT_EQ(cut_open(body).triangles.cols(), 0);
}

TEST(PointMeans, LeaveOutWhatIsNoNumberAndSayWhereNothingIsLeft) {
  Points point(3, 20);
  for (Index q = 0; q < 20; ++q) point.col(q) = Vec3(static_cast<double>(q), 0.0, 0.0);
  const Points places = (Points(3, 2) << 0.2, 18.7, 0, 0, 0, 0).finished();
  const PointMeans means = make_point_means(point, places);
  Eigen::RowVectorXd values = Eigen::RowVectorXd::Constant(20, 3.0);
  EXPECT_NEAR(means(values)[0], 3.0, 1e-12);
  values[0] = nan;
  EXPECT_NEAR(means(values)[0], 3.0, 1e-12);
  values.head(10).setConstant(nan);
  EXPECT_TRUE(std::isnan(means(values)[0]));
  EXPECT_NEAR(means(values)[1], 3.0, 1e-12);
}

}  // namespace
}  // namespace dimple
