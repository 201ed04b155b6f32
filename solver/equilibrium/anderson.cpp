#include "solver/equilibrium/anderson.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

// Anderson's acceleration, one call of next() at place x with step g(x):
// 1. Store the differences dX of places and dG of steps since the last call; the 30 latest are kept.
// 2. Minimise |g - dG gamma|: normal equations of columns scaled to length one, with 1e-10 on the diagonal.
// 3. Return x + g / caution - (dX + dG / caution) gamma; without differences x + g / caution.
//
// Source:   Walker and Ni 2011; departures are in the header.

namespace dimple {

void Anderson::begin(Eigen::Index length, bool reset) {
  if (gram_.size() == 0 || moved_.rows() != length) {
    moved_.resize(length, most);
    changed_.resize(length, most);
    gram_.resize(most, most);
    kept_ = next_ = 0;
  }
  if (reset) kept_ = next_ = 0;
  fresh_ = true;
}

void Anderson::forget() {
  kept_ = next_ = 0;
  fresh_ = true;
}

void Anderson::remember(const Eigen::VectorXd& place, const Eigen::VectorXd& step) {
  moved_.col(next_) = (place - last_place_).cast<float>();
  changed_.col(next_) = (step - last_step_).cast<float>();
  kept_ = std::min(kept_ + 1, most);
  for (int k = 0; k < kept_; ++k)
    gram_(next_, k) = gram_(k, next_) = static_cast<double>(changed_.col(next_).dot(changed_.col(k)));
  next_ = (next_ + 1) % most;
}

Eigen::VectorXd Anderson::next(const Eigen::VectorXd& place, const Eigen::VectorXd& step, double caution) {
  if (!fresh_) remember(place, step);
  fresh_ = false;
  last_place_ = place;
  last_step_ = step;
  Eigen::VectorXd result = place + step / caution;
  if (kept_ == 0) return result;
  const Eigen::VectorXd unit = gram_.diagonal().head(kept_).cwiseSqrt().cwiseMax(1e-300).cwiseInverse();
  Eigen::MatrixXd normal = unit.asDiagonal() * gram_.topLeftCorner(kept_, kept_) * unit.asDiagonal();
  normal.diagonal().array() += 1e-10;
  const Eigen::VectorXd right =
      unit.cwiseProduct((changed_.leftCols(kept_).transpose() * step.cast<float>()).cast<double>());
  const Eigen::VectorXf fraction = unit.cwiseProduct(normal.ldlt().solve(right)).cast<float>();
  result -= (moved_.leftCols(kept_) * fraction +
             changed_.leftCols(kept_) * (fraction / static_cast<float>(caution)))
                .cast<double>();
  return result;
}

}  // namespace dimple
