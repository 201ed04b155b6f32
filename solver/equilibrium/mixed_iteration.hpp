#pragma once

#include <chrono>
#include <memory>

#include "solver/system.hpp"

namespace dimple {

struct RelaxOptions {
  double tolerance = 1e-4;          ///< unbalanced force / reactions
  std::int64_t evaluations = 2000;  ///< of the force, at most
  /// Stop before an evaluation that is predicted to end later than this (1.5 x the recent mean).
  std::chrono::steady_clock::time_point until = std::chrono::steady_clock::time_point::max();
  /// Relaxation only: a contacting tool may lose contact, and the body is then at rest.
  bool allow_separation = false;
};

struct Relaxed {
  std::int64_t evaluations = 0;
  double residual =
      0.0;  ///< norm of the unbalanced forces / (half the sum of all reactions' sizes + external forces)
  ForceSystem::Sweep sweep;
  bool converged = true;
  /// Results of viscous steps, see Relaxation: least du.K du / du.A du, K the tangent, A as in
  /// MixedIteration; the dissipated energy [J]; and the node that moved most.
  double curvature = 1.0;
  double dissipated = 0.0;
  Index furthest = -1;
  bool lost_contact = false;  ///< the tool has left the body, see RelaxOptions::allow_separation
  /// K is positive under a load that the tissue can bear.
  bool passed_limit_point() const { return curvature < -1e-4; }
};

/// Finds static equilibrium of the converging scheme with displacements u and patch pressures p as unknowns:
/// forces f_local(u) + G lambda = 0, with all of a System's other forces in f, and
/// volumes J_b(u) - 1 = p_b / bulk_b, with lambda_b = V_b p_b and G = dJ_b/du. Each iteration solves the
/// nearby linear problem
///
///     [ A   G ] [ du      ]     [ f             ]
///     [ G'  -1/(bulk V)   ] [ dlambda ] = - [ J - 1 - p/bulk  ]
///
/// where A is a Laplacian of the graph of neighbouring nodes (LaplacePreconditioner), and G'A^-1 G is
/// replaced by the patches' mass matrix / mu (PressureSchur). Anderson's acceleration makes up for what these
/// leave out. The number of evaluations, some ten for a depth, depends neither on the number of nodes nor on
/// the bulk modulus.
///
/// The forces of a contacting tool (RigidContact) are further unknowns, after the pressures in `lambda`. Each
/// iteration then solves the same problem with the condition that forces and gaps at the samples are not
/// negative (ContactCoupling).
///
/// At large strains the tangent is stiffer than A by orders of magnitude. A failed iteration is repeated with
/// an A as stiff at each node as the law is at the best state.
///
/// Source:   Elman, Silvester, Wathen, Finite Elements and Fast Iterative Solvers, 2014, chapter 4 (Schur
///           complement by the pressure's mass matrix); Walker and Ni 2011 (Anderson's acceleration).
/// Departs:  both are applied to finite strains, with contact forces as further unknowns.
class MixedIteration {
 public:
  explicit MixedIteration(System& system);
  ~MixedIteration();

  /// Viscous force of a step: `fraction` x A (u - about) [N], A at rest; [N] m.
  struct Viscosity {
    double fraction;
    ForceSystem::Nodal about;
  };
  /// Searches for an equilibrium from the guess `u` and `lambda` [patches, samples] N m, N: pressures x
  /// volumes, then contact forces. Both receive the result, or the best state if not converged. The pressures
  /// stay held in `forces`. `reassemble`: dJ/du is found at the guess, as larger moves need; otherwise that
  /// of the last such call serves.
  Relaxed operator()(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                     const RelaxOptions& options, bool reassemble, const Viscosity* viscosity = nullptr);

  /// Remainders at the best state.
  struct Residual {
    ForceSystem::Nodal force;  ///< [N] N, of what is free to move
    Eigen::VectorXd volume;    ///< [patches] J - 1 - p / bulk
    double contact = 0.0;      ///< largest contact error, of the depth
    bool late = false;         ///< RelaxOptions::until ended it
    double energy = 0.0;       ///< estimate of the remaining motion: force.A^-1 force, and of volumes [J]
  };
  /// Searches as above, in one try. If a limit ends it, `u`, `lambda`, `f` and `left` are those of the best
  /// state.
  Relaxed within(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                 const RelaxOptions& options, bool reassemble, Residual& left);

  /// v.A v, A as it is at rest [J].
  double laplacian_of(const ForceSystem::Nodal& v) const;

  /// True if the model has pressure patches, and bulk moduli that act on them.
  static bool serves(const ForceSystem& system, const Model& model);
  static bool serves(const std::vector<Material>& tissues);  ///< true if these bulk moduli suffice

 private:
  bool prepare(const ForceSystem::Nodal& u, const Eigen::VectorXd& bulk, bool reassemble,
               const Viscosity* viscosity);
  Relaxed iterate(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                  const RelaxOptions& options, bool reassemble, const Viscosity* viscosity,
                  Residual* left = nullptr);
  struct Parts;
  struct Search;
  std::unique_ptr<Parts> parts_;
};

/// [patches] N m, what MixedIteration calls lambda, as the volumes of the last sweep make it.
Eigen::VectorXd pressures_of_volumes(const System& system);

}  // namespace dimple
