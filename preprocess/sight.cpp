#include "preprocess/sight.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>

#include "io/stop.hpp"
#include "preprocess/neighbours.hpp"

namespace dimple {
namespace {

constexpr double narrowest = 0.02;      // half of the least gap that divides, in spacings
constexpr double shallow = 0.1;         // depth of a hollow that does not, in spacings
constexpr double slope = 0.2;           // and in the length of the way across it
constexpr double facing = -0.3;         // cosine between the normals of two walls that face each other
constexpr double beyond = 1e-4;         // of the way: its ends may lie on the surface
constexpr double looked_within = 1.25;  // radii of a support: cells reach a little farther than their middles

double distance_to_surface(const SurfaceCells& surface, const Vec3& x) {
  thread_local std::vector<Index> nearest;
  return surface.nearest(x, nearest);
}

}  // namespace

bool sees(const SurfaceCells& surface, const Vec3& x, const Vec3& y, double spacing) {
  thread_local std::vector<SurfaceCells::Crossing> crossings;
  const Vec3 way = y - x, from = x - beyond * way, whole = (1.0 + 2.0 * beyond) * way;
  surface.pass(from, from + whole, crossings);
  const double length = whole.norm();
  for (std::size_t k = 0; k < crossings.size(); ++k) {
    const SurfaceCells::Crossing& in = crossings[k];
    if (in.leave || k == 0 || !crossings[k - 1].leave) continue;
    const SurfaceCells::Crossing& out = crossings[k - 1];
    const double outside = (in.t - out.t) * length;
    if (outside < 2.0 * narrowest * spacing) continue;
    const double depth = distance_to_surface(surface, from + 0.5 * (out.t + in.t) * whole);
    if (surface.normal().col(out.triangle).dot(surface.normal().col(in.triangle)) < facing) {
      if (depth > narrowest * spacing) return false;
    } else if (depth > std::max(shallow * spacing, slope * outside)) {
      return false;
    }
  }
  return true;
}

bool sees_all_within(const SurfaceCells& surface, const Vec3& x, double radius, double spacing) {
  return !surface.any_above(x, radius, narrowest * spacing);
}

// In the body's own axes and to a tenth of a nanometre: what is seen does not hang on how the image is turned.
Vec3 Sight::own(const Vec3& x) const {
  return ((model_.axes.transpose() * (x - model_.tool.centre)).array() * 1e10).round() * 1e-7;
}

Sight::Sight(const Discretisation& model, const Eigen::VectorXd& radius)
    : model_(model),
      X_(3, model.node_count()),
      clear_radius_(looked_within * radius),
      depth_(Eigen::VectorXd::Zero(model.node_count())) {
  for (Index a = 0; a < model.node_count(); ++a) X_.col(a) = own(model.X.col(a));
  Points vertex(3, model.surface.vertex_mm.cols());
  for (Index v = 0; v < vertex.cols(); ++v) vertex.col(v) = own(1e-3 * model.surface.vertex_mm.col(v));
  surface_.emplace(vertex, model.surface.triangles);
  tbb::parallel_for(Index{0}, model.node_count(), [&](Index a) {
    if (a % 16 == 0) stop_if_asked();
    if (sees_all_within(*surface_, X_.col(a), 1e3 * clear_radius_[a], 1e3 * model.spacing[a])) return;
    clear_radius_[a] = 0.0;
    depth_[a] = 1e-3 * distance_to_surface(*surface_, X_.col(a));
  });
  all_clear_ = clear_radius_.minCoeff() > 0.0;
  if (all_clear_) return;
  point_.resize(3, model.point_count());
  point_depth_.resize(model.point_count());
  point_spacing_.resize(model.point_count());
  const Neighbours nodes(model.X);
  tbb::parallel_for(Index{0}, model.point_count(), [&](Index q) {
    if (q % 64 == 0) stop_if_asked();
    point_.col(q) = own(model.point.col(q));
    point_depth_[q] = 1e-3 * distance_to_surface(*surface_, point_.col(q));
    point_spacing_[q] = model.spacing[nodes.nearest(model.point.col(q), 1).front()];
  });
}

bool Sight::point_sees(Index point, const Vec3& x) const {
  const Vec3 there = own(x);
  return (there - point_.col(point)).norm() <= 1e3 * point_depth_[point] ||
         dimple::sees(*surface_, point_.col(point), there, 1e3 * point_spacing_[point]);
}

bool Sight::sees(Index node, Index point) const {
  const double away = 1e-3 * (point_.col(point) - X_.col(node)).norm();
  // Around each of the two a ball lies in the tissue: if both together reach, there is no need to look.
  if (away <= std::max(clear_radius_[node], depth_[node] + point_depth_[point])) return true;
  return dimple::sees(*surface_, X_.col(node), point_.col(point), 1e3 * model_.spacing[node]);
}

}  // namespace dimple
