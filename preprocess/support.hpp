#pragma once

#include "preprocess/mls_gradient.hpp"
#include "preprocess/model.hpp"

namespace dimple {

/// What happened while the supports were found: printed, and kept in summary.json.
struct SupportReport {
  Index grown = 0;              ///< points whose support was enlarged to condition the moment matrix
  double largest_growth = 1.0;  ///< by which factor at most
  Index fewest = 0, most = 0;   ///< nodes in a support
  double mean = 0.0;
  double worst_pivot_ratio = 1.0;
  double linear_error = 0.0;  ///< largest error in reproducing a constant or linear field's gradient
};

/// For each integration point: its nodes (those whose radius reaches it) and their shape function gradients.
///
/// A point is accepted when its moment matrix is well conditioned and it has at least twice as many nodes as
/// the basis has terms; until then all radii are enlarged for that point by a tenth, at most to 2.5 times.
/// Fills model.support and model.dphi from X, spacing and point.
/// Throws ModelError where even that is not enough: the place, the count, what to change.
SupportReport find_supports(Model& model, const SupportOptions& options);

/// Shape functions at places that are not integration points, kept for use at many times; for pictures and
/// surfaces. A place that no support can be found for takes the nearest node's value.
struct Interpolation {
  CompressedRows rows;
  Eigen::VectorXd weight;  ///< [rows.member]
  /// Nodal values [dim x N] -> values at the places [dim x M].
  Eigen::MatrixXd operator()(const Eigen::MatrixXd& nodal) const;
};
Interpolation make_interpolation(const Model& model, const SupportOptions& options, const Points& places);

}  // namespace dimple
