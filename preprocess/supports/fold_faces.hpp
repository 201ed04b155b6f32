#pragma once

#include "preprocess/model.hpp"
#include "preprocess/supports/cell_means.hpp"

namespace dimple {

/// Opposing walls of a gap in a body's surface: a fold, a slit, two lobes side by side. A sample of one wall
/// has the place of the other wall straight ahead of it. A method of this project.
/// 1. Small flat pieces of the surface with a wall within `widest` along their normal; the cosine of both
///    normals is below -0.5. Each piece belongs to the nearest node on its own side of the gap.
/// 2. Sample: the pieces of one node that face in the same direction. Its place ahead: by a ray from its
///    middle along its mean normal.
/// 3. Normal of the place ahead: the mean normal of the sample there.
/// 4. Parts: pieces in squares of a sixth of the spacing that are nearer to the wall than the sample. Rows
///    from M on are parts.
/// 5. Shape functions at samples, parts and places ahead.
///
/// Both walls of a gap have samples: with one wall alone, nodes of the other would penetrate between them, by
/// a tenth of their spacing.
struct FoldFaces {
  /// Least difference in gap of a part and its sample, at rest and later [spacings]: parts of flat walls
  /// would be chosen by chance.
  static constexpr double bulges = 0.02;
  CellMeans sample;         ///< [rows]
  Eigen::VectorXd spacing;  ///< [M] of the nodes there [m]
  Points opposite;          ///< the opposing place at rest [m]
  Points opposite_normal;   ///< [3xM] outward unit vectors there, from the opposing wall towards the sample
  Interpolation at_opposite;
  /// [M] The integration points next to `opposite` and to the sample that see them.
  std::vector<Index> point, own_point;
  std::vector<Index> part_end;  ///< [M] the row behind the last part of each sample
  Index count() const { return spacing.size(); }
  Index part_begin(Index s) const { return s == 0 ? count() : part_end[static_cast<std::size_t>(s - 1)]; }
};

/// Walls of gaps up to `widest` [m]; their normals differ by 120 degrees or more. Empty: there are no such
/// gaps, or the model has no surface.
FoldFaces find_fold_faces(const Model& model, double widest);

}  // namespace dimple
