#pragma once

#include "preprocess/model.hpp"

namespace dimple {

/// Shape functions at places that are not integration points, kept for repeated use; for pictures and
/// surfaces. A place without a possible support takes the nearest node's value. `connected`(node, place), if
/// given, restricts which nodes belong to a place.
struct Interpolation {
  CompressedRows rows;
  Eigen::VectorXd weight;  ///< [rows.member]
  /// Nodal values [dim x N] -> values at the places [dim x M].
  Eigen::MatrixXd operator()(const Eigen::MatrixXd& nodal) const;
};

}  // namespace dimple
