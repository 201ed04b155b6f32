#include "io/draw/picture.hpp"

#include <gtest/gtest.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPNGReader.h>
#include <vtkSmartPointer.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <numbers>

#include "io/draw/before_after.hpp"
#include "io/draw/zero_pieces.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "tests/helpers/folder.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

vtkSmartPointer<vtkImageData> picture_in(const fs::path& file) {
  vtkNew<vtkPNGReader> reader;
  reader->SetFileName(file.c_str());
  reader->Update();
  return reader->GetOutput();
}

/// Number of pixels with the hue of the bonded patch, in a rectangle counted from the top left.
int orange_pixels(vtkImageData& image, int left, int top, int right, int bottom) {
  int count = 0;
  for (int y = top; y < bottom; ++y)
    for (int x = left; x < right; ++x) {
      const auto* rgb = static_cast<unsigned char*>(image.GetScalarPointer(x, 1199 - y, 0));
      if (rgb[0] > 150 && rgb[1] > 50 && rgb[1] < rgb[0] * 2 / 3 && rgb[2] < rgb[0] / 3) ++count;
    }
  return count;
}

/// Count and extent of the pixels with the hue of the tool.
struct Pixels {
  int count = 0, left = 1600, right = 0, top = 1200, bottom = 0;
};
Pixels tool_pixels(vtkImageData& image, int left, int top, int right, int bottom) {
  Pixels found;
  for (int y = top; y < bottom; ++y)
    for (int x = left; x < right; ++x) {
      const auto* rgb = static_cast<unsigned char*>(image.GetScalarPointer(x, 1199 - y, 0));
      if (!(rgb[1] > rgb[0] + 25 && rgb[2] > rgb[0] + 30 && std::abs(rgb[1] - rgb[2]) < 30)) continue;
      ++found.count;
      found.left = std::min(found.left, x), found.right = std::max(found.right, x);
      found.top = std::min(found.top, y), found.bottom = std::max(found.bottom, y);
    }
  return found;
}

/// Half an ellipsoid of 40 x 30 x 15 mm, pressed 3 mm from above.
Overview half_ellipsoid() {
  Overview o;
  o.title = "half_ellipsoid.nrrd: 0.05 N at 3 mm";
  o.lines = {"a few nodes", "a density of 1000 kg/m\xC2\xB3"};
  const Vec3 half(20.0, 15.0, 15.0);
  const auto inside = [&](const Vec3& p) { return p.cwiseQuotient(half).norm() <= 1.0; };
  const auto dent = [](const Vec3& p) {
    return Vec3(0.0, 0.0, -3.0 * p.z() / 15.0 * std::exp(-p.head<2>().squaredNorm() / 30.0));
  };
  std::vector<Vec3> nodes, points;
  for (double x = -20.0; x <= 20.0; x += 2.5)
    for (double y = -15.0; y <= 15.0; y += 2.5)
      for (double z = 0.0; z <= 15.0; z += 2.5) {
        const Vec3 p(x, y, z), q = p.array() + 1.25;
        if (inside(q)) points.push_back(q);
        if (!inside(p)) continue;
        nodes.push_back(p);
        o.node_flags.push_back((z == 0.0 ? 1 : 0) | (z > 12.0 && p.head<2>().norm() < 4.0 ? 2 : 0));
      }
  const auto pack = [](const std::vector<Vec3>& from) {
    Points to(3, static_cast<Index>(from.size()));
    for (Index n = 0; n < to.cols(); ++n) to.col(n) = from[static_cast<std::size_t>(n)];
    return to;
  };
  o.nodes_mm = pack(nodes);
  o.points_mm = pack(points);

  constexpr Index around = 48, up = 12;
  o.surface_mm.resize(3, around * (up + 1));
  o.surface_triangles.resize(3, 2 * around * up);
  for (Index j = 0; j <= up; ++j)
    for (Index i = 0; i < around; ++i) {
      const double u = 2.0 * std::numbers::pi * static_cast<double>(i) / around;
      const double v = 0.5 * std::numbers::pi * static_cast<double>(j) / up;
      o.surface_mm.col(i + around * j) =
          Vec3(std::cos(u) * std::cos(v), std::sin(u) * std::cos(v), std::sin(v)).cwiseProduct(half);
    }
  for (Index j = 0; j < up; ++j)
    for (Index i = 0; i < around; ++i) {
      const Index a = i + around * j, b = (i + 1) % around + around * j;
      o.surface_triangles.col(2 * a) << a, b, b + around;
      o.surface_triangles.col(2 * a + 1) << a, b + around, a + around;
    }
  const auto dented = [&](const Points& undeformed) {
    Points u(3, undeformed.cols());
    for (Index n = 0; n < undeformed.cols(); ++n) u.col(n) = dent(undeformed.col(n));
    return u;
  };
  o.displacement_mm = dented(o.nodes_mm);
  o.surface_displacement_mm = dented(o.surface_mm);
  o.centre_mm = Vec3(0.0, 0.0, 15.0);
  o.approach = Vec3(0.0, 0.0, -1.0);
  o.radius_mm = 4.0;
  constexpr Index sides = 32;  // of the tool: 8 mm tall, its foot on the skin
  o.tool_mm.resize(3, 2 * sides + 2);
  o.tool_triangles.resize(3, 4 * sides);
  for (Index k = 0; k < sides; ++k) {
    const double angle = 2.0 * std::numbers::pi * static_cast<double>(k) / sides;
    const Index next = (k + 1) % sides, foot = 2 * sides;
    for (const Index ring : {0, 1})
      o.tool_mm.col(k + ring * sides) =
          Vec3(4.0 * std::cos(angle), 4.0 * std::sin(angle), 15.0 + 8.0 * static_cast<double>(ring));
    o.tool_triangles.col(4 * k) << k, next, next + sides;
    o.tool_triangles.col(4 * k + 1) << k, next + sides, k + sides;
    o.tool_triangles.col(4 * k + 2) << foot, next, k;
    o.tool_triangles.col(4 * k + 3) << foot + 1, k + sides, next + sides;
  }
  o.tool_mm.rightCols(2) << 0, 0, 0, 0, 15, 23;
  for (int i = 0; i <= 30; ++i) {
    o.depth_mm.push_back(0.1 * i);
    o.force_N.push_back(0.05 * i / 30.0);
  }
  return o;
}

/// Draws `overview` and reads it; expects a picture of the right size that is not empty.
void expect_drawn(const Overview& overview) {
  const fs::path file = fresh_folder() / "overview.png";
  ASSERT_NO_THROW(write_overview(file, overview));
  const auto image = picture_in(file);
  EXPECT_EQ(image->GetDimensions()[0], 1600);
  EXPECT_EQ(image->GetDimensions()[1], 1200);
  EXPECT_LT(image->GetScalarRange()[0], 100.0);
}

TEST(Overview, OfASceneOfStepsSaysTheLargestForceAndTheLast) {
  Overview o;
  o.depth_mm = {0.0, 1.5, 1.5};
  o.time_s = {0.0, 1.5, 9.0};
  o.lateral_N = {0.0, 0.001, 0.0};
  o.force_N = {0.0, 0.0452, 0.0};
  EXPECT_EQ(end_of_curve(o), "45.2 mN largest, 0 N at the end");
  o.force_N.back() = 0.02;
  EXPECT_EQ(end_of_curve(o), "45.2 mN largest, 20.0 mN at the end");
}

TEST(Overview, SaysTheForceAtTheEndAsTheTerminalDoes) {
  Overview o;
  o.depth_mm = {4.0, 8.0};
  o.force_N = {0.03, 0.0754};
  EXPECT_EQ(end_of_curve(o), "75.4 mN at 8.00 mm");
  o.half_N = {0.001, 0.00605};
  EXPECT_EQ(end_of_curve(o), "75.4 mN at 8.00 mm, +- 8.02 %");
  o.force_N.back() = 0.5434;
  EXPECT_EQ(end_of_curve(o), "0.543 N at 8.00 mm, +- 1.11 %");
  o.image_half_N = 0.005434;
  EXPECT_EQ(end_of_curve(o), "0.543 N at 8.00 mm, +- 1.11 %, voxels +- 1.00 %");
  o.half_N.clear();
  EXPECT_EQ(end_of_curve(o), "0.543 N at 8.00 mm, voxels +- 1.00 %");
}

TEST(Overview, IsAPngOf1600By1200PixelsDrawnWithoutADisplay) {
  ::unsetenv("DISPLAY");
  expect_drawn(half_ellipsoid());
}

TEST(Overview, ShowsThePatchInEveryPanel) {
  const fs::path file = fresh_folder() / "overview.png";
  write_overview(file, half_ellipsoid());
  const auto image = picture_in(file);
  // Below the legends: nodes on top, nodes under the foot, the tool on them, the last point of the curve.
  EXPECT_GT(orange_pixels(*image, 20, 140, 790, 540), 200);
  EXPECT_GT(orange_pixels(*image, 820, 140, 1580, 540), 200);
  EXPECT_GT(tool_pixels(*image, 20, 690, 690, 1060).count, 500);
  EXPECT_GT(orange_pixels(*image, 820, 680, 1580, 1060), 40);
}

TEST(Overview, ShowsTheToolAsASolidOnTheTissueAndNamesItInTheLegend) {
  const fs::path folder = fresh_folder();
  const Overview with = half_ellipsoid();
  Overview without = with;
  without.tool_mm.resize(3, 0);
  without.tool_triangles.resize(3, 0);
  write_overview(folder / "with.png", with);
  write_overview(folder / "without.png", without);
  const auto a = picture_in(folder / "with.png"), b = picture_in(folder / "without.png");
  const auto body = [](vtkImageData& image) { return tool_pixels(image, 20, 690, 690, 1060); };
  const auto legend = [](vtkImageData& image) { return tool_pixels(image, 20, 630, 690, 680); };
  EXPECT_EQ(body(*b).count, 0);
  EXPECT_EQ(legend(*b).count, 0);
  EXPECT_GT(legend(*a).count, 100);
  const Pixels tool = body(*a);
  const double box = (tool.right - tool.left) * (tool.bottom - tool.top);
  EXPECT_GT(tool.count, 0.7 * box) << "filled, and no lines";
  // There is no white between the foot's lower edge and the tissue.
  for (int y = tool.bottom; y < tool.bottom + 12; ++y) {
    const auto* rgb =
        static_cast<unsigned char*>(a->GetScalarPointer((tool.left + tool.right) / 2, 1199 - y, 0));
    EXPECT_LT(rgb[2], 250) << y;
  }
}

TEST(Overview, ShowsTheToolWhereLoadsHaveCarriedIt) {
  const fs::path folder = fresh_folder();
  Overview o = half_ellipsoid();
  const auto left_ends = [&] {
    write_overview(folder / "overview.png", o);
    const auto image = picture_in(folder / "overview.png");
    // In the section only the tool's head is above the body, whose nodes are blue, too.
    return std::pair(tool_pixels(*image, 20, 690, 690, 1060).left,
                     tool_pixels(*image, 820, 174, 1400, 215).left);
  };
  const auto [body, section] = left_ends();
  o.carried_mm = Vec3(9.0, 0.0, 0.0);  // the picture's broad side is along x
  o.axis_mm = o.centre_mm + o.carried_mm;
  const auto [body_then, section_then] = left_ends();
  EXPECT_GT(std::abs(body_then - body), 50);
  EXPECT_GT(std::abs(section_then - section), 50);
}

TEST(Overview, ShowsWhatIsNearTheToolWhereItWouldBeTinyInTheWholeSection) {
  const fs::path folder = fresh_folder();
  Overview wide = half_ellipsoid();
  const auto section = [&](const Overview& overview) {
    write_overview(folder / "overview.png", overview);
    return tool_pixels(*picture_in(folder / "overview.png"), 820, 170, 1400, 540);
  };
  const Pixels whole = section(wide);
  EXPECT_GT(whole.right - whole.left, 60);
  // The scene is the tool above on a body ten times as large.
  for (Points* points : {&wide.nodes_mm, &wide.points_mm, &wide.surface_mm}) *points *= 10.0;
  wide.centre_mm *= 10.0;
  wide.tool_mm.row(2).array() += 135.0;
  const Pixels near = section(wide);
  EXPECT_GT(near.right - near.left, 90);
  EXPECT_LT(near.right - near.left, 140);
}

TEST(Overview, IsTheSameFileForTheSameInput) {
  const fs::path folder = fresh_folder();
  write_overview(folder / "a.png", half_ellipsoid());
  write_overview(folder / "b.png", half_ellipsoid());
  EXPECT_EQ(read_file(folder / "a.png"), read_file(folder / "b.png"));
}

TEST(Overview, IsTheSameFileDrawnByTwoThreads) {
  const fs::path folder = fresh_folder();
  Overview overview = half_ellipsoid();
  write_overview(folder / "one.png", overview);
  overview.two_threads = true;
  write_overview(folder / "two.png", overview);
  EXPECT_TRUE(read_file(folder / "one.png") == read_file(folder / "two.png"));
}

TEST(Overview, LooksAlongTheApproachHoweverTheBodyLies) {
  // A rotation of body and press direction moves only the orientation letters: a few pixels in a thousand.
  const fs::path folder = fresh_folder();
  const Overview straight = half_ellipsoid();
  Overview turned = straight;
  const Mat3 turn = Eigen::AngleAxisd(0.7, Vec3(1.0, 2.0, -0.5).normalized()).toRotationMatrix();
  for (Points* points : {&turned.nodes_mm, &turned.displacement_mm, &turned.points_mm, &turned.surface_mm,
                         &turned.surface_displacement_mm, &turned.tool_mm})
    *points = turn * *points;
  turned.centre_mm = turn * turned.centre_mm;
  turned.approach = turn * turned.approach;
  write_overview(folder / "straight.png", straight);
  write_overview(folder / "turned.png", turned);
  const auto a = picture_in(folder / "straight.png"), b = picture_in(folder / "turned.png");
  int different = 0;
  for (int y = 0; y < 1200; ++y)
    for (int x = 0; x < 1600; ++x) {
      const auto* p = static_cast<unsigned char*>(a->GetScalarPointer(x, y, 0));
      const auto* q = static_cast<unsigned char*>(b->GetScalarPointer(x, y, 0));
      if (std::abs(p[0] - q[0]) + std::abs(p[1] - q[1]) + std::abs(p[2] - q[2]) > 60) ++different;
    }
  EXPECT_LT(different, 1600 * 1200 / 200);
}

TEST(Overview, DrawsNothingAtAll) {
  Overview nothing;
  nothing.centre_mm = nothing.approach = Vec3::Zero();
  expect_drawn(nothing);
}

TEST(Overview, DrawsASingleNode) {
  Overview one;
  one.nodes_mm = Vec3(1.0, 2.0, 3.0);
  one.displacement_mm = Vec3(0.0, 0.0, -1.0);
  one.node_flags = {3};
  one.centre_mm = Vec3(1.0, 2.0, 3.0);
  one.approach = -Vec3::UnitZ();
  one.radius_mm = 5.0;
  one.depth_mm = {1.0};
  one.force_N = {0.0};
  expect_drawn(one);
}

TEST(Overview, DrawsTheNodesWhereThereIsNoSurfaceAndNoCurve) {
  Overview bare = half_ellipsoid();
  bare.surface_triangles.resize(3, 0);
  bare.points_mm.resize(3, 0);
  bare.depth_mm.clear();
  expect_drawn(bare);
}

TEST(Overview, DrawsABodyWithoutDisplacementOrNodeSets) {
  Overview still = half_ellipsoid();
  still.displacement_mm.resize(3, 0);
  still.surface_displacement_mm.resize(3, 0);
  still.node_flags.clear();
  expect_drawn(still);
}

TEST(Overview, DrawsNodesInOnePlane) {
  Overview flat = half_ellipsoid();
  flat.nodes_mm.row(2).setZero();
  expect_drawn(flat);
}

TEST(Overview, DrawsNodesInOnePlace) {
  Overview point = half_ellipsoid();
  point.nodes_mm.setZero();
  point.surface_mm.setZero();
  expect_drawn(point);
}

TEST(Overview, DrawsAForceThatPulls) {
  Overview pulled = half_ellipsoid();
  for (double& force : pulled.force_N) force = -force;
  expect_drawn(pulled);
}

TEST(Overview, DrawsATinyForceThatFalls) {
  Overview relaxing = half_ellipsoid();
  relaxing.force_N = {0.0, 3e-7, 1e-7};
  expect_drawn(relaxing);
}

TEST(Overview, SurvivesFieldsThatAreNotFinite) {
  Overview broken = half_ellipsoid();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  broken.nodes_mm(1, 5) = broken.surface_mm(0, 7) = broken.points_mm(2, 2) = nan;
  broken.displacement_mm(0, 9) = broken.surface_displacement_mm(2, 11) = nan;
  broken.surface_displacement_mm(2, 100) = std::numeric_limits<double>::infinity();
  broken.displacement_mm.col(20) = Vec3(1e12, -1e12, 1e12);
  broken.force_N[4] = nan;
  broken.depth_mm[6] = 1e300;
  expect_drawn(broken);
}

TEST(Overview, SurvivesAPatchThatIsNotFinite) {
  Overview broken = half_ellipsoid();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  broken.centre_mm.setConstant(nan);
  broken.approach.setConstant(nan);
  broken.radius_mm = nan;
  expect_drawn(broken);
}

TEST(Overview, SurvivesAnyText) {
  Overview o = half_ellipsoid();
  o.title = std::string(3000, 'W') + "\xFF\xFE $x^2$ \n\t \xE2\x82";
  o.lines = {std::string(2000, 'x'), "", "   ", "\xC2", "\xE8\x84\xB3.nrrd", "caf\xC3\xA9 - \xCE\xBB"};
  for (int i = 0; i < 60; ++i) o.lines.push_back("line " + std::to_string(i));
  expect_drawn(o);
}

TEST(Overview, RefusesTrianglesOfPointsThatDoNotExist) {
  Overview o = half_ellipsoid();
  o.surface_triangles(1, 3) = o.surface_mm.cols();
  EXPECT_THROW(write_overview(fresh_folder() / "overview.png", o), std::invalid_argument);
}

TEST(Overview, SurvivesAToolThatIsNotFinite) {
  Overview broken = half_ellipsoid();
  broken.tool_mm(1, 3) = std::numeric_limits<double>::quiet_NaN();
  expect_drawn(broken);
}

TEST(Overview, GivesAnOutputErrorWhereItCannotWrite) {
  EXPECT_THROW(write_overview(fresh_folder() / "absent" / "overview.png", half_ellipsoid()), OutputError);
}

TEST(ZeroPieces, OfACircleLieOnItAndAreAsLongAsItAndLeaveOutWhatIsNoNumber) {
  const Eigen::Vector2d middle(5.2, 3.9);
  const auto length_of = [&](const auto& value) {
    double length = 0.0;
    for (const auto& [a, b] : zero_pieces(10.0, 8.0, 0.1, value)) {
      for (const Eigen::Vector2d& end : {a, b}) EXPECT_NEAR((end - middle).norm(), 3.0, 2e-3);
      length += (b - a).norm();
    }
    return length;
  };
  const double around = 2.0 * std::numbers::pi * 3.0;
  const auto from = [&](const Eigen::Vector2d& p) { return (p - middle).norm() - 3.0; };
  EXPECT_NEAR(length_of(from), around, 0.005 * around);
  EXPECT_NEAR(length_of([&](const Eigen::Vector2d& p) {
                return p.x() > middle.x() ? std::numeric_limits<double>::quiet_NaN() : from(p);
              }),
              0.5 * around, 0.03 * around);
  EXPECT_EQ(length_of([](const Eigen::Vector2d&) { return 1.0; }), 0.0);
}

BeforeAfter one_plane() {
  BeforeAfter picture{.title = "a plane", .wall = "skull"};
  picture.plane.push_back({.name = "axial",
                           .letters = {"R", "L", "A", "P"},
                           .width_mm = 30.0,
                           .height_mm = 20.0,
                           .columns = 3,
                           .rows = 2,
                           .before = std::vector<std::uint8_t>(18, 90),
                           .after = std::vector<std::uint8_t>(18, 90)});
  return picture;
}

TEST(BeforeAfter, IsTheSamePictureForTheSamePlanesAndAnotherForAnotherPixelOrOutline) {
  const std::string was = before_after_png(one_plane());
  EXPECT_EQ(before_after_png(one_plane()), was);
  BeforeAfter other = one_plane();
  other.plane[0].after[17] = 91;
  EXPECT_NE(before_after_png(other), was);
  other = one_plane();
  other.plane[0].moved = {{Eigen::Vector2d(1.0, 1.0), Eigen::Vector2d(5.0, 1.0)}};
  EXPECT_NE(before_after_png(other), was);
}

TEST(BeforeAfter, RefusesAPlaneWithoutAsManyNumbersAsItHasPlaces) {
  BeforeAfter picture = one_plane();
  picture.plane[0].after.pop_back();
  EXPECT_THROW(before_after_png(picture), std::invalid_argument);
  picture = one_plane();
  picture.plane[0].width_mm = 0.0;
  EXPECT_THROW(before_after_png(picture), std::invalid_argument);
}

}  // namespace
}  // namespace dimple
