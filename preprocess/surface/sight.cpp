#include "preprocess/surface/sight.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <optional>

#include "io/stop.hpp"
#include "preprocess/nodes/neighbours.hpp"

namespace dimple {
namespace {

constexpr double narrowest = 0.02;      // half of the least gap that hides, in spacings
constexpr double shallow = 0.1;         // largest depth of a hollow that does not, in spacings
constexpr double slope = 0.2;           // and as a fraction of the length across it
constexpr double facing = -0.3;         // cosine between the normals of two walls that face each other
constexpr double beyond = 1e-4;         // of the segment: its ends may be on the surface
constexpr double looked_within = 1.25;  // radii of a support: cells extend a little beyond their middles

double distance_to_surface(const SurfaceCells& surface, const Vec3& x) {
  thread_local std::vector<Index> nearest;
  return surface.nearest(x, nearest);
}

// Is x farther from the surface than `depth`? The search ends at the first triangle that is surely nearer.
bool is_deeper(const SurfaceCells& surface, const Vec3& x, double depth) {
  if (const std::optional<bool> answer = surface.farther(x, depth)) return *answer;
  return distance_to_surface(surface, x) > depth;
}

// Outward normal of the wall that a segment crosses; at an end without a crossing, of the nearest wall.
Vec3 outer_normal(const SurfaceCells& surface, const Vec3& x, std::optional<Index> triangle,
                  const Vec3& segment) {
  if (triangle) return surface.normal().col(*triangle);
  thread_local std::vector<Index> nearest;
  surface.nearest(x, nearest);
  return surface.normal().col(*std::max_element(nearest.begin(), nearest.end(), [&](Index s, Index t) {
    return surface.normal().col(s).dot(segment) < surface.normal().col(t).dot(segment);
  }));
}

}  // namespace

bool sees(const SurfaceCells& surface, const Vec3& x, const Vec3& y, double spacing) {
  thread_local std::vector<SurfaceCells::Crossing> crossings;
  const Vec3 segment = y - x, from = x - beyond * segment, whole = (1.0 + 2.0 * beyond) * segment;
  surface.pass(from, from + whole, crossings);
  const double length = whole.norm();
  const auto at = [&](double t) { return Vec3(from + t * whole); };
  const auto divided = [&](double out, std::optional<Index> left, double in, std::optional<Index> entered) {
    if ((in - out) * length < 2.0 * narrowest * spacing) return false;
    const double cosine =
        outer_normal(surface, at(out), left, segment).dot(outer_normal(surface, at(in), entered, -segment));
    const double deepest =
        cosine < facing ? narrowest * spacing : std::max(shallow * spacing, slope * (in - out) * length);
    return is_deeper(surface, at(0.5 * (out + in)), deepest);
  };
  // An end on an edge of the body can leave it with no crossing: it then leaves at the start of the segment.
  double out = 0.0;
  std::optional<Index> left;
  for (const SurfaceCells::Crossing& crossing : crossings) {
    if (crossing.leave) {
      out = crossing.t;
      left = crossing.triangle;
    } else if (divided(out, left, crossing.t, crossing.triangle)) {
      return false;
    }
  }
  const bool ends_outside = !crossings.empty() && crossings.back().leave;
  return !(ends_outside && divided(out, left, 1.0, std::nullopt));
}

bool sees_all_within(const SurfaceCells& surface, const Vec3& x, double radius, double spacing) {
  return !surface.any_above(x, radius, narrowest * spacing);
}

// Places in the body's own axes, to a tenth of a nanometre: visibility is independent of how the image is
// turned.
Points Sight::own(const Points& x) const {
  return ((axes_.transpose() * (x.colwise() - centre_)).array() * 1e10).round() * 1e-7;
}

Sight::Sight(const Discretisation& model, const Eigen::VectorXd& radius)
    : axes_(model.axes),
      centre_(model.tool.centre),
      spacing_(model.spacing),
      surface_(std::in_place, own(1e-3 * model.surface.vertex_mm), model.surface.triangles),
      X_(own(model.X)),
      clear_radius_(looked_within * radius),
      depth_(Eigen::VectorXd::Zero(model.node_count())) {
  tbb::parallel_for(Index{0}, model.node_count(), [&](Index a) {
    if (a % 16 == 0) stop_if_requested();
    if (sees_all_within(*surface_, X_.col(a), 1e3 * clear_radius_[a], 1e3 * spacing_[a])) return;
    clear_radius_[a] = 0.0;
    depth_[a] = 1e-3 * distance_to_surface(*surface_, X_.col(a));
  });
  if (all_clear()) return;
  point_ = own(model.point);
  point_depth_.resize(model.point_count());
  point_spacing_.resize(model.point_count());
  const Neighbours nodes(model.X);
  tbb::parallel_for(Index{0}, model.point_count(), [&](Index q) {
    if (q % 64 == 0) stop_if_requested();
    point_depth_[q] = 1e-3 * distance_to_surface(*surface_, point_.col(q));
    point_spacing_[q] = spacing_[nodes.nearest(model.point.col(q), 1).front()];
  });
}

Sight::Sight(std::shared_ptr<const Sight> before, std::shared_ptr<const Sheet> sheet,
             const Discretisation& cut, const Eigen::VectorXd& radius, std::vector<Index> whole)
    : of_surface_(before),
      whole_(std::move(whole)),
      X_(cut.X),
      point_(cut.point),
      clear_radius_(looked_within * radius) {
  Index nodes = before ? before->X_.cols() : cut.node_count();
  if (before && !before->sheets_.empty()) {
    sheets_ = before->sheets_;
    of_surface_ = before->of_surface_;
    for (Index& q : whole_) q = before->whole_[static_cast<std::size_t>(q)];
  }
  sheets_.push_back(std::move(sheet));
  tbb::parallel_for(Index{0}, cut.node_count(), [&](Index a) {
    const bool was_clear = !before || (a < nodes && before->sees_all(a));
    if (!was_clear || sheets_.back()->reaches(X_.col(a), clear_radius_[a])) clear_radius_[a] = 0.0;
  });
}

bool Sight::through_sheets(const Vec3& x, const Vec3& y) const {
  return std::any_of(sheets_.begin(), sheets_.end(), [&](const auto& sheet) { return sheet->between(x, y); });
}

bool Sight::point_sees(Index point, const Vec3& x) const {
  if (!sheets_.empty())
    return !through_sheets(point_.col(point), x) &&
           (!of_surface_ || of_surface_->point_sees(whole_[static_cast<std::size_t>(point)], x));
  const Vec3 there = own(x);
  return (there - point_.col(point)).norm() <= 1e3 * point_depth_[point] ||
         dimple::sees(*surface_, point_.col(point), there, 1e3 * point_spacing_[point]);
}

bool Sight::sees(Index node, Index point) const {
  if (!sheets_.empty()) {
    const Vec3 x = X_.col(node), y = point_.col(point);
    if ((y - x).norm() > clear_radius_[node] && through_sheets(x, y)) return false;
    const Index whole = whole_[static_cast<std::size_t>(point)];
    return !of_surface_ || (node < of_surface_->X_.cols() ? of_surface_->sees(node, whole)
                                                          : of_surface_->point_sees(whole, x));
  }
  const double away = 1e-3 * (point_.col(point) - X_.col(node)).norm();
  // Balls around both ends are in the tissue: if together they cover the segment, no search is necessary.
  if (away <= std::max(clear_radius_[node], depth_[node] + point_depth_[point])) return true;
  return dimple::sees(*surface_, X_.col(node), point_.col(point), 1e3 * spacing_[node]);
}

}  // namespace dimple
