#pragma once

#include <span>
#include <vector>

#include "preprocess/model.hpp"
#include "preprocess/supports/mls_gradient.hpp"

namespace dimple {

/// Result of the search for a point's support; if it failed, the moment matrix and the number of nodes.
struct PointReport {
  bool grown = false, unconnected = false;
  double largest_growth = 1.0;
  double worst_pivot_ratio = 1.0;
  double linear_error = 0.0;
  bool ok = true;
  MlsResult failed;
  std::size_t failed_nodes = 0;
};

/// A point's support, its gradients [3 x nodes] 1/m, and the lower triangle of the local matrix of the
/// variance [m], row by row.
struct PointSupport : PointReport {
  std::vector<int> nodes;
  Points dphi;
  std::vector<double> variance;
};

/// Row a of a symmetric matrix: columns b <= a, ascending.
struct LowerRow {
  std::vector<int> column;
  std::vector<double> value;
};

/// Adds the local matrices of those `points` whose `tissue` is `requested` to the rows [nodes]. Points ascend
/// in each row, so that the sums have one order. `slot` [nodes]: -1 before and after.
void add_variance(const std::vector<PointSupport>& points, std::span<const int> tissue, int requested,
                  std::vector<int>& slot, std::vector<LowerRow>& rows);
/// Unfolds the whole matrix from its lower triangle, which is used up; sets rows and K of `result`.
void unfold(std::vector<LowerRow>& lower, GradientVariance& result);

}  // namespace dimple
