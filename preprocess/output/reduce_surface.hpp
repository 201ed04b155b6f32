#pragma once

#include <vector>

#include "preprocess/model.hpp"

namespace dimple {

/// Some vertices of a surface and triangles between them, for small pictures.
struct ReducedSurface {
  std::vector<Index> vertex;  ///< [V] numbers of the remaining vertices
  Triangles triangles;        ///< [3xT] corners counted among `vertex`
  double within_mm = 0.0;     ///< no vertex of the surface is farther from these triangles
};

/// At most `most_triangles`, or all if the surface has no more. Vertices in one cube of a lattice become one
/// of them; cubes are four times smaller at the contact patch, where the surface will bend. The result need
/// not be closed.
ReducedSurface reduced_surface(const Surface& surface, const ToolPlace& tool, Index most_triangles);

}  // namespace dimple
