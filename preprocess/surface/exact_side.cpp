#include "preprocess/surface/exact_side.hpp"

#include <CGAL/AABB_face_graph_triangle_primitive.h>
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Side_of_triangle_mesh.h>
#include <CGAL/Surface_mesh.h>

#include <iterator>

namespace dimple {
namespace {

using SideKernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using SideMesh = CGAL::Surface_mesh<SideKernel::Point_3>;

SideMesh::Vertex_index vertex_of(Index v) {
  return SideMesh::Vertex_index(static_cast<SideMesh::Vertex_index::size_type>(v));
}

SideMesh mesh_of(const Points& vertex, const Triangles& triangles) {
  SideMesh mesh;
  for (const auto& x : vertex.colwise()) mesh.add_vertex({x[0], x[1], x[2]});
  for (const auto& t : triangles.colwise()) mesh.add_face(vertex_of(t[0]), vertex_of(t[1]), vertex_of(t[2]));
  return mesh;
}

}  // namespace

struct ExactSide::Mesh {
  using Primitive = CGAL::AABB_face_graph_triangle_primitive<SideMesh>;
  using AabbTree = CGAL::AABB_tree<CGAL::AABB_traits<SideKernel, Primitive>>;

  SideMesh mesh;
  AabbTree aabb;
  std::unique_ptr<CGAL::Side_of_triangle_mesh<SideMesh, SideKernel>> side;
};

ExactSide::ExactSide(const Points& vertex, const Triangles& triangles) : mesh_(std::make_unique<Mesh>()) {
  mesh_->mesh = mesh_of(vertex, triangles);
  mesh_->aabb.insert(faces(mesh_->mesh).first, faces(mesh_->mesh).second, mesh_->mesh);
  mesh_->aabb.build();
  mesh_->side = std::make_unique<CGAL::Side_of_triangle_mesh<SideMesh, SideKernel>>(mesh_->aabb);
}

ExactSide::~ExactSide() = default;

bool ExactSide::contains(const Vec3& x) const {
  return (*mesh_->side)(SideKernel::Point_3(x.x(), x.y(), x.z())) != CGAL::ON_UNBOUNDED_SIDE;
}

std::vector<std::pair<Index, Index>> crossing_triangles(const TriangleMesh& mesh) {
  const SideMesh surface = mesh_of(mesh.vertex, mesh.triangles);
  std::vector<std::pair<SideMesh::Face_index, SideMesh::Face_index>> crossing;
  CGAL::Polygon_mesh_processing::self_intersections<CGAL::Parallel_if_available_tag>(
      surface, std::back_inserter(crossing));
  std::vector<std::pair<Index, Index>> result;
  for (const auto& [t, other] : crossing)
    result.emplace_back(static_cast<Index>(t.idx()), static_cast<Index>(other.idx()));
  return result;
}

}  // namespace dimple
