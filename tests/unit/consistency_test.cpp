// Gradients that satisfy the divergence theorem, as in the product's models.

#include "preprocess/supports/consistency.hpp"

#include <gtest/gtest.h>

#include "preprocess/supports/support.hpp"
#include "tests/helpers/block.hpp"

namespace dimple {
namespace {

// The product's block with its gradients before they are made consistent.
Model inconsistent_block() {
  Model model = testing_bodies::averaged_block();
  find_supports(model);
  return model;
}

Points requested_by(const Model& model) {
  return surface_integrals(model, model.scheme.support, pieces_of(model));
}

TEST(SurfacePieces, CoverAClosedSurface) {
  const Model model = testing_bodies::averaged_block();
  const SurfacePieces pieces = pieces_of(model);
  EXPECT_NEAR(pieces.area.colwise().norm().sum(), 2 * (9e-4 + 6e-4 + 6e-4), 1e-12);
  EXPECT_LT(pieces.area.rowwise().sum().norm(), 1e-15);
  EXPECT_NEAR((pieces.area.array() * pieces.place.array()).sum() / 3.0, 1.8e-5, 1e-12);  // the volume
}

TEST(Consistency, MakesTheDivergenceTheoremHoldForEveryShapeFunction) {
  Model model = inconsistent_block();
  const Points requested = requested_by(model);
  EXPECT_LT(requested.rowwise().sum().norm(), 1e-12);  // shape functions sum to 1
  make_consistent(model, requested);
  const ConsistencyReport& report = model.consistency_report;
  EXPECT_GT(report.before, 1e-3);
  EXPECT_LT(report.after, 1e-6);
  EXPECT_LT(report.iterations, 200);

  Points residual = -requested;
  for (Index q = 0; q < model.point_count(); ++q)
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
      residual.col(model.support.member[k]) += model.volume[q] * model.dphi.col(k);
  EXPECT_LT(residual.cwiseAbs().maxCoeff(), 1e-6 * requested.cwiseAbs().maxCoeff());
}

}  // namespace
}  // namespace dimple
