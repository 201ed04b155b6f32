#include "solver/equilibrium/multigrid.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/SparseCholesky>
#include <cmath>
#include <cstring>
#include <vector>

#include "tests/helpers/caches.hpp"

namespace dimple::multigrid_test {
namespace {

using Sparse = Multigrid::Sparse;
using Columns = Eigen::Matrix<double, Eigen::Dynamic, 4>;

// Laplacian of a graph: the nodes of a cube of n^3, each coupled to its neighbours along the axes by a weight
// that varies by `contrast`. Those of the lowest layer are coupled to the ground as well.
Sparse laplacian(int n, double contrast) {
  const auto number = [n](int i, int j, int k) { return i + n * (j + n * k); };
  std::vector<Eigen::Triplet<double>> entries;
  const auto bind = [&](int a, int b, double weight) {
    entries.insert(entries.end(), {{a, a, weight}, {b, b, weight}, {a, b, -weight}, {b, a, -weight}});
  };
  for (int k = 0; k < n; ++k)
    for (int j = 0; j < n; ++j)
      for (int i = 0; i < n; ++i) {
        const double weight = std::pow(contrast, std::sin(1.7 * i) * std::sin(2.3 * j) * std::sin(0.9 * k));
        if (i + 1 < n) bind(number(i, j, k), number(i + 1, j, k), weight);
        if (j + 1 < n) bind(number(i, j, k), number(i, j + 1, k), weight);
        if (k + 1 < n) bind(number(i, j, k), number(i, j, k + 1), weight);
        if (k == 0) entries.emplace_back(number(i, j, k), number(i, j, k), weight);
      }
  Sparse matrix(n * n * n, n * n * n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

Multigrid::Vectors some_vectors(Eigen::Index rows, double phase) {
  Multigrid::Vectors result;
  result.resize(static_cast<std::size_t>(rows));
  for (Eigen::Index i = 0; i < rows; ++i)
    for (int c = 0; c < 4; ++c)
      result[static_cast<std::size_t>(i)][c] =
          static_cast<float>(std::sin(phase + 0.37 * static_cast<double>(i) * (c + 1)));
  return result;
}

Columns columns_of(const Multigrid::Vectors& vectors) {
  Columns result(static_cast<Eigen::Index>(vectors.size()), 4);
  for (Eigen::Index i = 0; i < result.rows(); ++i)
    for (int c = 0; c < 4; ++c) result(i, c) = vectors[static_cast<std::size_t>(i)][c];
  return result;
}

// Relative error of a solution after two cycles, in the norm of the matrix.
double left_undone(const Sparse& matrix, Multigrid& multigrid) {
  const Multigrid::Vectors b = some_vectors(matrix.rows(), 0.3);
  Multigrid::Vectors x = b;
  multigrid.solve(b, x);
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor{Eigen::SparseMatrix<double>(matrix)};
  const Columns exact = factor.solve(columns_of(b)), error = columns_of(x) - exact;
  const auto norm = [&](const Columns& v) { return std::sqrt((v.array() * (matrix * v).array()).sum()); };
  return norm(error) / norm(exact);
}

TEST(Multigrid, IsExactWhereOneLevelIsEnough) {
  const Sparse matrix = laplacian(6, 3.0);
  Multigrid multigrid;
  ASSERT_TRUE(multigrid.compute(matrix));
  EXPECT_LT(left_undone(matrix, multigrid), 1e-4);  // of single precision
}

// Multigrid must be independent of the number of rows: a smoother alone leaves 0.9 and more of these.
TEST(Multigrid, LeavesAFewPerCentHoweverManyRows) {
  for (const int n : {8, 16, 24}) {
    SCOPED_TRACE(n);
    const Sparse matrix = laplacian(n, 10.0);
    Multigrid multigrid;
    ASSERT_TRUE(multigrid.compute(matrix));
    EXPECT_LT(left_undone(matrix, multigrid), 0.1);
  }
}

TEST(Multigrid, IsSymmetricAsAPreconditionerMustBe) {
  const Sparse matrix = laplacian(14, 10.0);
  Multigrid multigrid;
  ASSERT_TRUE(multigrid.compute(matrix));
  const Multigrid::Vectors a = some_vectors(matrix.rows(), 0.3), b = some_vectors(matrix.rows(), 1.9);
  Multigrid::Vectors of_a = a, of_b = b;
  multigrid.solve(a, of_a);
  multigrid.solve(b, of_b);
  for (int c = 0; c < 4; ++c) {
    const double one = columns_of(b).col(c).dot(columns_of(of_a).col(c)),
                 other = columns_of(a).col(c).dot(columns_of(of_b).col(c)),
                 scale = columns_of(b).col(c).norm() * columns_of(of_a).col(c).norm();
    EXPECT_NEAR(one, other, 1e-5 * scale);
  }
}

TEST(Multigrid, GivesTheSameBitsForAnyNumberOfThreads) {
  const Sparse matrix = laplacian(20, 10.0);
  const Multigrid::Vectors b = some_vectors(matrix.rows(), 0.3);
  std::vector<Multigrid::Vectors> results;
  for (const std::size_t threads : {1, 2, 3}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    Multigrid multigrid;
    ASSERT_TRUE(multigrid.compute(matrix));
    results.push_back(b);
    multigrid.solve(b, results.back());
  }
  for (const Multigrid::Vectors& other : results)
    EXPECT_EQ(std::memcmp(other.data(), results.front().data(), other.size() * sizeof(other[0])), 0);
}

TEST(Multigrid, GivesTheSameBitsOnAProcessorWithOtherCaches) {
  for (const int side : {4, 6, 20}) {  // 64 and 216 rows are one level
    const Sparse matrix = laplacian(side, 10.0);
    const Multigrid::Vectors b = some_vectors(matrix.rows(), 0.3);
    std::vector<Multigrid::Vectors> results;
    for (const std::ptrdiff_t first_level : {8 << 10, 32 << 10, 48 << 10}) {
      const testing_bodies::Caches caches(first_level);
      Multigrid multigrid;
      ASSERT_TRUE(multigrid.compute(matrix));
      results.push_back(b);
      multigrid.solve(b, results.back());
    }
    for (const Multigrid::Vectors& other : results)
      EXPECT_EQ(std::memcmp(other.data(), results.front().data(), other.size() * sizeof(other[0])), 0)
          << side;
  }
}

// A body without supports can be moved without force.
TEST(Multigrid, SaysThatAMatrixIsNotPositiveDefinite) {
  Sparse matrix = laplacian(6, 3.0);
  for (int i = 0; i < matrix.rows(); ++i) matrix.coeffRef(i, i) -= 10.0;
  EXPECT_FALSE(Multigrid().compute(matrix));
  Sparse large = laplacian(12, 3.0);
  large.coeffRef(5, 5) = 0.0;
  EXPECT_FALSE(Multigrid().compute(large));
}

}  // namespace
}  // namespace dimple::multigrid_test
