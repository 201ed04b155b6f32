#include "solver/equilibrium/anderson.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <cmath>

namespace dimple::anderson_test {
namespace {

// The map x -> x + b - A x with eigenvalues of A from 0.02 to 1.9.
struct Linear {
  Eigen::MatrixXd A;
  Eigen::VectorXd b, solution;
  Linear() : A(8, 8), b(8) {
    for (int i = 0; i < 8; ++i)
      for (int j = 0; j < 8; ++j) A(i, j) = std::sin(1.0 + 3.0 * i + 7.0 * j);
    const Eigen::MatrixXd Q = Eigen::HouseholderQR<Eigen::MatrixXd>(A).householderQ();
    A = Q * Eigen::VectorXd::LinSpaced(8, 0.02, 1.9).asDiagonal() * Q.transpose();
    for (int i = 0; i < 8; ++i) b[i] = std::cos(2.0 * i);
    solution = A.ldlt().solve(b);
  }
  Eigen::VectorXd step(const Eigen::VectorXd& x) const { return b - A * x; }
  double residual(const Eigen::VectorXd& x) const { return step(x).norm() / b.norm(); }
};

TEST(Anderson, SolvesALinearProblemInLittleMoreStepsThanItHasUnknowns) {
  const Linear problem;
  Anderson anderson;
  anderson.begin(8, true);
  Eigen::VectorXd x = Eigen::VectorXd::Zero(8), plain = x;
  for (int k = 0; k < 14; ++k) {
    x = anderson.next(x, problem.step(x), 1.0);
    plain += problem.step(plain);
  }
  EXPECT_LT(problem.residual(x), 1e-5);
  EXPECT_GT(problem.residual(plain), 1e-2) << "which the iteration alone does not";
}

TEST(Anderson, ForgetsWhatIsOfNoUse) {
  const Linear problem;
  Anderson anderson;
  anderson.begin(8, true);
  Eigen::VectorXd x = Eigen::VectorXd::Zero(8);
  for (int k = 0; k < 4; ++k) x = anderson.next(x, problem.step(x), 1.0);
  anderson.forget();
  const Eigen::VectorXd step = problem.step(x);
  EXPECT_EQ(anderson.next(x, step, 1.0), Eigen::VectorXd(x + step))
      << "the first step is the iteration's own";
  EXPECT_EQ(anderson.remembers(), 0);
  anderson.begin(8, true);
  EXPECT_EQ(anderson.next(x, step, 4.0), Eigen::VectorXd(x + step / 4.0)) << "a cautious one is shorter";
}

// Once the window is full its oldest columns are overwritten; the iteration continues with `most` columns.
TEST(Anderson, RemembersNoMoreThanItsWindow) {
  Anderson anderson;
  const Eigen::Index n = 100;
  anderson.begin(n, true);
  const Eigen::VectorXd rate = Eigen::VectorXd::LinSpaced(n, 0.01, 1.0);
  Eigen::VectorXd x = Eigen::VectorXd::Ones(n);
  for (int k = 0; k < 80; ++k) x = anderson.next(x, -rate.cwiseProduct(x), 1.0);
  EXPECT_EQ(anderson.remembers(), Anderson::most);
  EXPECT_LT(rate.cwiseProduct(x).norm(), 1e-4);
}

}  // namespace
}  // namespace dimple::anderson_test
