#pragma once

#include <array>
#include <span>
#include <vector>

#include "io/types.hpp"

namespace dimple {

constexpr int cell_places = 8;

/// Shape functions or their gradients at eight places, such as those of a cell, computed side by side.
struct MlsOfEight {
  std::vector<int> nodes;  ///< those that reach any of the places, in the order given
  Index stride = 0;        ///< from row to row: nodes.size() and a few zeros
  /// Row `place` holds phi of each node, or row 3 place + r holds d phi/dx_r; 0 of a node out of reach.
  std::vector<double> rows;
  std::array<int, cell_places> reached{};  ///< nodes that reach each place
  /// Smallest over largest pivot, as in MlsResult but without the exchange of rows.
  std::array<double, cell_places> pivot_ratio{};
  std::vector<double> weight;  // of the first pass, for the second
};

/// Computes mls_shape_functions() at eight places, equal to rounding: the gradients or else the values. `x`
/// [3x8]; `nodes`: all that may reach one of them. `pinned` [N]: 1 at prescribed nodes, whose weight is
/// sharpened by `interpolation`.
void mls_of_eight(const Points& x, const Points& X, std::span<const int> nodes, const Eigen::VectorXd& radius,
                  std::span<const char> pinned, double interpolation, bool gradients, MlsOfEight& result);

/// Replaces the rows of the eight places by their mean, rows 0 to 2, and by 21 rows g whose products are the
/// variance's: sum_k (d_k - mean)(d_k - mean)^T = sum over those rows of g g^T.
void mean_and_deviations(MlsOfEight& gradients);

/// factor sum_r row_r[a] row_r[b], b <= a, row by row: the lower triangle from `count` rows of `n` numbers.
/// Rows are `stride` apart, a multiple of 8 not below n, and zero beyond n.
void lower_products(const double* rows, int count, Index stride, Index n, double factor, double* lower);

}  // namespace dimple
