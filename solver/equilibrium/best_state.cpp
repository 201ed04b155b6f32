#include "solver/equilibrium/best_state.hpp"

#include <cmath>

namespace dimple {
namespace {

constexpr double setback = 10.0;  // growth of the residual that counts as a setback
constexpr double gain = 0.9;

}  // namespace

bool BestState::is_setback(double residual) const {
  return !std::isfinite(residual) || (has_step() && residual > setback * residual_);
}

bool BestState::step_back(Nodal& u, Eigen::VectorXd& lambda) {
  if (!has_step() || ++setbacks_ > most_setbacks) return false;
  caution_ *= 2.0;
  u = u_ + du_ / caution_;
  lambda = lambda_ + dlambda_ / caution_;
  return true;
}

bool BestState::is_gain(double residual) const {
  return residual < gain * residual_ || !has_step();
}

void BestState::take(const Nodal& u, const Eigen::VectorXd& lambda, double residual) {
  residual_ = residual;
  u_ = u;
  lambda_ = lambda;
}

void BestState::take(const Nodal& u, const Eigen::VectorXd& lambda, double residual, const Nodal& du,
                     const Eigen::VectorXd& dlambda) {
  take(u, lambda, residual);
  du_ = du;
  dlambda_ = dlambda;
  since_gain_ = 0;
}

}  // namespace dimple
