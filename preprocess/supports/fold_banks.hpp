#pragma once

#include "preprocess/model.hpp"
#include "preprocess/supports/cell_means.hpp"

namespace dimple {

/// Where the surface of a body faces itself across a gap: a fold, a slit, two lobes that lie side by side.
/// Each sample of one bank (the pieces of the surface nearest to one node, as ContactSurface has them) with
/// the place of the other bank that lies straight ahead of it. Both banks of a gap have samples: with those
/// of one alone the nodes of the other would wave through between them, by a tenth of their spacing.
///
/// Rows from M on are parts of samples where a bank bulges: one that comes nearer to the bank ahead than the
/// mean of the whole.
struct FoldBanks {
  /// Spacings by which a part is nearer than the whole, at rest and later: where banks are flat parts would
  /// stand for wholes by chance.
  static constexpr double bulges = 0.02;
  CellMeans sample;         ///< [rows]
  Eigen::VectorXd spacing;  ///< [M] of the nodes there [m]
  Points opposite;          ///< [3 x rows] the place ahead at rest [m]
  Points opposite_normal;   ///< [3xM] outward unit vectors there, from the bank ahead towards the sample
  Interpolation at_opposite;
  /// [M] The integration points next to `opposite` and to the sample that see them.
  std::vector<Index> point, own_point;
  std::vector<Index> part_end;  ///< [M] the row behind the last part of each sample
  Index count() const { return spacing.size(); }
  Index part_begin(Index s) const { return s == 0 ? count() : part_end[static_cast<std::size_t>(s - 1)]; }
};

/// Of gaps up to `widest` [m]. What lies side by side on the surface is none: banks face each other by 120
/// degrees and more. Empty: there are no such gaps, or the model has no surface.
FoldBanks fold_banks(const Model& model, double widest);

}  // namespace dimple
