#pragma once

#include "solver/terms/internal_force.hpp"

namespace dimple {

/// Best state of an iteration, and the step from it. Each later residual is a gain, a setback, or neither;
/// too many of the last kind end the iteration.
class BestState {
 public:
  /// Starts an iteration that has taken no step yet.
  BestState(const Nodal& u, const Eigen::VectorXd& lambda, double residual)
      : residual_(residual), u_(u), lambda_(lambda) {}

  const Nodal& u() const { return u_; }
  const Eigen::VectorXd& lambda() const { return lambda_; }
  double residual() const { return residual_; }
  bool has_step() const { return du_.size() > 0; }
  /// Divisor of the steps of the iteration; it doubles after each setback.
  double caution() const { return caution_; }

  /// True if the iteration cannot continue from such a residual: not finite, or far above the best.
  bool is_setback(double residual) const;
  /// Sets u and lambda to the best state plus its step over the doubled caution. False: there is no step, or
  /// this is the fifth setback.
  bool step_back(Nodal& u, Eigen::VectorXd& lambda);

  /// Counts a state that is neither. False: there were too many without a gain.
  bool may_continue() { return ++since_gain_ <= without_gain; }
  bool is_last_attempt() const { return since_gain_ >= without_gain; }
  /// True if clearly better than the best state, or the first with a step.
  bool is_gain(double residual) const;
  void take(const Nodal& u, const Eigen::VectorXd& lambda, double residual);
  void take(const Nodal& u, const Eigen::VectorXd& lambda, double residual, const Nodal& du,
            const Eigen::VectorXd& dlambda);

 private:
  static constexpr int without_gain = 30, most_setbacks = 4;
  double residual_;
  Nodal u_, du_;
  Eigen::VectorXd lambda_, dlambda_;
  double caution_ = 1.0;
  int setbacks_ = 0, since_gain_ = 0;
};

}  // namespace dimple
