#pragma once

#include "preprocess/supports/interpolation.hpp"
#include "solver/terms/force_term.hpp"

namespace dimple {

/// What an equilibrium may lack at a sample at most: penetration, slip of what friction holds, or what a
/// force would move where nothing touches. Of a tool that is measured it is a part of the depth and of the
/// tool's radius, and its force is wrong by about 1.4 times the mean over the depth; of walls and folds a
/// part of the spacing of the nodes there.
inline constexpr double contact_error = 5e-4, wall_error = 2e-3;

/// Contact without penetration, at samples of a body's surface. Each has a force along a normal, and the
/// forces are unknowns beside the displacements, and no penalty:
///
///     lambda_s >= 0,   d_s(u) >= 0,   lambda_s d_s(u) = 0    at every sample s,
///
/// d_s the gap, which changes by n_s . sum_a w_sa du_a. Whoever looks for equilibrium sets the forces, see
/// MixedIteration. Their energy is nothing.
///
/// Source:   Wriggers, Computational Contact Mechanics, 2006, chapters 4 and 5 (Lagrange multipliers).
class ContactTerm : public ForceTerm {
 public:
  virtual Index count() const = 0;                 ///< samples
  virtual const Interpolation& moves() const = 0;  ///< w
  /// Another number whenever moves() is of other places; a foot that moves a little is none.
  virtual int pairing() const { return 0; }
  /// contact_error or wall_error, as a length [m].
  virtual double error_at(Index s, const Instant& now) const = 0;

  /// Of the search for equilibrium: a normal force for each sample, and behind them what friction needs.
  virtual Index unknowns() const { return count(); }
  /// [unknowns] N from now on.
  virtual void set_forces(const Eigen::VectorXd& unknowns) { force_ = unknowns; }
  /// Takes from such unknowns what pulls, and of friction what is beyond its bound.
  virtual void bring_back(Eigen::Ref<Eigen::VectorXd> unknowns) const { unknowns = unknowns.cwiseMax(0.0); }

  /// [M] N.
  const Eigen::VectorXd& forces() const { return force_; }
  /// Of the last add_force(): [M] d_s [m], [3xM] n_s, unit vectors along which the forces push.
  const Eigen::VectorXd& gaps() const { return gap_; }
  const Points& normals() const { return normal_; }

  double energy(const Nodal&, const Instant&) override { return 0.0; }

  /// Adds such forces on the body to f [4xN] N, as of what resists: [M] N along the normals of the last
  /// add_force(), and [3xM] N.
  void spread(const Eigen::VectorXd& force, Nodal& f) const;
  void spread(const Points& force, Nodal& f) const;

 protected:
  Eigen::VectorXd force_, gap_;
  Points normal_;
};

}  // namespace dimple
