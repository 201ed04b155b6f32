#pragma once

#include "solver/terms/internal_force.hpp"

namespace dimple {

/// The best state that an iteration has met, the step that it took from there, and what follows of the
/// residual of each further one: it may be a gain, a setback that is taken back, or one of so many without a
/// gain that it is given up.
class BestState {
 public:
  /// Where an iteration begins; it has taken no step yet.
  BestState(const Nodal& u, const Eigen::VectorXd& lambda, double residual)
      : residual_(residual), u_(u), lambda_(lambda) {}

  const Nodal& u() const { return u_; }
  const Eigen::VectorXd& lambda() const { return lambda_; }
  double residual() const { return residual_; }
  bool has_step() const { return du_.size() > 0; }
  /// How many times shorter than the iteration would have them steps are taken: twice as much after each
  /// setback.
  double caution() const { return caution_; }

  /// A state of such a residual is no place to go on from: no number, or far worse than the best one.
  bool is_setback(double residual) const;
  /// Puts u and lambda half as far from the best state as the last step went. False: no step is known, or it
  /// would be the fifth time.
  bool step_back(Nodal& u, Eigen::VectorXd& lambda);

  /// One more state that is none of these. False: so many have been no gain that it is given up.
  bool may_go_on() { return ++since_gain_ <= without_gain; }
  bool was_the_last_chance() const { return since_gain_ >= without_gain; }
  /// Clearly better than the best one, or the first that a step is known of.
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
