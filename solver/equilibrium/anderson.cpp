#include "solver/equilibrium/anderson.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <utility>

namespace dimple {

void Anderson::begin(Eigen::Index length, bool anew) {
  Memory& m = memory_;
  if (m.gram.size() == 0 || m.moved.rows() != length) {
    m.moved.resize(length, most);
    m.changed.resize(length, most);
    m.gram.resize(most, most);
    m.kept = m.next = 0;
  }
  if (anew) m.kept = m.next = 0;
  fresh_ = true;
}

void Anderson::forget() {
  memory_.kept = memory_.next = 0;
  fresh_ = true;
}

void Anderson::remember(const Eigen::VectorXd& place, const Eigen::VectorXd& step) {
  Memory& m = memory_;
  m.moved.col(m.next) = (place - last_place_).cast<float>();
  m.changed.col(m.next) = (step - last_step_).cast<float>();
  m.kept = std::min(m.kept + 1, most);
  for (int k = 0; k < m.kept; ++k)
    m.gram(m.next, k) = m.gram(k, m.next) = static_cast<double>(m.changed.col(m.next).dot(m.changed.col(k)));
  m.next = (m.next + 1) % most;
}

Eigen::VectorXd Anderson::next(const Eigen::VectorXd& place, const Eigen::VectorXd& step, double caution) {
  if (!fresh_) remember(place, step);
  fresh_ = false;
  last_place_ = place;
  last_step_ = step;
  Eigen::VectorXd result = place + step / caution;
  const Memory& m = memory_;
  if (m.kept == 0) return result;
  const Eigen::VectorXd unit = m.gram.diagonal().head(m.kept).cwiseSqrt().cwiseMax(1e-300).cwiseInverse();
  Eigen::MatrixXd normal = unit.asDiagonal() * m.gram.topLeftCorner(m.kept, m.kept) * unit.asDiagonal();
  normal.diagonal().array() += 1e-10;
  const Eigen::VectorXd right =
      unit.cwiseProduct((m.changed.leftCols(m.kept).transpose() * step.cast<float>()).cast<double>());
  const Eigen::VectorXf share = unit.cwiseProduct(normal.ldlt().solve(right)).cast<float>();
  result -=
      (m.moved.leftCols(m.kept) * share + m.changed.leftCols(m.kept) * (share / static_cast<float>(caution)))
          .cast<double>();
  return result;
}

void Anderson::restore(Memory memory) {
  const Eigen::Index kept = memory.moved.cols();
  begin(memory.moved.rows(), true);
  memory_.moved.leftCols(kept) = memory.moved;
  memory_.changed.leftCols(kept) = memory.changed;
  memory_.gram.topLeftCorner(kept, kept) = memory.gram;
  memory_.kept = static_cast<int>(kept);
  memory_.next = memory.next;
}

}  // namespace dimple
