#include "preprocess/surface/body_surface.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <optional>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/surface/closed_mesh.hpp"
#include "preprocess/surface/exact_side.hpp"
#include "preprocess/surface/sight.hpp"
#include "preprocess/surface/surface_cells.hpp"

namespace dimple {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;

Kernel::Point_3 to_cgal(const Vec3& x) {
  return {x.x(), x.y(), x.z()};
}
Vec3 from_cgal(const Kernel::Point_3& x) {
  return {x.x(), x.y(), x.z()};
}

}  // namespace

// SurfaceCells answers where rounding leaves no doubt, CGAL elsewhere: its tree is built only when needed.
struct BodySurface::Tree {
  std::once_flag requested;
  std::optional<ExactSide> exact;
  std::optional<SurfaceCells> cells;

  bool contains(const BodySurface& surface, const Vec3& x) {
    std::call_once(requested, [&] { exact.emplace(surface.vertex(), surface.triangles()); });
    return exact->contains(x);
  }
};

namespace {

Kernel::Triangle_3 triangle_of(const BodySurface& surface, Index t) {
  const auto corner = [&](int c) { return to_cgal(surface.vertex().col(surface.triangles()(c, t))); };
  return {corner(0), corner(1), corner(2)};
}

// Places of `hits` on the line as multiples of direction; false if one of them is not clear.
bool pass(const BodySurface& surface, const Vec3& origin, const Vec3& direction,
          const std::vector<SurfaceCells::Hit>& hits, std::vector<double>& t) {
  const Kernel::Line_3 line(to_cgal(origin), Kernel::Vector_3(direction.x(), direction.y(), direction.z()));
  for (const auto& hit : hits) {
    const auto met = CGAL::intersection(line, triangle_of(surface, hit.triangle));
    const auto* place = met ? boost::get<Kernel::Point_3>(&*met) : nullptr;
    if (!place) return false;
    t.push_back((from_cgal(*place) - origin).dot(direction) / direction.squaredNorm());
  }
  std::sort(t.begin(), t.end());
  return true;
}

}  // namespace

BodySurface::BodySurface(Points vertex, Triangles triangles, const Eigen::Isometry3d& to_world)
    : vertex_(std::move(vertex)),
      triangles_(std::move(triangles)),
      to_world_(to_world),
      tree_(std::make_unique<Tree>()) {
  if (triangles_.cols() < 4 || !is_closed(triangles_, vertex_.cols()))
    throw ModelError({.fact = fmt::format("the surface of {} triangles is not closed", triangles_.cols()),
                      .where = "body surface",
                      .why = "it has a border, or more than two triangles meet at an edge",
                      .remedy = "give a watertight surface; for an image, please report this error"});

  normal_.resize(3, triangles_.cols());
  triangle_area_.resize(triangles_.cols());
  const Vec3 middle = vertex_.rowwise().mean();  // keeps the tetrahedra's volumes well scaled
  for (Index t = 0; t < triangles_.cols(); ++t) {
    const Vec3 a = vertex_.col(triangles_(0, t)) - middle, b = vertex_.col(triangles_(1, t)) - middle,
               c = vertex_.col(triangles_(2, t)) - middle;
    const Vec3 n = (b - a).cross(c - a);
    triangle_area_[t] = 0.5 * n.norm();
    normal_.col(t) = triangle_area_[t] > 0.0 ? Vec3(n.normalized()) : Vec3(Vec3::Zero());
    const double tetrahedron = a.dot(b.cross(c)) / 6.0;
    volume_ += tetrahedron;
    centroid_ += tetrahedron * (a + b + c) / 4.0;
  }
  centroid_ = middle + centroid_ / volume_;
  lower_ = vertex_.rowwise().minCoeff();
  upper_ = vertex_.rowwise().maxCoeff();

  stop_if_requested();
  tree_->cells.emplace(vertex_, triangles_);
  tree_->cells->mark_clear_cells([&](const Vec3& x) { return tree_->contains(*this, x); });
}

BodySurface::~BodySurface() = default;

bool BodySurface::at_image_end(const Vec3& x) const {
  return std::any_of(image_end_.begin(), image_end_.end(), [&](const ImageEnd& end) {
    return std::abs(x.dot(end.out) - end.offset) <= end.tolerance;
  });
}
BodySurface::BodySurface(BodySurface&&) noexcept = default;

bool BodySurface::contains(const Vec3& x) const {
  const std::optional<bool> answer = tree_->cells->contains(x);
  return answer ? *answer : tree_->contains(*this, x);
}

BodySurface::Closest BodySurface::closest(const Vec3& x) const {
  thread_local std::vector<Index> candidates;
  tree_->cells->nearest(x, candidates);
  // Several are equally near at an edge or a corner; the first of those is chosen.
  std::sort(candidates.begin(), candidates.end());
  Closest result{Vec3::Zero(), -1, std::numeric_limits<double>::infinity()};
  for (const Index t : candidates) {
    const Vec3 p =
        from_cgal(Kernel().construct_projected_point_3_object()(triangle_of(*this, t), to_cgal(x)));
    if (const double distance = (p - x).norm(); distance < result.distance) result = {p, t, distance};
  }
  return result;
}

bool BodySurface::farther(const Vec3& x, double distance) const {
  const std::optional<bool> answer = tree_->cells->farther(x, distance);
  return answer ? *answer : closest(x).distance > distance;
}

bool BodySurface::sees(const Vec3& x, const Vec3& y, double spacing) const {
  return dimple::sees(*tree_->cells, x, y, spacing);
}

bool BodySurface::is_between(const Vec3& x, const Vec3& y) const {
  thread_local std::vector<SurfaceCells::Crossing> crossings;
  tree_->cells->pass(x, y, crossings);
  return !crossings.empty();
}

std::vector<double> BodySurface::chord(const Vec3& origin, int axis, double length) const {
  std::vector<double> t;
  thread_local std::vector<SurfaceCells::Hit> hits;
  const double slack = 1e-9 * (upper() - lower()).norm(), from = origin[axis], to = from + length;
  bool clean = tree_->cells->line(origin, axis, from - slack, to + slack, hits);
  for (const auto& hit : hits)
    clean = clean && std::abs(hit.at - from) > slack && std::abs(hit.at - to) > slack;
  if (clean) {
    const bool begins_inside = contains(origin);
    if (begins_inside) t.push_back(0.0);
    if (pass(*this, origin, Vec3::Unit(axis), hits, t)) {
      if (t.size() % 2 == 1) t.push_back(length);
      return t;
    }
  }
  t.clear();
  const std::vector<double> whole = crossings(origin, Vec3::Unit(axis));
  for (std::size_t pair = 0; pair + 1 < whole.size(); pair += 2) {
    const double enter = std::max(whole[pair], 0.0), leave = std::min(whole[pair + 1], length);
    if (enter < leave) t.insert(t.end(), {enter, leave});
  }
  return t;
}

// The part of a line, in multiples of its direction, in a box a little larger than the body's.
std::optional<std::pair<double, double>> BodySurface::part_in_box(const Vec3& origin,
                                                                  const Vec3& direction) const {
  const double margin = 1e-3 * (upper() - lower()).norm();
  double from = -std::numeric_limits<double>::infinity(), to = -from;
  for (int d = 0; d < 3; ++d) {
    const double low = lower()[d] - margin - origin[d], high = upper()[d] + margin - origin[d];
    if (direction[d] == 0.0) {
      if (low > 0.0 || high < 0.0) return std::nullopt;
      continue;
    }
    from = std::max(from, std::min(low / direction[d], high / direction[d]));
    to = std::min(to, std::max(low / direction[d], high / direction[d]));
  }
  if (!(from < to)) return std::nullopt;
  return std::pair(from, to);
}

std::vector<double> BodySurface::crossings(const Vec3& origin, const Vec3& direction) const {
  const double size = (upper() - lower()).norm();
  // Lines through an edge or a corner meet several triangles at one place, or graze them. They are moved
  // sideways by a billionth of the body's size, and the query is repeated.
  const Vec3 sideways = direction.unitOrthogonal();
  const Vec3 other = direction.normalized().cross(sideways);
  Index axis = 0;
  if (direction.cwiseAbs().maxCoeff(&axis) == 1.0 && direction.squaredNorm() == 1.0) {
    thread_local std::vector<SurfaceCells::Hit> hits;
    std::vector<double> t;
    const int along = static_cast<int>(axis);
    if (tree_->cells->line(origin, along, lower()[along] - size, upper()[along] + size, hits) &&
        pass(*this, origin, direction, hits, t) && t.size() % 2 == 0)
      return t;
  }
  thread_local std::vector<SurfaceCells::Crossing> crossings;
  for (int attempt = 0; attempt < 8; ++attempt) {
    const double step = 1e-9 * size * attempt;
    const Vec3 o = origin + step * (0.61803 * sideways + 0.27393 * other);
    std::vector<double> t;
    bool clean = true;
    if (const auto part = part_in_box(o, direction)) {
      tree_->cells->pass(o + part->first * direction, o + part->second * direction, crossings);
      const double length = part->second - part->first;
      for (const auto& crossing : crossings) t.push_back(part->first + crossing.t * length);
    }
    for (std::size_t k = 1; k < t.size(); ++k)
      clean = clean && t[k] - t[k - 1] > 1e-12 * size / direction.norm();
    if (clean && t.size() % 2 == 0) return t;
  }
  return {};
}

}  // namespace dimple
