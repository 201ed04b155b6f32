// Stability of the pressures. The volume constraints of a nearly incompressible body are no more than its
// nodes can satisfy, and every pressure acts on some node.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>

#include "preprocess/build_model.hpp"
#include "preprocess/image/phantom.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

Eigen::VectorXi places_of_free_nodes(const Model& model) {
  Eigen::VectorXi place = Eigen::VectorXi::Zero(model.node_count());
  for (const auto* held : {&model.base, &model.bonded_patch})
    for (const Index a : *held) place[a] = -1;
  int next = 0;
  for (int& p : place)
    if (p == 0) p = next++;
  return place;
}

// Smallest constant b with
//
//     sup over u of  (p, div u) / |grad u|  >=  b |p|     for every pressure p = sum_b psi_b p_b
//
// for a model's nodes and patches with its supports: the numerical inf-sup test of Chapelle and Bathe, The
// inf-sup test, Computers & Structures 47, 1993. b^2 is the smallest eigenvalue of B K^-1 B^T p = b^2 M p. K
// is |grad u|^2 of one component, including the variance within cells.
double inf_sup(const Model& model) {
  const Eigen::VectorXi place = places_of_free_nodes(model);
  const Index free = place.maxCoeff() + 1, patches = model.patches.count();
  Eigen::MatrixXd K = Eigen::MatrixXd::Zero(free, free), M = Eigen::MatrixXd::Zero(patches, patches);
  std::array<Eigen::MatrixXd, 3> B;
  for (Eigen::MatrixXd& of : B) of = Eigen::MatrixXd::Zero(patches, free);
  const auto add = [&](Index a, Index b, double k) {
    if (place[a] >= 0 && place[b] >= 0) K(place[a], place[b]) += k;
  };
  for (Index q = 0; q < model.point_count(); ++q) {
    const auto [first, last] = std::pair{model.support.offset[q], model.support.offset[q + 1]};
    const auto [from, to] = std::pair{model.patches.of_point.offset[q], model.patches.of_point.offset[q + 1]};
    for (int s = first; s < last; ++s)
      for (int t = first; t < last; ++t)
        add(model.support.member[s], model.support.member[t],
            model.volume[q] * model.dphi.col(s).dot(model.dphi.col(t)));
    for (int i = from; i < to; ++i) {
      const double part = model.volume[q] * model.patches.psi[i];
      for (int j = from; j < to; ++j)
        M(model.patches.of_point.member[i], model.patches.of_point.member[j]) += part * model.patches.psi[j];
      for (int s = first; s < last; ++s) {
        const int a = place[model.support.member[s]];
        for (int c = 0; a >= 0 && c < 3; ++c)
          B[static_cast<std::size_t>(c)](model.patches.of_point.member[i], a) += part * model.dphi(c, s);
      }
    }
  }
  for (const GradientVariance& of : model.variance)
    for (Index a = 0; a < of.rows.rows(); ++a)
      for (int s = of.rows.offset[a]; s < of.rows.offset[a + 1]; ++s) add(a, of.rows.member[s], of.K[s]);
  const Eigen::LLT<Eigen::MatrixXd> factor(K);
  EXPECT_EQ(factor.info(), Eigen::Success);
  Eigen::MatrixXd S = Eigen::MatrixXd::Zero(patches, patches);
  for (const Eigen::MatrixXd& of : B) S += of * factor.solve(of.transpose());
  const Eigen::GeneralizedSelfAdjointEigenSolver<Eigen::MatrixXd> found(S, M, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(found.eigenvalues()[0], 0.0));
}

ModelOptions with_nodes(Index count) {
  ModelOptions options;
  options.node_set.count = count;
  return options;
}

// The whole body is tested, held at its base and under the patch. One patch per node would give 0.004 to
// 0.05.
TEST(PressurePatches, LeaveNoPressureWithoutAForceOnTheNodesHoweverFineTheseAre) {
  const LabelImage brain = make_phantom({.spacing_mm = 1.5});
  for (const Index nodes : {300, 1000}) {
    EXPECT_GT(inf_sup(build_model(block_surface({-30, -30, 0}, {30, 30, 30}), with_nodes(nodes)).model),
              0.25);
    EXPECT_GT(inf_sup(build_model(brain, {}, with_nodes(nodes)).model), 0.25);
  }
}

}  // namespace
}  // namespace dimple
