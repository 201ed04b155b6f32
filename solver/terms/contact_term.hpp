#pragma once

#include "preprocess/supports/interpolation.hpp"
#include "solver/terms/force_term.hpp"

namespace dimple {

/// Largest admissible error of contact at a sample, as a length: penetration, slip of no-slip contact, or the
/// displacement by a force across an open gap. For the measured tool it is a fraction of the depth and of its
/// radius; its force is then wrong by about 1.4 times the mean error over the depth. For walls and folds it
/// is a fraction of the node spacing.
inline constexpr double contact_error = 5e-4, wall_error = 2e-3;

/// Contact without penetration, at samples of a body's surface. The normal forces are unknowns in addition to
/// the displacements, not penalties:
///
///     lambda_s >= 0,   d_s(u) >= 0,   lambda_s d_s(u) = 0    at every sample s,
///
/// d_s the gap, which changes by n_s . sum_a w_sa du_a. The search for equilibrium sets the forces, see
/// MixedIteration. Their energy is zero.
///
/// Source:   Wriggers, Computational Contact Mechanics, 2006, chapters 4 and 5 (Lagrange multipliers).
class ContactTerm : public ForceTerm {
 public:
  virtual Index count() const = 0;                 ///< samples
  virtual const Interpolation& moves() const = 0;  ///< w
  /// Number of the pairing: it changes if moves() refers to other places, not if a foot moves a little.
  virtual int pairing() const { return 0; }
  /// contact_error or wall_error, as a length [m].
  virtual double error_at(Index s, const Instant& now) const = 0;

  /// Number of unknowns in the search for equilibrium: a normal force for each sample, then those of
  /// friction.
  virtual Index unknowns() const { return count(); }
  /// Sets the forces [unknowns] N.
  virtual void set_forces(const Eigen::VectorXd& unknowns) { force_ = unknowns; }
  /// Projects unknowns onto the admissible set: no tension, and friction within its bound.
  virtual void project_to_admissible(Eigen::Ref<Eigen::VectorXd> unknowns) const {
    unknowns = unknowns.cwiseMax(0.0);
  }

  /// Normal forces [M] N.
  const Eigen::VectorXd& forces() const { return force_; }
  /// Results of the last add_force(): [M] d_s [m], [3xM] n_s, unit vectors along which the forces act on the
  /// body.
  const Eigen::VectorXd& gaps() const { return gap_; }
  const Points& normals() const { return normal_; }

  double energy(const Nodal&, const Instant&) override { return 0.0; }

  /// Adds contact forces on the body to f [4xN] N with the sign of a resistance: [M] N along the normals of
  /// the last add_force(), and [3xM] N.
  void spread(const Eigen::VectorXd& force, Nodal& f) const;
  void spread(const Points& force, Nodal& f) const;

 protected:
  Eigen::VectorXd force_, gap_;
  Points normal_;
};

}  // namespace dimple
