#pragma once

#include <functional>
#include <random>

#include "preprocess/make_model.hpp"
#include "solver/terms/internal_force.hpp"
#include "tests/helpers/steps.hpp"

namespace dimple::testing_bodies {

/// The surface of a box [mm]: two triangles a face, outward.
inline Surface box_surface(const Vec3& lower_mm, const Vec3& upper_mm) {
  Surface surface{Points(3, 8), Triangles(3, 12)};
  for (int v = 0; v < 8; ++v)
    surface.vertex_mm.col(v) << (v & 1 ? upper_mm : lower_mm).x(), (v & 2 ? upper_mm : lower_mm).y(),
        (v & 4 ? upper_mm : lower_mm).z();
  surface.triangles << 0, 0, 4, 4, 0, 0, 2, 2, 0, 0, 1, 1,  //
      2, 3, 5, 7, 1, 5, 7, 6, 4, 6, 3, 7,                   //
      3, 1, 7, 6, 5, 4, 3, 7, 6, 2, 7, 5;
  return surface;
}

/// A block 30 x 30 x 20 mm on z = 0, without any image. Nodes are on a lattice of n cells along z, inner ones
/// moved by up to `jitter` spacings; points are in the middle of cells `cells_per_spacing` times finer. The
/// base is below, and a bonded patch of 4 mm radius is pressed down on top.
inline Discretisation block_places(Index n, double jitter, double cells_per_spacing, unsigned seed = 7) {
  const Vec3 size(30e-3, 30e-3, 20e-3);
  const double h = size.z() / static_cast<double>(n);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> noise(-jitter * h, jitter * h);
  Discretisation places;
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
        if (k == 0) places.base.push_back(a);
        if (k == n && (x.head<2>() - Eigen::Vector2d(15e-3, 15e-3)).norm() < 4e-3)
          places.bonded_patch.push_back(a);
        nodes.push_back(x);
      }
  places.X.resize(3, static_cast<Index>(nodes.size()));
  for (std::size_t a = 0; a < nodes.size(); ++a) places.X.col(static_cast<Index>(a)) = nodes[a];
  places.spacing = Eigen::VectorXd::Constant(places.X.cols(), h);

  const Eigen::Array3d cells = (size.array() / h * cells_per_spacing).round();
  const Vec3 cell = size.cwiseQuotient(cells.matrix());
  places.point.resize(3, static_cast<Index>(cells.prod()));
  Index q = 0;
  for (int k = 0; k < cells.z(); ++k)
    for (int j = 0; j < cells.y(); ++j)
      for (int i = 0; i < cells.x(); ++i)
        places.point.col(q++) = (Vec3(i, j, k).array() + 0.5).matrix().cwiseProduct(cell);
  places.volume = Eigen::VectorXd::Constant(q, cell.prod());
  places.tool = {.centre = Vec3(15e-3, 15e-3, 20e-3), .approach = -Vec3::UnitZ(), .radius = 4e-3};
  places.label = Eigen::VectorXi::Zero(q);
  places.surface = box_surface(Vec3::Zero(), 1e3 * size);
  return places;
}

/// Model of that block as the product makes it for the paper's scheme.
inline Model block(Index n = 6, double jitter = 0.2, double cells_per_spacing = 1.15,
                   const SupportOptions& support = {}, unsigned seed = 7) {
  Scheme scheme = horton2007;
  scheme.support = support;
  Discretisation places = block_places(n, jitter, cells_per_spacing, seed);
  Eigen::VectorXi tissue = places.label;
  return make_model(std::move(places), scheme, std::move(tissue), {1000.0});
}

/// Model of that block for the converging scheme. `tissue`, if given, numbers each point by its place.
inline Model averaged_block(Index n = 6, double jitter = 0.2, double cells_per_spacing = 1.8,
                            const std::function<int(const Vec3&)>& tissue = {}) {
  Discretisation places = block_places(n, jitter, cells_per_spacing);
  places.second_moments = SecondMoments::Zero(6, places.point_count());
  places.second_moments.topRows<3>().setConstant(std::pow(places.volume[0], 2.0 / 3.0) / 12.0);
  if (tissue)
    for (Index q = 0; q < places.point_count(); ++q) places.label[q] = tissue(places.point.col(q));
  Eigen::VectorXi of_point = places.label;
  const auto tissues = static_cast<std::size_t>(of_point.maxCoeff()) + 1;
  return make_model(std::move(places), converging, std::move(of_point), std::vector<double>(tissues, 1000.0));
}

/// True for each node on the outside of the block.
inline std::vector<bool> on_boundary(const Model& model) {
  const Vec3 lower = model.X.rowwise().minCoeff(), upper = model.X.rowwise().maxCoeff();
  std::vector<bool> result;
  for (const auto& x : model.X.colwise())
    result.push_back((x - lower).cwiseAbs().minCoeff() < 1e-9 || (upper - x).cwiseAbs().minCoeff() < 1e-9);
  return result;
}

/// Displacements by which every node moves by (F - I) X.
inline ForceSystem::Nodal affine(const Model& model, const Mat3& F) {
  return to_nodal((F - Mat3::Identity()) * model.X);
}

/// Internal forces of a body without a load history [N].
inline ForceSystem::Nodal forces_at(const ForceSystem& system, const ForceSystem::Nodal& u) {
  ForceSystem::Nodal f = u;
  ForceState(system).internal_force(u, f);
  return f;
}

inline ForceSystem::Nodal random_displacement(const Model& model, double size, unsigned seed = 3) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> noise(-size, size);
  return to_nodal(Points::NullaryExpr(3, model.node_count(), [&] { return noise(random); }));
}

}  // namespace dimple::testing_bodies
