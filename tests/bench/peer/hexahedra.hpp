#pragma once

#include <vector>

#include "preprocess/cloud/sizing.hpp"
#include "preprocess/scene/boundary_conditions.hpp"

namespace dimple {

/// Twenty-node hexahedra that fill a body, for programs that need a mesh. Lengths in mm, in the surface's own
/// frame.
struct HexahedralMesh {
  Points X;  ///< [3xN] corners, then the middles of edges
  Index corner_count = 0;
  /// [20xE] eight corners, of positive volume, then the middles of edges 01, 12, 23, 30, 45, 56, 67, 74, 04,
  /// 15, 26, 37: the order of Abaqus, CalculiX and FEBio.
  Eigen::Matrix<Index, 20, Eigen::Dynamic> hexahedra;
  std::vector<Index> base;    ///< nodes held fixed, ascending
  std::vector<Index> circle;  ///< nodes that the tool moves, ascending
  double volume_mm3 = 0.0;    ///< of all hexahedra
};

/// Columns of cells along the push: across it a square inside the circle, rings from there to the circle and
/// from the circle to the body's outline, all thinnest at the rim; along it layers that are thinnest at the
/// top. Their ends follow the body's upper and lower surface; cells whose middle is outside are left out, so
/// that sides that are not those of a block are steps. Far cells are about `spacing_mm` thick, at the rim
/// `grading.rim` of that. Throws ModelError: the spacing is too coarse for the body.
HexahedralMesh make_hexahedra(const BodySurface& body, const Boundary& boundary,
                              const GradingOptions& grading, double spacing_mm);

/// The spacing [mm] that gives about `count` nodes, corners and middles together.
double hexahedra_spacing_for_count(const BodySurface& body, const Boundary& boundary,
                                   const GradingOptions& grading, Index count);

/// Determinant of the map from the unit cube, [-1, 1]^3, at one of its places: positive in a usable cell.
double jacobian(const Eigen::Matrix<double, 3, 20>& x, const Vec3& xi);

}  // namespace dimple
