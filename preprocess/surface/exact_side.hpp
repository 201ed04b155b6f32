#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

// Exact predicates of CGAL for closed surfaces; its headers are in one file, since they compile slowly.

/// Exact test of points inside a closed surface. Source: CGAL's Side_of_triangle_mesh.
class ExactSide {
 public:
  ExactSide(const Points& vertex, const Triangles& triangles);
  ~ExactSide();
  ExactSide(const ExactSide&) = delete;
  ExactSide& operator=(const ExactSide&) = delete;

  bool contains(const Vec3& x) const;  ///< the surface itself is inside

 private:
  struct Mesh;
  std::unique_ptr<Mesh> mesh_;
};

/// Pairs of triangles of a manifold that cross, in no order. Computed on all processors.
std::vector<std::pair<Index, Index>> crossing_triangles(const TriangleMesh& mesh);

}  // namespace dimple
