// Closed surfaces of label images, for bodies of any shape and voxels of any size.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <random>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/surface/closed_mesh.hpp"
#include "preprocess/surface/label_surface.hpp"
#include "tests/helpers/image.hpp"
#include "tests/helpers/report.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

bool in_box(Index i, Index j, Index k, std::array<Index, 3> low, std::array<Index, 3> high) {
  return i >= low[0] && i < high[0] && j >= low[1] && j < high[1] && k >= low[2] && k < high[2];
}

LabelImage ellipsoid(Index across, const Vec3& half) {
  return image_of({across, across, across}, Vec3::Ones(), [&](Index i, Index j, Index k) {
    const Vec3 x = place_of(i, j, k).array() - 0.5 * static_cast<double>(across - 1);
    return x.cwiseQuotient(half).squaredNorm() < 1.0;
  });
}

// Expects two triangles with opposite directions along each edge, and no degenerate triangle.
void expect_closed_and_outward(const BodySurface& surface) {
  std::map<std::pair<Index, Index>, int> sides;
  for (const auto& t : surface.triangles().colwise())
    for (int c = 0; c < 3; ++c) ++sides[{t[c], t[(c + 1) % 3]}];
  for (const auto& [side, count] : sides) {
    ASSERT_NE(side.first, side.second);
    ASSERT_EQ(count, 1);
    ASSERT_EQ(sides.count({side.second, side.first}), 1u);
  }
  EXPECT_GT(surface.volume(), 0.0);
}

// Mesh of tetrahedra with corners at places 4 n ... 4 n + 3, facing outward.
TriangleMesh tetrahedra(const std::vector<Vec3>& place, const std::vector<std::array<Index, 4>>& corner) {
  TriangleMesh mesh;
  mesh.vertex.resize(3, static_cast<Index>(place.size()));
  for (std::size_t v = 0; v < place.size(); ++v) mesh.vertex.col(static_cast<Index>(v)) = place[v];
  mesh.triangles.resize(3, 4 * static_cast<Index>(corner.size()));
  Index t = 0;
  for (auto c : corner) {
    const Vec3 a = place[static_cast<std::size_t>(c[0])];
    const auto edge = [&](std::size_t n) -> Vec3 { return place[static_cast<std::size_t>(c[n])] - a; };
    if (edge(1).dot(edge(2).cross(edge(3))) < 0.0) std::swap(c[2], c[3]);
    for (const auto& [x, y, z] : {std::array{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}})
      mesh.triangles.col(t++) << c[static_cast<std::size_t>(x)], c[static_cast<std::size_t>(y)],
          c[static_cast<std::size_t>(z)];
  }
  return mesh;
}

TEST(ClosedMesh, GivesEachSheetVerticesOfItsOwnWhereTheyCoincide) {
  const Vec3 o(0, 0, 0), x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  // Contacts at a corner, at an edge, at two edges, and at a face and an edge.
  std::vector<TriangleMesh> in_contact = {
      tetrahedra({o, x, y, z, -x, -y, -z}, {{0, 1, 2, 3}, {0, 4, 5, 6}}),
      tetrahedra({o, x, y, z, -y, -z}, {{0, 1, 2, 3}, {0, 1, 4, 5}}),
      tetrahedra({o, x, y, z, -y, -z, y - 2 * z, z - 2 * y}, {{0, 1, 2, 3}, {0, 1, 4, 5}, {0, 1, 6, 2}}),
      tetrahedra({o, x, y, z, -y - z, y + x, -y - x}, {{0, 1, 2, 3}, {0, 1, 4, 6}})};
  for (TriangleMesh& mesh : in_contact) {
    const double volume = enclosed_volume(mesh);
    EXPECT_GT(volume, 0.0);
    separate_coincident_sheets(mesh);
    EXPECT_NEAR(enclosed_volume(mesh), volume, 1e-12);
    expect_closed_and_outward(BodySurface(mesh.vertex, mesh.triangles));
  }
  TriangleMesh open = in_contact.front();
  open.triangles.conservativeResize(3, open.triangles.cols() - 1);
  EXPECT_THROW(separate_coincident_sheets(open), ModelError);
}

// True if the image gives a closed surface around the voxels' volume, false if it is refused with a full
// message.
bool gives_a_surface(const LabelImage& image, const SurfaceOptions& options = {}) {
  try {
    const SegmentedBody body = make_body_surface(image, {}, options);
    expect_closed_and_outward(body.surface);
    EXPECT_NEAR(body.surface.volume() / body.report.voxel_volume_mm3, 1.0, 0.02);
    const double error = std::abs(body.surface.volume() / body.report.voxel_volume_mm3 - 1.0);
    EXPECT_TRUE(error < 1e-3 || !body.report.warnings.empty()) << error;
    return true;
  } catch (const ModelError& error) {
    EXPECT_TRUE(error.report.code == "too-thin" || error.report.fact.find("at least 64") != std::string::npos)
        << error.report.fact;
    return false;
  }
}

TEST(ClosedMesh, IsNoneWithAHoleADoubledTriangleATurnedOneOrTwoFansAtACorner) {
  const std::vector<Vec3> place = {{0, 0, 0},  {1, 0, 0},  {0, 1, 0}, {0, 0, 1},
                                   {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}};
  const TriangleMesh one = tetrahedra(place, {{0, 1, 2, 3}});
  EXPECT_TRUE(is_closed(one.triangles, 7));
  EXPECT_FALSE(is_closed(one.triangles, 3));
  EXPECT_FALSE(is_closed(one.triangles.leftCols(3), 7));
  Triangles other(3, 5);
  other << one.triangles, one.triangles.col(1);
  EXPECT_FALSE(is_closed(other, 7));
  other = one.triangles;
  std::swap(other(0, 2), other(1, 2));
  EXPECT_FALSE(is_closed(other, 7));
  EXPECT_FALSE(is_closed(tetrahedra(place, {{0, 1, 2, 3}, {0, 4, 5, 6}}).triangles, 7));
}

TEST(Surface, IsPassedByObliqueLinesWhereItsTrianglesAre) {
  const SegmentedBody body = make_body_surface(ellipsoid(30, Vec3(12, 9, 7)), {});
  const BodySurface& surface = body.surface;
  const Vec3 middle = surface.centroid();
  std::mt19937 draw(7);
  std::normal_distribution<double> normal;
  for (int k = 0; k < 200; ++k) {
    const Vec3 direction(normal(draw), normal(draw), normal(draw));
    const Vec3 origin = middle + 3.0 * Vec3(normal(draw), normal(draw), normal(draw));
    std::vector<double> expected;  // Plane by plane: inside of all three edges.
    for (Index t = 0; t < surface.triangles().cols(); ++t) {
      const auto corner = [&](int c) { return Vec3(surface.vertex().col(surface.triangles()(c % 3, t))); };
      const Vec3 n = surface.normal().col(t);
      const double at = n.dot(corner(0) - origin) / n.dot(direction);
      const Vec3 x = origin + at * direction;
      bool in = true;
      for (int c = 0; c < 3; ++c) in = in && n.dot((corner(c + 1) - corner(c)).cross(x - corner(c))) > 0.0;
      if (in) expected.push_back(at);
    }
    std::sort(expected.begin(), expected.end());
    const std::vector<double> found = surface.crossings(origin, direction);
    ASSERT_EQ(found.size(), expected.size()) << k;
    for (std::size_t c = 0; c < found.size(); ++c) EXPECT_NEAR(found[c], expected[c], 1e-9) << k;
  }
  EXPECT_TRUE(surface.crossings(middle + Vec3(0, 0, 100), Vec3(1, 0.1, 0)).empty());
}

TEST(Surface, IsNearestAtACornerInTheFirstOfTheTrianglesThatMeetThere) {
  const BodySurface block = block_surface(Vec3(0, 0, 0), Vec3(1, 2, 3));
  const BodySurface::Closest closest = block.closest(Vec3(2, 3, 4));
  EXPECT_NEAR((closest.place - Vec3(1, 2, 3)).norm(), 0.0, 1e-12);
  EXPECT_NEAR(closest.distance, std::sqrt(3.0), 1e-12);
  Index first = 0;
  while ((block.vertex()(Eigen::all, block.triangles().col(first)).colwise() - Vec3(1, 2, 3))
             .colwise()
             .norm()
             .minCoeff() > 0.0)
    ++first;
  EXPECT_EQ(closest.triangle, first);
}

TEST(Surface, HoldsItsBordersAndNothingBeyondThem) {
  const BodySurface block = block_surface(Vec3(0, 0, 0), Vec3(1, 2, 3));
  for (const Vec3& x : {Vec3(0, 0, 0), Vec3(1, 2, 3), Vec3(0.5, 0, 0), Vec3(0.5, 1, 3), Vec3(1, 1, 1)}) {
    EXPECT_TRUE(block.contains(x)) << x.transpose();
    EXPECT_FALSE(block.contains(x + 1e-6 * (x - Vec3(0.5, 1, 1.5)))) << x.transpose();
  }
  EXPECT_TRUE(block.contains(Vec3(0.5, 1, 1.5)));
}

TEST(Surface, OfAnEllipsoidIsClosedHoweverMuchCoarserThanItsVoxels) {
  const LabelImage image = ellipsoid(127, {60.0, 50.0, 41.0});
  for (const double step : {1.0, 1.3, 2.0, 2.5, 3.0, 3.7, 5.0, 7.1, 10.0, 14.3}) {
    SCOPED_TRACE(step);
    const SegmentedBody body = make_body_surface(image, {}, {.step_mm = step});
    expect_closed_and_outward(body.surface);
    EXPECT_NEAR(body.surface.volume() / body.report.voxel_volume_mm3, 1.0, 1e-3);
    EXPECT_EQ(body.report.step_mm, step);
    for (const auto& x : body.surface.vertex().colwise()) {
      const Vec3 from_middle = (body.surface.to_world() * x).array() - 63.0;
      const double r = from_middle.cwiseQuotient(Vec3(60.0, 50.0, 41.0)).norm();
      EXPECT_NEAR(r, 1.0, 0.01 + 0.005 * step);
    }
  }
}

// The image is made of runs: ever finer voxels of one body, up to 1000 across.
TEST(Surface, OfAnEllipsoidIsTheSameHoweverFineItsVoxels) {
  const Vec3 half(50.0, 43.0, 37.0);
  for (const int fineness : {1, 3, 10, 32, 100}) {
    SCOPED_TRACE(fineness);
    const double h = 10.0 / fineness;
    const auto n = static_cast<Index>(std::ceil(104.0 / h)) + 4;
    const double middle = 0.5 * static_cast<double>(n - 1);
    LabelImage image;
    image.size = {n, n, n};
    image.to_world = Eigen::Translation3d(Vec3::Constant(-h * middle)) * Eigen::Scaling(h);
    image.row_offset = {0};
    for (Index k = 0; k < n; ++k)
      for (Index j = 0; j < n; ++j) {
        const double y = h * (static_cast<double>(j) - middle) / half.y(),
                     z = h * (static_cast<double>(k) - middle) / half.z(), remaining = 1.0 - y * y - z * z;
        if (remaining > 0.0) {
          const double reach = half.x() * std::sqrt(remaining) / h;
          const auto begin = static_cast<std::int32_t>(std::ceil(middle - reach)),
                     end = static_cast<std::int32_t>(std::floor(middle + reach)) + 1;
          if (begin < end) image.run.push_back({begin, end, 1});
        }
        image.row_offset.push_back(image.run.size());
      }
    const SegmentedBody body = make_body_surface(image, {}, {.step_mm = 10.0});
    expect_closed_and_outward(body.surface);
    EXPECT_NEAR(body.surface.volume() / body.report.voxel_volume_mm3, 1.0, 1e-3);
    for (const auto& x : body.surface.vertex().colwise())
      EXPECT_NEAR((body.surface.to_world() * x).cwiseQuotient(half).norm(), 1.0, fineness == 1 ? 0.1 : 0.05);
  }
}

// The bodies are in contact with themselves, in 24 x 24 x 24 voxels.
TEST(Surface, OfAFoldedOrSelfContactingBodyIsClosed) {
  using Inside = bool (*)(Index, Index, Index);
  const std::vector<std::pair<const char*, Inside>> bodies = {
      {"a slit of one voxel",
       [](Index i, Index j, Index k) {
         return in_box(i, j, k, {3, 3, 3}, {21, 21, 21}) && !(i == 12 && k > 6);
       }},
      {"a slit of two voxels",
       [](Index i, Index j, Index k) {
         return in_box(i, j, k, {3, 3, 3}, {21, 21, 21}) && !((i == 12 || i == 11) && k > 6);
       }},
      {"two blocks at an edge",
       [](Index i, Index j, Index k) {
         return in_box(i, j, k, {2, 2, 2}, {12, 12, 22}) || in_box(i, j, k, {12, 12, 2}, {22, 22, 22}) ||
                in_box(i, j, k, {2, 2, 2}, {22, 22, 6});
       }},
      {"two blocks at a corner",
       [](Index i, Index j, Index k) {
         return in_box(i, j, k, {2, 2, 2}, {12, 12, 12}) || in_box(i, j, k, {12, 12, 12}, {22, 22, 22}) ||
                in_box(i, j, k, {2, 14, 2}, {22, 22, 10}) || in_box(i, j, k, {2, 2, 2}, {8, 20, 10}) ||
                in_box(i, j, k, {14, 14, 2}, {22, 22, 22});
       }},
      {"two lobes joined by one voxel",
       [](Index i, Index j, Index k) {
         return in_box(i, j, k, {2, 2, 2}, {11, 22, 22}) || in_box(i, j, k, {12, 2, 2}, {22, 22, 22}) ||
                (i == 11 && j == 12 && k == 12);
       }},
      {"a chessboard of rods in a frame",
       [](Index i, Index j, Index k) {
         return in_box(i, j, k, {2, 2, 2}, {22, 22, 22}) && (k < 6 || k >= 18 || ((i / 4 + j / 4) % 2 == 0));
       }},
      {"the whole image", [](Index, Index, Index) { return true; }},
      {"a hollow block",
       [](Index i, Index j, Index k) {
         return in_box(i, j, k, {2, 2, 2}, {22, 22, 22}) && !in_box(i, j, k, {6, 6, 6}, {18, 18, 18});
       }},
  };
  for (const auto& [name, inside] : bodies)
    for (const Vec3& spacing : {Vec3(1, 1, 1), Vec3(0.7, 0.7, 3.0), Vec3(1.0, 0.4, 0.9)}) {
      SCOPED_TRACE(std::string(name) + " of voxels " + std::to_string(spacing.z()));
      const LabelImage image = image_of({24, 24, 24}, spacing, inside);
      EXPECT_TRUE(gives_a_surface(image));
      for (const double step : {1.1, 1.7, 2.3, 4.0}) gives_a_surface(image, {.step_mm = step});
    }
}

TEST(Surface, OfRandomBlobsIsClosedOrRefusedInWords) {
  std::mt19937 random(20);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  int surfaces = 0;
  constexpr int bodies = 400;
  for (int n = 0; n < bodies; ++n) {
    SCOPED_TRACE(n);
    // Waves in random directions above a random level; in the last quarter each voxel is drawn separately.
    const bool noise = n >= bodies * 3 / 4;
    const double above = noise ? unit(random) : 2.0 * unit(random) - 1.0;
    std::vector<std::pair<Vec3, double>> wave;
    for (int w = 0; w < 6; ++w)
      wave.push_back({2.5 * unit(random) * Vec3(unit(random) - 0.5, unit(random) - 0.5, unit(random) - 0.5),
                      6.3 * unit(random)});
    const std::array<Index, 3> size = {8 + static_cast<Index>(12 * unit(random)),
                                       8 + static_cast<Index>(12 * unit(random)),
                                       8 + static_cast<Index>(12 * unit(random))};
    const Vec3 spacing(0.3 + 2.0 * unit(random), 0.3 + 2.0 * unit(random), 0.3 + 2.0 * unit(random));
    const LabelImage image =
        image_of(size, n % 3 == 0 ? Vec3(Vec3::Ones()) : spacing, [&](Index i, Index j, Index k) {
          if (noise) return unit(random) > above;
          double sum = 0.0;
          for (const auto& [k_vector, phase] : wave) sum += std::cos(k_vector.dot(place_of(i, j, k)) + phase);
          return sum > above || (i < 2 && j < 2 && k < 2);
        });
    const double step = n % 2 == 0 ? 0.0 : spacing.minCoeff() * (1.0 + 2.0 * unit(random));
    surfaces += gives_a_surface(image, {.step_mm = step});
  }
  EXPECT_GT(surfaces, bodies / 2);
  RecordProperty("surfaces", surfaces);
}

TEST(Surface, OfASheetOfOneVoxelIsRefusedInWords) {
  const LabelImage sheet = image_of({200, 200, 40}, Vec3::Ones(), [](Index i, Index j, Index k) {
    return in_box(i, j, k, {20, 20, 20}, {180, 180, 21});
  });
  expect_error<ModelError>([&] { make_body_surface(sheet, {}); },
                           {.why = "thinner than", .remedy = "three voxels", .code = "too-thin"});
  // Two voxels are enough for a surface at the correct place.
  const SegmentedBody two = make_body_surface(image_of({60, 60, 9}, Vec3::Ones(),
                                                       [](Index i, Index j, Index k) {
                                                         return in_box(i, j, k, {5, 5, 4}, {55, 55, 6});
                                                       }),
                                              {});
  expect_closed_and_outward(two.surface);
  EXPECT_NEAR(two.surface.closest(Vec3(30.0, 30.0, 4.5)).distance, 1.0, 0.15);
}

TEST(Surface, NamesEveryCavityWithItsVolumeAndPlace) {
  const LabelImage image = image_of({60, 60, 60}, Vec3(0.5, 0.5, 0.5), [](Index i, Index j, Index k) {
    return in_box(i, j, k, {5, 5, 5}, {55, 55, 55}) && !in_box(i, j, k, {10, 10, 10}, {30, 30, 30}) &&
           !in_box(i, j, k, {40, 40, 40}, {44, 44, 44});
  });
  const SegmentedBody body = make_body_surface(image, {});
  ASSERT_EQ(body.report.cavities.size(), 2u);
  EXPECT_NEAR(body.report.cavities[0].volume_mm3, 1000.0, 1e-9);
  EXPECT_FALSE(body.report.cavities[0].filled);
  EXPECT_LT((body.report.cavities[0].centre_mm - Vec3(9.75, 9.75, 9.75)).norm(), 1e-9);
  EXPECT_NEAR(body.report.cavities[1].volume_mm3, 8.0, 1e-9);
  EXPECT_TRUE(body.report.cavities[1].filled);
  EXPECT_NEAR(body.surface.volume(), 15625.0 - 1000.0, 15.0);
  const Eigen::Isometry3d to_local = body.surface.to_world().inverse();
  EXPECT_FALSE(body.surface.contains(to_local * Vec3(9.75, 9.75, 9.75)));
  EXPECT_TRUE(body.surface.contains(to_local * Vec3(20.75, 20.75, 20.75)));
  std::string all;
  for (const std::string& warning : body.report.warnings) all += warning + "\n";
  EXPECT_NE(all.find("1.00 cm3 at (9.8, 9.8, 9.8) mm"), std::string::npos) << all;
  EXPECT_NE(all.find("8.00 mm3 at (20.8, 20.8, 20.8) mm"), std::string::npos) << all;
}

// The readers snap header numbers. Differences below 1e-9, or a rotation, must not reach the vertices.
TEST(Surface, IsTheSameToTheLastBitForHeadersThatDifferByRounding) {
  LabelImage image = ellipsoid(40, {17.0, 14.0, 12.0});
  image.to_world = Eigen::Affine3d(Eigen::Scaling(Vec3(1.366, 0.703125, 0.9)));
  const SegmentedBody first = make_body_surface(image, {});
  std::mt19937 random(3);
  std::uniform_real_distribution<double> noise(-1e-13, 1e-13);
  for (int n = 0; n < 6; ++n) {
    LabelImage other = image;
    const Eigen::Quaterniond turn =
        n < 3 ? Eigen::Quaterniond::Identity() : Eigen::Quaterniond(0.3 + n, 0.1, -0.4, 0.7).normalized();
    other.to_world = Eigen::Translation3d(10.0 * n, -3.0, 7.0) * turn * image.to_world;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) other.to_world.linear()(r, c) += noise(random);
    const SegmentedBody again = make_body_surface(other, {});
    EXPECT_TRUE(again.surface.vertex() == first.surface.vertex());
    EXPECT_TRUE(again.surface.triangles() == first.surface.triangles());
  }
}

TEST(Surface, IsLeftWhenTheWorkIsToEnd) {
  ask_to_stop(StopReason::interrupted);
  EXPECT_THROW(make_body_surface(ellipsoid(20, {8.0, 8.0, 8.0}), {}), Stopped);
  forget_stop();
}

}  // namespace
}  // namespace dimple
