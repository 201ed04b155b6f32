#include "preprocess/body_surface.hpp"

#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Side_of_triangle_mesh.h>
#include <CGAL/Surface_mesh.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "io/error.hpp"

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

struct BodySurface::Tree {
  Mesh mesh;
  AabbTree aabb;
  std::unique_ptr<CGAL::Side_of_triangle_mesh<Mesh, Kernel>> side;
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

  tree_->aabb.insert(faces(mesh).first, faces(mesh).second, mesh);
  tree_->aabb.build();
  tree_->aabb.accelerate_distance_queries();
  tree_->side = std::make_unique<CGAL::Side_of_triangle_mesh<Mesh, Kernel>>(tree_->aabb);
}

BodySurface::~BodySurface() = default;
BodySurface::BodySurface(BodySurface&&) noexcept = default;

bool BodySurface::contains(const Vec3& x) const {
  return (*tree_->side)(to_cgal(x)) != CGAL::ON_UNBOUNDED_SIDE;
}

BodySurface::Closest BodySurface::closest(const Vec3& x) const {
  const auto [place, face] = tree_->aabb.closest_point_and_primitive(to_cgal(x));
  const Vec3 p = from_cgal(place);
  return {p, static_cast<Index>(face.idx()), (p - x).norm()};
}

std::vector<double> BodySurface::crossings(const Vec3& origin, const Vec3& direction) const {
  const double size = (upper() - lower()).norm();
  // A line through an edge or a corner meets several triangles at one place, or touches without passing. Such
  // a line is moved sideways by a billionth of the body's size and asked again.
  const Vec3 sideways = direction.unitOrthogonal();
  const Vec3 other = direction.normalized().cross(sideways);
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
