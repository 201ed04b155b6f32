#pragma once

#include <Eigen/Core>

namespace dimple {

/// Speeds up a fixed-point iteration x -> x + g(x) whose g is nearly linear: of the last steps it takes the
/// combination whose g is least, and goes on from there. In variables of one kind: their differences are
/// compared.
///
/// Source:   Walker and Ni, SIAM J. Numer. Anal. 49, 2011.
/// Departs:  differences of steps are kept in single precision, as a preconditioner's digits are worth no
/// more; the small
///           system of equations is that of columns of length one, with 1e-10 on its diagonal, since steps
///           shrink by orders of magnitude.
class Anderson {
 public:
  static constexpr int most = 30;  ///< differences that are remembered

  /// Another iteration of variables of this number begins; `anew`: what is remembered is of no use to it.
  void begin(Eigen::Index length, bool anew);
  /// The next difference is not one of neighbours: all are forgotten.
  void forget();
  /// The next place after `place`, where g is `step`. `caution`: g counts for so many times less.
  Eigen::VectorXd next(const Eigen::VectorXd& place, const Eigen::VectorXd& step, double caution);

  int remembers() const { return kept_; }  ///< differences now

 private:
  Eigen::MatrixXf moved_, changed_;  // [length x most] what each step changed, in the place and in g
  Eigen::MatrixXd gram_;             // [most x most] of `changed_`
  int kept_ = 0, next_ = 0;
  Eigen::VectorXd last_place_, last_step_;
  bool fresh_ = true;  // no step has been seen since begin() or forget()

  void remember(const Eigen::VectorXd& place, const Eigen::VectorXd& step);
};

}  // namespace dimple
