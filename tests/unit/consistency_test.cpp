// Gradients that satisfy the divergence theorem, as the product's models have them.

#include "preprocess/consistency.hpp"

#include <gtest/gtest.h>

#include "tests/helpers/block.hpp"

namespace dimple {
namespace {

// The block's surface: two triangles a face, outward.
SurfacePieces block_pieces(const Model& model) {
  const Vec3 lower = model.X.rowwise().minCoeff(), upper = model.X.rowwise().maxCoeff();
  Points vertex(3, 8);
  for (int v = 0; v < 8; ++v)
    vertex.col(v) << (v & 1 ? upper : lower).x(), (v & 2 ? upper : lower).y(), (v & 4 ? upper : lower).z();
  Triangles triangles(3, 12);
  triangles << 0, 0, 4, 4, 0, 0, 2, 2, 0, 0, 1, 1,  //
      2, 3, 5, 7, 1, 5, 7, 6, 4, 6, 3, 7,           //
      3, 1, 7, 6, 5, 4, 3, 7, 6, 2, 7, 5;
  return pieces_of(vertex, triangles, model);
}

TEST(SurfacePieces, CoverAClosedSurface) {
  const Model model = testing_bodies::averaged_block();
  const SurfacePieces pieces = block_pieces(model);
  EXPECT_NEAR(pieces.area.colwise().norm().sum(), 2 * (9e-4 + 6e-4 + 6e-4), 1e-12);
  EXPECT_LT(pieces.area.rowwise().sum().norm(), 1e-15);
  EXPECT_NEAR((pieces.area.array() * pieces.place.array()).sum() / 3.0, 1.8e-5, 1e-12);  // the volume
}

TEST(Consistency, MakesTheDivergenceTheoremHoldForEveryShapeFunction) {
  Model model = testing_bodies::averaged_block();
  const SupportOptions options{.radius_factor = 1.6, .interpolation = 0.01};
  const Points wanted = surface_integrals(model, options, block_pieces(model));
  EXPECT_LT(wanted.rowwise().sum().norm(), 1e-12);  // shape functions sum to 1
  const ConsistencyReport report = make_consistent(model, wanted);
  EXPECT_GT(report.before, 1e-3);
  EXPECT_LT(report.after, 1e-6);
  EXPECT_LT(report.iterations, 200);

  Points residual = -wanted;
  for (Index q = 0; q < model.point_count(); ++q)
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
      residual.col(model.support.member[k]) += model.volume[q] * model.dphi.col(k);
  EXPECT_LT(residual.cwiseAbs().maxCoeff(), 1e-6 * wanted.cwiseAbs().maxCoeff());
}

TEST(Consistency, KeepsTheGradientsOfConstantsAndLinearFields) {
  Model model = testing_bodies::averaged_block();
  const SupportOptions options{.radius_factor = 1.6, .interpolation = 0.01};
  make_consistent(model, surface_integrals(model, options, block_pieces(model)));
  for (Index q = 0; q < model.point_count(); ++q) {
    Mat3 of_position = Mat3::Zero();
    Vec3 of_one = Vec3::Zero();
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k) {
      of_position +=
          (model.X.col(model.support.member[k]) - model.point.col(q)) * model.dphi.col(k).transpose();
      of_one += model.dphi.col(k);
    }
    ASSERT_LT((of_position - Mat3::Identity()).cwiseAbs().maxCoeff(), 1e-9);
    ASSERT_LT(of_one.norm() * 20e-3, 1e-9);
  }
}

}  // namespace
}  // namespace dimple
