#pragma once

#include <Eigen/Core>

namespace dimple {

/// Accelerates a fixed-point iteration x -> x + g(x) with nearly linear g: it continues from the combination
/// of the last steps with the smallest g. All variables must be scaled to one unit, since their differences
/// are compared.
///
/// Source:   Walker and Ni, SIAM J. Numer. Anal. 49, 2011.
/// Departs:  differences are kept in single precision, since a preconditioner has no more digits. The normal
///           equations have columns of length one, since steps shrink by orders of magnitude.
class Anderson {
 public:
  static constexpr int most = 30;  ///< stored differences

  /// Begins an iteration of `length` variables; `reset`: discards the stored differences.
  void begin(Eigen::Index length, bool reset);
  /// Discards all differences: the next one is not of neighbouring places.
  void forget();
  /// Place after `place`, where g is `step`. `caution` divides g.
  Eigen::VectorXd next(const Eigen::VectorXd& place, const Eigen::VectorXd& step, double caution);

  int remembers() const { return kept_; }  ///< differences stored now

 private:
  Eigen::MatrixXf moved_, changed_;  // [length x most] differences of places and of g
  Eigen::MatrixXd gram_;             // [most x most] of `changed_`
  int kept_ = 0, next_ = 0;
  Eigen::VectorXd last_place_, last_step_;
  bool fresh_ = true;  // no step since begin() or forget()

  void remember(const Eigen::VectorXd& place, const Eigen::VectorXd& step);
};

}  // namespace dimple
