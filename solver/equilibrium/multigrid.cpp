#include "solver/equilibrium/multigrid.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "io/stop.hpp"

// Smoothed aggregation, made by compute() and used by solve():
// 1. Aggregates: whole neighbourhoods of rows; a row that is left joins its most strongly coupled
//    neighbour's.
// 2. Prolongation P = (I - 4/3 D^-1 A / largest eigenvalue) T, T the aggregates' indicator; next matrix P' A
//    P.
// 3. Repeat 1 and 2 down to 300 rows, whose inverse is dense.
// 4. One cycle: two Chebyshev steps, restrict the residual, the coarser cycle, prolong, the same steps in
//    reverse order.
// 5. Two cycles; the first starts from zero.
//
// Source:   Vanek, Mandel, Brezina 1996; Adams et al. 2003 (step 4).
// Departs:  single precision, and sums in a fixed order.

namespace dimple {
namespace {

constexpr Eigen::Index coarsest_rows = 300;  // few enough for a dense inverse
constexpr std::int32_t rows_per_task = 1024;
// Fraction of the largest eigenvalue above which the smoother acts; the coarser level takes the rest. 0.2 and
// 0.3 serve as well, 0.1 less.
constexpr double smoothed_above = 0.25;
// One cycle alone leaves a fifth of the error: a mixed iteration on many nodes then takes up to twice as many
// steps; with two cycles it takes no more than with the exact inverse.
constexpr int cycles = 2;

// Number of the aggregate of each row; -1 for rows without neighbours, which the smoother solves.
std::vector<int> aggregate(const Multigrid::Sparse& matrix, int& count) {
  const auto n = static_cast<std::size_t>(matrix.rows());
  std::vector<int> of_row(n, -1);
  count = 0;
  for (int i = 0; i < matrix.rows(); ++i) {
    bool unloaded_past = true, alone = true;
    for (Multigrid::Sparse::InnerIterator e(matrix, i); e; ++e) {
      unloaded_past = unloaded_past && of_row[static_cast<std::size_t>(e.col())] < 0;
      alone = alone && (e.col() == i || e.value() == 0.0);
    }
    if (!unloaded_past || alone) continue;
    for (Multigrid::Sparse::InnerIterator e(matrix, i); e; ++e)
      of_row[static_cast<std::size_t>(e.col())] = count;
    ++count;
  }
  const std::vector<int> first = of_row;
  for (int i = 0; i < matrix.rows(); ++i) {
    if (first[static_cast<std::size_t>(i)] >= 0) continue;
    double strongest = 0.0;
    for (Multigrid::Sparse::InnerIterator e(matrix, i); e; ++e)
      if (e.col() != i && first[static_cast<std::size_t>(e.col())] >= 0 && -e.value() > strongest) {
        strongest = -e.value();
        of_row[static_cast<std::size_t>(i)] = first[static_cast<std::size_t>(e.col())];
      }
  }
  return of_row;
}

// Approximate largest eigenvalue of D^-1 A. Gershgorin's bound is half as much again, and halves the cycle's
// effect.
double largest_eigenvalue(const Multigrid::Sparse& matrix, const Eigen::VectorXd& diagonal) {
  Eigen::VectorXd v(matrix.rows());
  for (Eigen::Index i = 0; i < v.size(); ++i) v[i] = std::sin(12.9898 * static_cast<double>(i));
  double largest = 0.0;
  for (int pass = 0; pass < 15; ++pass) {
    stop_if_requested();
    v = (matrix * (v / v.norm())).cwiseQuotient(diagonal);
    largest = v.norm();
  }
  return 1.1 * largest;
}

// Sums in the rows' own order: the same for any number of threads.
template <class Row>
void over_rows(std::int32_t rows, const Row& row) {
  tbb::parallel_for(tbb::blocked_range<std::int32_t>(0, rows, rows_per_task), [&](const auto& range) {
    for (std::int32_t i = range.begin(); i < range.end(); ++i) row(i);
  });
}

}  // namespace

Multigrid::Rows Multigrid::pack(const Sparse& matrix) {
  Rows rows;
  rows.offset.assign(1, 0);
  rows.entry.reserve(static_cast<std::size_t>(matrix.nonZeros()));
  for (int i = 0; i < matrix.outerSize(); ++i) {
    for (Multigrid::Sparse::InnerIterator e(matrix, i); e; ++e)
      rows.entry.push_back({static_cast<std::int32_t>(e.col()), static_cast<float>(e.value())});
    rows.offset.push_back(static_cast<std::int32_t>(rows.entry.size()));
  }
  return rows;
}

bool Multigrid::compute(Sparse matrix) {
  levels_.clear();
  while (matrix.rows() > coarsest_rows) {
    stop_if_requested();
    Level& level = levels_.emplace_back();
    const Eigen::VectorXd diagonal = matrix.diagonal();
    if (!(diagonal.minCoeff() > 0.0)) return false;
    const double largest = largest_eigenvalue(matrix, diagonal);
    int count = 0;
    const std::vector<int> of_row = aggregate(matrix, count);
    std::vector<Eigen::Triplet<double>> one;
    for (std::size_t i = 0; i < of_row.size(); ++i)
      if (of_row[i] >= 0) one.emplace_back(static_cast<int>(i), of_row[i], 1.0);
    Sparse tentative(matrix.rows(), count);
    tentative.setFromTriplets(one.begin(), one.end());
    const Eigen::VectorXd damped = (4.0 / 3.0 / largest) * diagonal.cwiseInverse();
    const Sparse prolongation = tentative - Sparse(damped.asDiagonal() * Sparse(matrix * tentative));
    stop_if_requested();
    const Sparse restriction = prolongation.transpose();
    Sparse coarser = restriction * Sparse(matrix * prolongation);

    level.matrix = pack(matrix);
    level.prolongation = pack(prolongation);
    level.restriction = pack(restriction);
    for (const double d : diagonal) level.inverse_diagonal.push_back(static_cast<float>(1.0 / d));
    const double middle = 0.5 * largest * (1.0 + smoothed_above),
                 reach = 0.5 * largest * (1.0 - smoothed_above) * std::sqrt(0.5);
    level.relax[0] = static_cast<float>(1.0 / (middle + reach));
    level.relax[1] = static_cast<float>(1.0 / (middle - reach));
    for (Vectors* v : {&level.b, &level.x, &level.y}) v->resize(static_cast<std::size_t>(matrix.rows()));
    matrix.swap(coarser);
  }
  // Eigen blocks products of dense matrices by the size of the processor's caches, which changes their bits:
  // the factor is one without blocks, applied to one column at a time.
  const Eigen::Index n = matrix.rows();
  const Eigen::LDLT<Eigen::MatrixXd> factor{Eigen::MatrixXd(matrix)};
  if (factor.info() != Eigen::Success || !factor.isPositive()) return false;
  coarsest_.resize(n, n);
  for (Eigen::Index k = 0; k < n; ++k)
    coarsest_.col(k) = factor.solve(Eigen::VectorXd::Unit(n, k)).cast<float>();
  coarsest_b_.resize(static_cast<std::size_t>(matrix.rows()));
  coarsest_x_.resize(coarsest_b_.size());
  return true;
}

// coarsest_x_ = coarsest_ coarsest_b_, each sum from its first to its last term; eight independent rows at
// once.
void Multigrid::solve_coarsest() {
  constexpr int together = 8;
  const auto n = static_cast<int>(coarsest_b_.size());
  const auto rows_from = [&](int i, auto count) {
    Vec4 sum[count] = {};
    for (int k = 0; k < n; ++k) {
      const float* entry = &coarsest_(i, k);
      for (int j = 0; j < count; ++j) sum[j] += coarsest_b_[static_cast<std::size_t>(k)] * entry[j];
    }
    for (int j = 0; j < count; ++j) coarsest_x_[static_cast<std::size_t>(i + j)] = sum[j];
  };
  int i = 0;
  for (; i + together <= n; i += together) rows_from(i, std::integral_constant<int, together>());
  for (; i < n; ++i) rows_from(i, std::integral_constant<int, 1>());
}

// levels_[depth].x becomes about A^-1 b there; `from_zero`: it is zero before.
void Multigrid::cycle(std::size_t depth, bool from_zero) {
  if (depth == levels_.size()) {
    solve_coarsest();
    return;
  }
  Level& level = levels_[depth];
  const auto n = static_cast<std::int32_t>(level.b.size());
  const auto sum = [](const Rows& rows, std::int32_t i, const Vectors& x) {
    Vec4 even = {}, odd = {};
    auto k = static_cast<std::size_t>(rows.offset[static_cast<std::size_t>(i)]);
    const auto end = static_cast<std::size_t>(rows.offset[static_cast<std::size_t>(i) + 1]);
    for (; k + 1 < end; k += 2) {
      even += x[static_cast<std::size_t>(rows.entry[k].column)] * rows.entry[k].value;
      odd += x[static_cast<std::size_t>(rows.entry[k + 1].column)] * rows.entry[k + 1].value;
    }
    if (k < end) even += x[static_cast<std::size_t>(rows.entry[k].column)] * rows.entry[k].value;
    return even + odd;
  };
  // y = x + w D^-1 (b - A x); x and y are swapped.
  const auto smooth = [&](float w) {
    over_rows(n, [&](std::int32_t i) {
      const auto at = static_cast<std::size_t>(i);
      level.y[at] =
          level.x[at] + (level.b[at] - sum(level.matrix, i, level.x)) * (w * level.inverse_diagonal[at]);
    });
    level.x.swap(level.y);
  };
  if (from_zero)
    over_rows(n, [&](std::int32_t i) {
      const auto at = static_cast<std::size_t>(i);
      level.x[at] = level.b[at] * (level.relax[0] * level.inverse_diagonal[at]);
    });
  else
    smooth(level.relax[0]);
  smooth(level.relax[1]);
  over_rows(n, [&](std::int32_t i) {
    const auto at = static_cast<std::size_t>(i);
    level.y[at] = level.b[at] - sum(level.matrix, i, level.x);
  });
  const bool last = depth + 1 == levels_.size();
  Vectors& b = last ? coarsest_b_ : levels_[depth + 1].b;
  over_rows(static_cast<std::int32_t>(b.size()),
            [&](std::int32_t i) { b[static_cast<std::size_t>(i)] = sum(level.restriction, i, level.y); });
  cycle(depth + 1, true);
  const Vectors& x = last ? coarsest_x_ : levels_[depth + 1].x;
  over_rows(n,
            [&](std::int32_t i) { level.x[static_cast<std::size_t>(i)] += sum(level.prolongation, i, x); });
  smooth(level.relax[1]);
  smooth(level.relax[0]);
}

void Multigrid::solve(const Vectors& b, Vectors& x) {
  (levels_.empty() ? coarsest_b_ : levels_.front().b) = b;
  for (int k = 0; k < (levels_.empty() ? 1 : cycles); ++k) cycle(0, k == 0);
  x = levels_.empty() ? coarsest_x_ : levels_.front().x;
}

}  // namespace dimple
