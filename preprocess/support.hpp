#pragma once

#include "preprocess/mls_gradient.hpp"
#include "preprocess/model.hpp"

namespace dimple {

/// What happened while the supports were found: printed, and kept in summary.json.
struct SupportReport {
  Index grown = 0;              ///< places whose support was enlarged to condition the moment matrix
  double largest_growth = 1.0;  ///< by which factor at most
  Index fewest = 0, most = 0;   ///< nodes in a support
  double mean = 0.0;
  double worst_pivot_ratio = 1.0;
  Index fewest_at = -1, worst_pivot_at = -1;  ///< points
  double linear_error = 0.0;  ///< largest error in reproducing a constant or linear field's gradient
};

/// For each integration point: its nodes (those whose radius reaches it) and their shape function gradients.
///
/// A place is accepted when its moment matrix is well conditioned and it has at least twice as many nodes as
/// the basis has terms; until then all radii are enlarged for that place by a tenth, at most to 2.5 times.
///
/// Where the model has a `spread`, the gradients are means over the point's cell, by the eight places
/// point + spread^(1/2) (+-1, +-1, +-1), which integrate quadratics exactly; and `variance` receives what the
/// mean leaves out of |F|^2. Means make the sum of forces independent of where the points lie; the
/// variance makes it independent of how many there are.
///
/// Fills support, dphi and variance from X, spacing, point, spread and axes. `tissue` [Q]: number of each
/// point's; empty: all one. Throws ModelError where even that is not enough: the place, the count, what to
/// change.
SupportReport find_supports(Model& model, const SupportOptions& options, const Eigen::VectorXi& tissue = {});

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
