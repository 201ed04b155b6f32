// Displacements on an image's voxels, forward and backward, on a block with prescribed nodal displacements.

#include "preprocess/output/deformation_map.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <random>

#include "tests/helpers/block.hpp"

namespace dimple {
namespace {

using namespace testing_bodies;

/// Displacements like those under a tool of 6 mm radius, 6 mm deep: down and apart under it, zero at the
/// bottom [m].
Points pressed(const Points& X) {
  Points u(3, X.cols());
  for (Index a = 0; a < X.cols(); ++a) {
    const Vec3 x = 1e3 * X.col(a) - Vec3(15, 15, 0);
    const double height = x.z() / 20.0, under = std::exp(-x.head<2>().squaredNorm() / 50.0);
    u.col(a) = 1e-3 * Vec3(0.12 * x.x() * height * under, 0.12 * x.y() * height * under,
                           -6.0 * height * height * under);
  }
  return u;
}

/// Grid of such voxels around the block, with rotated, mirrored or sheared axes.
VoxelGrid grid_with(const Mat3& axes, const Vec3& spacing) {
  VoxelGrid grid;
  grid.to_world.linear() = axes * spacing.asDiagonal();
  const Vec3 size = (54.0 / spacing.array()).round();
  for (std::size_t a = 0; a < 3; ++a) grid.size[a] = static_cast<Index>(size[static_cast<Index>(a)]);
  grid.to_world.translation() =
      Vec3(15, 15, 10) - grid.to_world.linear() * (0.5 * (size.array() - 1.0)).matrix();
  return grid;
}

std::vector<std::pair<const char*, VoxelGrid>> grids() {
  const Mat3 oblique = (Eigen::AngleAxisd(0.4, Vec3(1, 2, 3).normalized())).toRotationMatrix();
  const Mat3 ras = Vec3(-1, -1, 1).asDiagonal();
  const Mat3 left_handed = Vec3(-1, 1, 1).asDiagonal();
  Mat3 swapped;
  swapped << 0, 0, 1, 1, 0, 0, 0, -1, 0;
  Mat3 sheared = Mat3::Identity();
  sheared(0, 1) = 0.2;
  return {{"LPS", grid_with(Mat3::Identity(), {2, 2, 2})},
          {"RAS", grid_with(ras, {2, 2, 2})},
          {"oblique", grid_with(oblique, {1.5, 2, 2.5})},
          {"left-handed", grid_with(left_handed, {2, 1.7, 2})},
          {"axes swapped", grid_with(swapped, {2, 1.5, 2})},
          {"sheared", grid_with(sheared, {2, 2, 2})},
          {"thick slices", grid_with(Mat3::Identity(), {1, 1, 6})}};
}

class Deformed : public testing::Test {
 protected:
  const Model model = averaged_block(8);
  const Points u = pressed(model.X);
  const FieldAnywhere field{model};

  Points displacement_at(const Points& places_mm) const {
    Points result(3, places_mm.cols()), value;
    for (Index k = 0; k < places_mm.cols(); ++k) {
      field.at(1e-3 * places_mm.col(k), u, value);
      result.col(k) = 1e3 * value;
    }
    return result;
  }
  bool in_block(const Vec3& mm, double by = 0.0) const {
    return (mm.array() > by).all() && ((Vec3(30, 30, 20) - mm).array() > by).all();
  }
  struct InverseMap {
    std::vector<float> place;
    InverseMapReport report;
  };
  InverseMap inverse_map(const DeformationMap& map, const VoxelGrid& grid) const {
    InverseMap result;
    result.place.resize(static_cast<std::size_t>(3 * grid.voxels()));
    result.report = map.reference_places(0, grid.size[2], result.place);
    return result;
  }
  Vec3 voxel(const VoxelGrid& grid, Index v) const {
    return {static_cast<double>(v % grid.size[0]), static_cast<double>(v / grid.size[0] % grid.size[1]),
            static_cast<double>(v / grid.slice())};
  }
  Vec3 place(const InverseMap& back, Index v) const {
    const float* x = back.place.data() + 3 * v;
    return {x[0], x[1], x[2]};
  }
};

TEST_F(Deformed, FieldAnywhereIsTheInterpolationOfMovingLeastSquares) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> draw(0.0, 1.0);
  Points places(3, 400);
  for (auto x : places.colwise()) x = 1e-3 * Vec3(30 * draw(random), 30 * draw(random), 20 * draw(random));
  const Points expected = make_interpolation(model, model.scheme.support, places)(u);
  Points value;
  for (Index first = 0; first < places.cols(); first += 5) {
    field.at(places.middleCols(first, 5), u, value);
    EXPECT_LT((value - expected.middleCols(first, 5)).cwiseAbs().maxCoeff(), 1e-15);
  }
}

TEST_F(Deformed, FieldAnywhereKnowsItsDerivative) {
  const Vec3 x(12.3e-3, 16.1e-3, 17.2e-3);
  Points value, before, after;
  Eigen::Matrix<double, 9, Eigen::Dynamic> derivative;
  field.at(x, u, value, &derivative);
  const double h = 1e-7;
  for (int j = 0; j < 3; ++j) {
    field.at(x - h * Vec3::Unit(j), u, before);
    field.at(x + h * Vec3::Unit(j), u, after);
    const Vec3 expected = (after - before).col(0) / (2.0 * h);
    EXPECT_LT((derivative.col(0).reshaped(3, 3).col(j) - expected).norm(), 1e-6) << j;
  }
}

TEST_F(Deformed, ForthAndBackEveryVoxelOfTheBodyIsWhereItWas) {
  for (const auto& [name, grid] : grids()) {
    SCOPED_TRACE(name);
    const DeformationMap map(model, field, u, grid);
    const InverseMap back = inverse_map(map, grid);
    const Eigen::Affine3d to_voxels = grid.to_world.inverse();
    double worst = 0.0;
    Index inside = 0;
    for (Index v = 0; v < grid.voxels(); ++v) {
      const Vec3 undeformed_mm = grid.to_world * place(back, v);
      if (!in_block(undeformed_mm, 0.01)) continue;
      ++inside;
      const Vec3 there = to_voxels * Vec3(undeformed_mm + displacement_at(undeformed_mm));
      worst = std::max(worst, (there - voxel(grid, v)).cwiseAbs().maxCoeff());
    }
    EXPECT_GT(inside, 1000);
    EXPECT_LT(worst, 0.1);
    RecordProperty(std::string("forth_and_back_") + name, std::to_string(worst));
    EXPECT_EQ(back.report.folded, 0);
    EXPECT_LE(100 * back.report.unsettled, back.report.solved);
  }
}

TEST_F(Deformed, AroundTheBodyTheFieldContinuesSmoothlyAndEndsAtZero) {
  const VoxelGrid grid = grid_with(Mat3::Identity(), {1, 1, 1});
  const DeformationMap map(model, field, u, grid);
  const auto slice = static_cast<std::size_t>(grid.slice());
  std::vector<float> forth(3 * static_cast<std::size_t>(grid.voxels())), jacobian(slice);
  for (Index k = 0; k < grid.size[2]; ++k) {
    map.displacement(k, std::span(forth).subspan(3 * slice * static_cast<std::size_t>(k), 3 * slice),
                     jacobian);
    for (Index v = 0; v < grid.slice(); ++v) {
      const Vec3 x = grid.to_world * voxel(grid, v + k * grid.slice());
      if (!in_block(x, -1e-9)) {
        EXPECT_EQ(jacobian[static_cast<std::size_t>(v)], 0.0f) << x.transpose();
      }
      if (in_block(x, 1e-9)) {
        EXPECT_GT(jacobian[static_cast<std::size_t>(v)], 0.1f) << x.transpose();
      }
    }
  }
  double largest = 0.0, steepest = 0.0;
  for (Index v = 0; v < grid.voxels(); ++v) {
    const Vec3 at(forth[static_cast<std::size_t>(3 * v)], forth[static_cast<std::size_t>(3 * v + 1)],
                  forth[static_cast<std::size_t>(3 * v + 2)]);
    const Vec3 x = grid.to_world * voxel(grid, v);
    largest = std::max(largest, at.norm());
    if (in_block(x, -1.5) || v % grid.size[0] + 1 == grid.size[0]) continue;
    const auto next = static_cast<std::size_t>(3 * v + 3);
    steepest = std::max(steepest, (Vec3(forth[next], forth[next + 1], forth[next + 2]) - at).norm());
  }
  EXPECT_LT(largest, 6.01);   // nowhere farther than in the body
  EXPECT_LT(steepest, 0.75);  // mm per mm: nothing is torn, nothing turned inside out

  VoxelGrid wide = grid;  // 3 x 6 mm around the block, and more
  wide.size = {110, 110, 110};
  wide.to_world.translation() = Vec3(-40, -40, -45);
  const DeformationMap far(model, field, u, wide);
  std::vector<float> slice_of(static_cast<std::size_t>(3 * wide.slice()));
  far.displacement(90, slice_of, {});  // z = 45 mm, 25 mm above the block
  EXPECT_TRUE(std::all_of(slice_of.begin(), slice_of.end(), [](float x) { return x == 0.0f; }));
}

// Between a voxel inside and one outside, an image interpolates the displacement of the surface.
TEST_F(Deformed, OnTheSurfaceItIsTheFieldThere) {
  const VoxelGrid grid = grid_with(Mat3::Identity(), {2, 2, 2});
  const DeformationMap map(model, field, u, grid);
  const auto slice = static_cast<std::size_t>(grid.slice());
  std::vector<float> forth(3 * static_cast<std::size_t>(grid.voxels()));
  for (Index k = 0; k < grid.size[2]; ++k)
    map.displacement(k, std::span(forth).subspan(3 * slice * static_cast<std::size_t>(k), 3 * slice), {});
  double sum = 0.0, worst = 0.0;
  int places = 0;
  for (double x = 4.5; x < 26.0; x += 1.3)
    for (double y = 4.5; y < 26.0; y += 1.3) {
      const Vec3 top(x, y, 20.0), at = grid.to_world.inverse() * top;
      const Eigen::Vector3i low = at.array().floor().cast<int>();
      const Vec3 part = at - low.cast<double>();
      Vec3 between = Vec3::Zero();
      for (int c = 0; c < 8; ++c) {
        const Eigen::Array3i side(c & 1, c >> 1 & 1, c >> 2 & 1);
        const Vec3 w = (side == 1).select(part.array(), 1.0 - part.array());
        const float* v =
            forth.data() +
            3 * (low[0] + side[0] + grid.size[0] * (low[1] + side[1] + grid.size[1] * (low[2] + side[2])));
        between += w.prod() * Vec3(v[0], v[1], v[2]);
      }
      const double off = (between - displacement_at(top)).norm();
      sum += off;
      ++places;
      worst = std::max(worst, off);
    }
  EXPECT_LT(sum / places, 0.08) << "mm, where it goes by 6 mm at most";
  EXPECT_LT(worst, 0.6);
}

TEST_F(Deformed, ALatticeCoarserThanTheVoxelsFindsTheSamePlaces) {
  // Voxels of 0.2 mm: more around the block than the lattice may have points.
  VoxelGrid fine = grid_with(Mat3::Identity(), {0.2, 0.2, 0.2});
  const DeformationMap map(model, field, u, fine);
  std::vector<float> place(static_cast<std::size_t>(3 * fine.slice()));
  const Index k = fine.size[2] / 2 + 10;
  const InverseMapReport report = map.reference_places(k, k + 1, place);
  EXPECT_GT(report.solved, 10000);
  EXPECT_LE(200 * report.unsettled, report.solved);
  double worst = 0.0;
  for (Index v = 0; v < fine.slice(); v += 7) {
    const float* X = place.data() + 3 * v;
    const Vec3 undeformed_mm = fine.to_world * Vec3(X[0], X[1], X[2]);
    if (!in_block(undeformed_mm, 0.01)) continue;
    const Vec3 x = voxel(fine, v + k * fine.slice());
    worst = std::max(
        worst, (fine.to_world.inverse() * Vec3(undeformed_mm + displacement_at(undeformed_mm)) - x).norm());
  }
  EXPECT_LT(worst, 0.1);
}

TEST_F(Deformed, IsTheSameForAnyNumberOfThreads) {
  const VoxelGrid grid = grids()[2].second;
  const auto all = [&] {
    const DeformationMap map(model, field, u, grid);
    std::vector<float> result = inverse_map(map, grid).place;
    std::vector<float> slice(static_cast<std::size_t>(3 * grid.slice())),
        J(static_cast<std::size_t>(grid.slice()));
    map.displacement(grid.size[2] / 2, slice, J);
    result.insert(result.end(), slice.begin(), slice.end());
    result.insert(result.end(), J.begin(), J.end());
    return result;
  };
  const std::vector<float> one = [&] {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    return all();
  }();
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 3);
  EXPECT_EQ(one, all());
}

TEST_F(Deformed, AnImageElsewhereAndABodyAtRestStayAsTheyAre) {
  VoxelGrid grid = grids()[0].second;
  const Points nothing = Points::Zero(3, model.node_count());
  VoxelGrid elsewhere = grid;
  elsewhere.to_world.translation() += Vec3(500, 0, 0);
  for (const auto& [where, field_of] : {std::pair{grid, &nothing}, std::pair{elsewhere, &u}}) {
    const DeformationMap map(model, field, *field_of, where);
    const InverseMap back = inverse_map(map, where);
    for (Index v = 0; v < where.voxels(); ++v) ASSERT_EQ(place(back, v), voxel(where, v));
  }
}

}  // namespace
}  // namespace dimple
