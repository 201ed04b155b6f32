#pragma once

#include <vector>

#include "preprocess/nodes/sizing.hpp"
#include "preprocess/scene/boundary_conditions.hpp"

namespace dimple {

/// Ten-node tetrahedra that fill a body, for programs that need a mesh. Lengths in mm, in the surface's own
/// frame.
struct TetrahedralMesh {
  Points X;  ///< [3xN] corners, then the middles of edges
  /// [10xE] four corners, of positive volume, then the middles of edges 01, 12, 20, 03, 13, 23: the order of
  /// Abaqus, CalculiX and FEBio.
  Eigen::Matrix<Index, 10, Eigen::Dynamic> tetrahedra;
  std::vector<Index> base;          ///< nodes held fixed, ascending
  std::vector<Index> bonded_patch;  ///< nodes that the tool moves, ascending
  double volume_mm3 = 0.0;          ///< of all tetrahedra
};

/// Fills the body with edges of about `spacing_mm` times the sizing. The patch's edge is made of edges of the
/// mesh, so that its area is independent of the spacing. Middle nodes are half-way: faces are flat. By CGAL's
/// Mesh_3, some of whose steps follow addresses in memory: between starts of the program the number of nodes
/// may differ by a few per thousand. Throws ModelError: the spacing is too coarse for the body.
TetrahedralMesh make_tetrahedra(const BodySurface& body, const Boundary& boundary, const Sizing& sizing,
                                double spacing_mm);

/// The spacing [mm] that gives about `count` nodes, corners and middles together.
double tetrahedra_spacing_for_count(const BodySurface& body, Index count, const Sizing& sizing);

}  // namespace dimple
