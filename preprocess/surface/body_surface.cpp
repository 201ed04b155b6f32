#include "preprocess/surface/body_surface.hpp"

#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Side_of_triangle_mesh.h>
#include <CGAL/Surface_mesh.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/side_by_side.hpp"
#include "preprocess/surface/sight.hpp"
#include "preprocess/surface/surface_cells.hpp"

namespace dimple {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Primitive = CGAL::AABB_face_graph_triangle_primitive<Mesh>;
using AabbTree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

Kernel::Point_3 to_cgal(const Vec3& x) {
  return {x.x(), x.y(), x.z()};
}
Vec3 from_cgal(const Kernel::Point_3& x) {
  return {x.x(), x.y(), x.z()};
}

}  // namespace

// CGAL answers; the cells only say which triangle there is to ask about, or that nothing needs to be asked.
struct BodySurface::Tree {
  Mesh mesh;
  AabbTree aabb;
  std::unique_ptr<CGAL::Side_of_triangle_mesh<Mesh, Kernel>> side;
  std::vector<Kernel::Triangle_3> triangle;
  std::optional<SurfaceCells> cells;

  bool contains(const Vec3& x) const { return (*side)(to_cgal(x)) != CGAL::ON_UNBOUNDED_SIDE; }

  // Where the line passes `hits`, as multiples of direction; false if it does not pass them at clear places.
  bool pass(const Vec3& origin, const Vec3& direction, const std::vector<SurfaceCells::Hit>& hits,
            std::vector<double>& t) const {
    const Kernel::Line_3 line(to_cgal(origin), Kernel::Vector_3(direction.x(), direction.y(), direction.z()));
    for (const auto& hit : hits) {
      const auto met = CGAL::intersection(line, triangle[static_cast<std::size_t>(hit.triangle)]);
      const auto* place = met ? boost::get<Kernel::Point_3>(&*met) : nullptr;
      if (!place) return false;
      t.push_back((from_cgal(*place) - origin).dot(direction) / direction.squaredNorm());
    }
    std::sort(t.begin(), t.end());
    return true;
  }
};

BodySurface::BodySurface(Points vertex, Triangles triangles, const Eigen::Isometry3d& to_world)
    : vertex_(std::move(vertex)),
      triangles_(std::move(triangles)),
      to_world_(to_world),
      tree_(std::make_unique<Tree>()) {
  Mesh& mesh = tree_->mesh;
  std::vector<Mesh::Vertex_index> corner;
  for (Index v = 0; v < vertex_.cols(); ++v) corner.push_back(mesh.add_vertex(to_cgal(vertex_.col(v))));
  bool closed = triangles_.cols() >= 4;
  for (Index t = 0; t < triangles_.cols() && closed; ++t) {
    if (t % 65536 == 0) stop_if_asked();
    const auto face = mesh.add_face(corner[static_cast<std::size_t>(triangles_(0, t))],
                                    corner[static_cast<std::size_t>(triangles_(1, t))],
                                    corner[static_cast<std::size_t>(triangles_(2, t))]);
    closed = face != Mesh::null_face();
  }
  if (!closed || !CGAL::is_closed(mesh))
    throw ModelError(
        {.fact = fmt::format("the surface of {} triangles is not closed", triangles_.cols()),
         .where = "body surface",
         .why = "it has a border, or more than two triangles meet at an edge",
         .remedy = "give a watertight surface; for an image, please report this as a mistake of ours"});

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

  stop_if_asked();
  side_by_side(
      [&] {
        tree_->aabb.insert(faces(mesh).first, faces(mesh).second, mesh);
        tree_->aabb.build();
        tree_->aabb.accelerate_distance_queries();
        tree_->side = std::make_unique<CGAL::Side_of_triangle_mesh<Mesh, Kernel>>(tree_->aabb);
      },
      [&] {
        const CGAL::Triangle_from_face_descriptor_map<Mesh> triangle_of(&mesh);
        tree_->triangle.reserve(static_cast<std::size_t>(triangles_.cols()));
        for (const auto face : faces(mesh)) tree_->triangle.push_back(get(triangle_of, face));
        tree_->cells.emplace(vertex_, triangles_);
      });
  tree_->cells->mark_clear_cells([&](const Vec3& x) { return tree_->contains(x); });
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
  return answer ? *answer : tree_->contains(x);
}

BodySurface::Closest BodySurface::closest(const Vec3& x) const {
  thread_local std::vector<Index> candidates;
  tree_->cells->nearest(x, candidates);
  if (candidates.size() == 1) {
    const Index t = candidates.front();
    const Vec3 p = from_cgal(Kernel().construct_projected_point_3_object()(
        tree_->triangle[static_cast<std::size_t>(t)], to_cgal(x)));
    return {p, t, (p - x).norm()};
  }
  const auto [place, face] = tree_->aabb.closest_point_and_primitive(to_cgal(x));
  const Vec3 p = from_cgal(place);
  return {p, static_cast<Index>(face.idx()), (p - x).norm()};
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
    if (tree_->pass(origin, Vec3::Unit(axis), hits, t)) {
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

std::vector<double> BodySurface::crossings(const Vec3& origin, const Vec3& direction) const {
  const double size = (upper() - lower()).norm();
  // A line through an edge or a corner meets several triangles at one place, or touches without passing. Such
  // a line is moved sideways by a billionth of the body's size and asked again.
  const Vec3 sideways = direction.unitOrthogonal();
  const Vec3 other = direction.normalized().cross(sideways);
  Index axis = 0;
  if (direction.cwiseAbs().maxCoeff(&axis) == 1.0 && direction.squaredNorm() == 1.0) {
    thread_local std::vector<SurfaceCells::Hit> hits;
    std::vector<double> t;
    const int along = static_cast<int>(axis);
    if (tree_->cells->line(origin, along, lower()[along] - size, upper()[along] + size, hits) &&
        tree_->pass(origin, direction, hits, t) && t.size() % 2 == 0)
      return t;
  }
  for (int attempt = 0; attempt < 8; ++attempt) {
    const double step = 1e-9 * size * attempt;
    const Vec3 o = origin + step * (0.61803 * sideways + 0.27393 * other);
    std::vector<AabbTree::Intersection_and_primitive_id<Kernel::Line_3>::Type> hits;
    tree_->aabb.all_intersections(
        Kernel::Line_3(to_cgal(o), Kernel::Vector_3(direction.x(), direction.y(), direction.z())),
        std::back_inserter(hits));
    std::vector<double> t;
    bool clean = true;
    for (const auto& hit : hits) {
      const auto* place = boost::get<Kernel::Point_3>(&hit.first);
      clean = clean && place;  // otherwise the line lies in the triangle
      if (place) t.push_back((from_cgal(*place) - o).dot(direction) / direction.squaredNorm());
    }
    std::sort(t.begin(), t.end());
    for (std::size_t k = 1; k < t.size(); ++k)
      clean = clean && t[k] - t[k - 1] > 1e-12 * size / direction.norm();
    if (clean && t.size() % 2 == 0) return t;
  }
  return {};
}

}  // namespace dimple
