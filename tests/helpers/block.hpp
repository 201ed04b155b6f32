#pragma once

#include <functional>
#include <random>

#include "preprocess/lumped_mass.hpp"
#include "preprocess/pressure_patches.hpp"
#include "preprocess/support.hpp"
#include "solver/internal_force.hpp"

namespace dimple::testing_bodies {

/// A block 30 x 30 x 20 mm standing on z = 0, without any image: nodes on a lattice of n cells along z, inner
/// ones moved by up to `jitter` spacings, points in the middle of cells `cells_per_spacing` times finer, base
/// below, a circle of 4 mm radius pushed down on top. Supports, gradients and masses included.
inline Model block(Index n = 6, double jitter = 0.2, double cells_per_spacing = 1.15,
                   const SupportOptions& support = {}, unsigned seed = 7) {
  const Vec3 size(30e-3, 30e-3, 20e-3);
  const double h = size.z() / static_cast<double>(n);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> noise(-jitter * h, jitter * h);
  Model model;
  std::vector<Vec3> nodes;
  const Index nx = static_cast<Index>(std::lround(size.x() / h)),
              ny = static_cast<Index>(std::lround(size.y() / h));
  for (Index k = 0; k <= n; ++k)
    for (Index j = 0; j <= ny; ++j)
      for (Index i = 0; i <= nx; ++i) {
        Vec3 x(size.x() * static_cast<double>(i) / static_cast<double>(nx),
               size.y() * static_cast<double>(j) / static_cast<double>(ny),
               size.z() * static_cast<double>(k) / static_cast<double>(n));
        if (i > 0 && i < nx) x.x() += noise(random);
        if (j > 0 && j < ny) x.y() += noise(random);
        if (k > 0 && k < n) x.z() += noise(random);
        const Index a = static_cast<Index>(nodes.size());
        if (k == 0) model.base.push_back(a);
        if (k == n && (x.head<2>() - Eigen::Vector2d(15e-3, 15e-3)).norm() < 4e-3)
          model.indenter.push_back(a);
        nodes.push_back(x);
      }
  model.X.resize(3, static_cast<Index>(nodes.size()));
  for (std::size_t a = 0; a < nodes.size(); ++a) model.X.col(static_cast<Index>(a)) = nodes[a];
  model.spacing = Eigen::VectorXd::Constant(model.X.cols(), h);

  const Eigen::Array3d cells = (size.array() / h * cells_per_spacing).round();
  const Vec3 cell = size.cwiseQuotient(cells.matrix());
  model.point.resize(3, static_cast<Index>(cells.prod()));
  Index q = 0;
  for (int k = 0; k < cells.z(); ++k)
    for (int j = 0; j < cells.y(); ++j)
      for (int i = 0; i < cells.x(); ++i)
        model.point.col(q++) = (Vec3(i, j, k).array() + 0.5).matrix().cwiseProduct(cell);
  model.volume = Eigen::VectorXd::Constant(q, cell.prod());
  model.tool = {.centre = Vec3(15e-3, 15e-3, 20e-3), .push = -Vec3::UnitZ(), .radius = 4e-3};
  model.label = Eigen::VectorXi::Zero(q);
  find_supports(model, support);
  model.mass = lumped_mass(model, Eigen::VectorXd::Constant(model.point_count(), 1000.0));
  return model;
}

/// The same block for the converging scheme: cells with a spread, gradients averaged over them, pressure
/// patches. `tissue`, if given, numbers each point by its place.
inline Model averaged_block(Index n = 6, double jitter = 0.2, double cells_per_spacing = 1.8,
                            const std::function<int(const Vec3&)>& tissue = {}) {
  Model model = block(n, jitter, cells_per_spacing);
  model.spread = Spread::Zero(6, model.point_count());
  model.spread.topRows<3>().setConstant(std::pow(model.volume[0], 2.0 / 3.0) / 12.0);
  if (tissue)
    for (Index q = 0; q < model.point_count(); ++q) model.label[q] = tissue(model.point.col(q));
  find_supports(model, {.radius_factor = 1.6, .interpolation = 0.01}, model.label);
  make_pressure_patches(model, model.label);
  return model;
}

/// Nodes on the outside of the block.
inline std::vector<bool> on_boundary(const Model& model) {
  const Vec3 lower = model.X.rowwise().minCoeff(), upper = model.X.rowwise().maxCoeff();
  std::vector<bool> result;
  for (const auto& x : model.X.colwise())
    result.push_back((x - lower).cwiseAbs().minCoeff() < 1e-9 || (upper - x).cwiseAbs().minCoeff() < 1e-9);
  return result;
}

/// Displacements for which every node has moved by (F - I) X.
inline ForceSystem::Nodal affine(const Model& model, const Mat3& F) {
  return to_nodal((F - Mat3::Identity()) * model.X);
}

inline ForceSystem::Nodal random_displacement(const Model& model, double size, unsigned seed = 3) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> noise(-size, size);
  return to_nodal(Points::NullaryExpr(3, model.node_count(), [&] { return noise(random); }));
}

}  // namespace dimple::testing_bodies
