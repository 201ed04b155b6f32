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
  /// Of Relaxation: a tool that touches may leave the body, which is then at rest.
  bool may_lose_contact = false;
};

struct Relaxed {
  std::int64_t evaluations = 0;
  double residual =
      0.0;  ///< norm of the unbalanced forces / (half the sum of all reactions' sizes + external forces)
  ForceSystem::Sweep sweep;
  bool converged = true;
  /// Of a motion at a held load, see Relaxation: the least du.K du / du.A du, K the tangent, A as in
  /// MixedIteration; the energy that went with it [J]; and the node that moved most.
  double curvature = 1.0;
  double dissipated = 0.0;
  Index furthest = -1;
  bool lost_contact = false;  ///< the tool has left the body, see RelaxOptions::may_lose_contact
  /// Under a load that the tissue can bear K is positive.
  bool gave_way() const { return curvature < -1e-4; }
};

/// Finds static equilibrium of the converging scheme by looking for displacements u and the patches'
/// pressures p together: forces f_local(u) + G lambda = 0, with all of a System's other forces in f, and
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
/// The contact forces of a tool that touches (TouchingTool) are unknowns like the pressures, behind them in
/// `lambda`. Each iteration then solves the same nearby linear problem with the condition that forces at the
/// samples are not negative and gaps neither (ContactCoupling).
///
/// Where strains are large the tangent is stiffer than A by orders of magnitude. An iteration that fails is
/// tried again with an A as stiff at each node as the law is at the best state that was met.
///
/// Source:   Elman, Silvester, Wathen, Finite Elements and Fast Iterative Solvers, 2014, chapter 4 (Schur
/// complement by the pressure's mass matrix); Walker and Ni 2011 (Anderson's acceleration).
class MixedIteration {
 public:
  explicit MixedIteration(System& system);
  ~MixedIteration();

  /// Of a step that viscous forces slow down: share x A (u - about) [N] besides, A as it is at rest; [N] m.
  struct Viscosity {
    double share;
    ForceSystem::Nodal about;
  };
  /// As Relaxation; `lambda` [patches, samples] N m, N is the guess of the pressures x volumes and of the
  /// contact forces, and afterwards what was found: not converged, the best that was met. The pressures stay
  /// held in `forces`. `anew`: dJ/du is that at the guess, as every larger move needs, and not that at the
  /// last such call.
  Relaxed operator()(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                     const RelaxOptions& options, bool anew, const Viscosity* viscosity = nullptr);

  /// What is left unbalanced at the best state that was met.
  struct Left {
    ForceSystem::Nodal force;  ///< [N] N, of what is free to move
    Eigen::VectorXd volume;    ///< [patches] J - 1 - p / bulk
    double contact = 0.0;      ///< what contact lacks at most, of the depth
    bool late = false;         ///< RelaxOptions::until ended it
    double energy = 0.0;       ///< about that of the way which is left: force.A^-1 force, and of volumes [J]
  };
  /// As above in one try. Where it ends by a limit, `u`, `lambda`, `f` and `left` are
  /// those of the best state that was met.
  Relaxed within(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                 const RelaxOptions& options, bool anew, Left& left);

  /// v.A v, A as it is at rest [J].
  double laplacian_of(const ForceSystem::Nodal& v) const;

  /// Whether this model has what is needed: patches, each with a bulk modulus of its own.
  static bool serves(const ForceSystem& system, const Model& model);
  static bool serves(const std::vector<Material>& tissues);  ///< whether they have

 private:
  bool prepare(const ForceSystem::Nodal& u, const Eigen::VectorXd& bulk, bool anew,
               const Viscosity* viscosity);
  Relaxed iterate(ForceSystem::Nodal& u, Eigen::VectorXd& lambda, ForceSystem::Nodal& f,
                  const RelaxOptions& options, bool anew, const Viscosity* viscosity, Left* left = nullptr);
  struct Parts;
  struct Search;
  std::unique_ptr<Parts> parts_;
};

/// [patches] N m, what MixedIteration calls lambda, as the volumes of the last sweep make it.
Eigen::VectorXd pressures_of_volumes(const System& system);

}  // namespace dimple
