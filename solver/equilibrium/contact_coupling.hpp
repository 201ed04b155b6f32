#pragma once

#include "solver/equilibrium/laplace_preconditioner.hpp"
#include "solver/system.hpp"

namespace dimple {

/// The contact forces of the mixed iteration, normal ones and friction, at the active samples of a System.
/// Each step solves the nearby linear problem in which a force at one sample moves another by
///
///     C_st = w_s A^-1 w_t   [m/N],   w the weights with which a sample's gap follows the nodes,
///
/// A^-1 from LaplacePreconditioner. Contact is without penetration, see contact_step(); friction follows
/// Coulomb's law, see friction_step(). The compliance C grows with the active samples, up to
/// MixedConstants::most_contact_points.
class ContactCoupling {
 public:
  /// Both must outlive it. Nothing is in contact yet.
  ContactCoupling(System& body, LaplacePreconditioner& laplace);

  /// Forgets the compliance, as A has changed.
  void forget() { compliance_.resize(0, 0); }
  /// Adds the samples that the last force found to penetrate. Throws SolveError: there are more than
  /// MixedConstants::most_contact_points.
  void extend();
  /// True if no sample has a compliance.
  bool empty() const { return compliance_.rows() == 0; }
  /// [active x active] m/N, in the order of System::active().
  const Eigen::MatrixXd& compliance() const { return compliance_; }

  /// `change` [System::contact_unknowns()] N: change of all contact forces, for nodes that would move by du
  /// [4xN] m without it. Adds these forces to r [4xN] N. `gap_factor` multiplies gaps and slips, for an A as
  /// much stiffer.
  void apply(double gap_factor, const Nodal& du, Nodal& r, Eigen::Ref<Eigen::VectorXd> change) const;

  /// Residual of the last force with contact errors. Penetration and missing forces count alike: otherwise
  /// the first contact forces, which unbalance the body, would look like a wrong step. `reactions` [N];
  /// `tolerance`: that of the residual.
  double residual_with_contact(double residual, double reactions, double tolerance) const;
  /// Contact error of the measured tool at the last force, relative to the admissible one.
  double contact_violation() const;

  /// [System::contact_unknowns()] that make contact forces square roots of energies: sqrt(C_ss) of active
  /// samples, 1 elsewhere.
  Eigen::VectorXd scale() const;

 private:
  // A sample of one contact: its row in the compliance, and its number in that contact.
  struct Sample {
    Index row, number;
  };
  // Error of one contact at the last force.
  struct Lack {
    double largest = 0.0;  // relative to the admissible error
    double force = 0.0;    // that would close the gaps [N]
  };

  const System::ActiveSample& active(Index row) const {
    return body_.active()[static_cast<std::size_t>(row)];
  }
  const System::OneContact& contact_of(Index row) const {
    return body_.contacts()[static_cast<std::size_t>(active(row).contact)];
  }
  Index unknown_of(Index row) const { return contact_of(row).first + active(row).sample; }
  template <class Visit>
  void visit_nodes(Index row, const Visit& visit) const;
  std::vector<Sample> samples_of(const ContactTerm* term) const;

  void find_columns(Index known);
  void mirror_columns(Index known);
  double lack_of_friction(const RigidContact& rigid, const Sample& one) const;
  Lack lack_of(const System::OneContact& one) const;
  double with_tool(double residual, const Lack& lack, double reactions, double tolerance) const;
  Eigen::VectorXd normal_forces(double gap_factor, const Nodal& du, Points& normal) const;
  Vec3 displacement(Index row, const Eigen::VectorXd& of_normals, const Points& normal,
                    const Nodal& du) const;
  Points friction(const RigidContact& rigid, const Eigen::VectorXd& of_normals, const Points& normal,
                  double gap_factor, const Nodal& du) const;

  System& body_;
  LaplacePreconditioner& laplace_;
  int pairings_ = 0;  // sum of ContactTerm::pairing() of all contacts, for which the compliance was found
  Eigen::MatrixXd compliance_;
};

}  // namespace dimple
