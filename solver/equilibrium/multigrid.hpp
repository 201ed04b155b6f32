#pragma once

#include <Eigen/Dense>
#include <Eigen/SparseCore>
#include <cstdint>
#include <vector>

#include "solver/huge_pages.hpp"

namespace dimple {

/// Two V-cycles of multigrid by smoothed aggregation: nearly the inverse of a sparse, symmetric matrix whose
/// off-diagonal entries are not positive, such as a graph's Laplacian, for three or four right-hand sides at
/// once. Unlike those of a sparse factor, time and memory grow linearly with the rows. Single precision, as a
/// preconditioner needs no more. Symmetric; the same bits for any number of threads and on any processor.
///
/// Source:   Vanek, Mandel, Brezina, Computing 56, 1996; Chebyshev smoothing, twice before and after: Adams
///           et al. 2003.
class Multigrid {
 public:
  using Vec4 = float __attribute__((vector_size(16)));
  using Vectors = LongVector<Vec4>;
  using Sparse = Eigen::SparseMatrix<double, Eigen::RowMajor>;

  /// False where the matrix is not positive definite. `matrix` has both its halves.
  bool compute(Sparse matrix);
  /// x = about matrix^-1 b.
  void solve(const Vectors& b, Vectors& x);

 private:
  struct Entry {
    std::int32_t column;
    float value;
  };
  struct Rows {
    std::vector<std::int32_t> offset;
    LongVector<Entry> entry;
  };
  struct Level {
    Rows matrix, prolongation, restriction;
    std::vector<float> inverse_diagonal;
    float relax[2];
    Vectors b, x, y;
  };

  static Rows pack(const Sparse& matrix);
  void cycle(std::size_t depth, bool from_zero);
  void solve_coarsest();

  std::vector<Level> levels_;
  Eigen::MatrixXf coarsest_;  // inverse of the last level's matrix
  Vectors coarsest_b_, coarsest_x_;
};

}  // namespace dimple
