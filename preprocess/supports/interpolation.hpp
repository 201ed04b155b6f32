#pragma once

#include "preprocess/model.hpp"

namespace dimple {

/// Shape functions at places that are not integration points, kept for use at many times; for pictures and
/// surfaces. A place that no support can be found for takes the nearest node's value. `connected`(node,
/// place), if given, says who may belong to whom.
struct Interpolation {
  CompressedRows rows;
  Eigen::VectorXd weight;  ///< [rows.member]
  /// Nodal values [dim x N] -> values at the places [dim x M].
  Eigen::MatrixXd operator()(const Eigen::MatrixXd& nodal) const;
};

}  // namespace dimple
