#pragma once

#include <vector>

#include "preprocess/model.hpp"

namespace dimple {

/// Some vertices of a surface and triangles between them: for pictures that have to be small.
struct ReducedSurface {
  std::vector<Index> vertex;  ///< [V] numbers of the surface's vertices that are left
  Triangles triangles;        ///< [3xT] corners counted among `vertex`
  double within_mm = 0.0;     ///< no vertex of the surface is farther from these triangles
};

/// At most `most_triangles`, or all if they are no more. Vertices in one cube of a lattice become one of
/// them; cubes are four times smaller at the tool's circle, where the surface is about to bend. The result
/// need not be closed.
ReducedSurface reduced_surface(const Surface& surface, const ToolPlace& tool, Index most_triangles);

}  // namespace dimple
