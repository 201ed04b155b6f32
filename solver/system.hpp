#pragma once

#include <algorithm>
#include <functional>

#include "solver/terms/fold_contact.hpp"
#include "solver/terms/force_term.hpp"
#include "solver/terms/internal_force.hpp"
#include "solver/terms/loads.hpp"
#include "solver/terms/rigid_contact.hpp"
#include "solver/terms/tool_force.hpp"

namespace dimple {

/// Distance of the forces on a body from equilibrium.
struct Balance {
  double unbalanced = 0.0;  ///< norm of the forces on what is free to move [N]
  /// Half the sum of the sizes of all reactions, plus those of all loads and rigid contacts [N]; half, since
  /// the base bears what the tool applies.
  double reactions = 0.0;
  double residual() const { return unbalanced / std::max(reactions, 1e-30); }
};

/// Energies [J]; `hourglass`: part of the tissue's that averaged gradients leave out (GradientVariance);
/// `loads`: of all other forces, less that at the beginning of the run.
struct StoredEnergy {
  double tissue = 0.0, hourglass = 0.0, loads = 0.0;
  double sum() const { return tissue + loads; }
};

/// Displacements [4xN] m, their fourth row zero for vector registers; and lambda: pressure of each patch
/// times its volume [N m], see MixedIteration, then the contact forces [N] of System::contacts().
struct EquilibriumState {
  Nodal u;
  Eigen::VectorXd lambda;
};

/// Equilibrium under the loads alone, and System::past() there.
struct PreloadedState {
  EquilibriumState state;
  std::vector<double> past;
};

/// Body in one run: its tissue, all other forces, and its constraints. Marches, searches and guards take all
/// forces from it. f resists: it is the derivative of an energy by the displacements where there is one, so
/// that a load counts with the opposite sign. In equilibrium it is zero on free nodes and the reaction on
/// held ones.
///
///     f(u, now, lambda) = tissue(u, lambda) + terms(u, now) + contacts(u, now, lambda)
///
/// Terms are loads and membranes; lambda are pressures in the tissue, and forces of contacts.
class System {
 public:
  using Sweep = ForceSystem::Sweep;  ///< the worst point: its J, and whether it is inverted
  /// `tissue` and `model` must outlive it. At most one of the `rigid` contacts is measured.
  System(const ForceSystem& tissue, const Model& model, Constraints held, ForceTerms terms = {},
         std::vector<std::unique_ptr<RigidContact>> rigid = {}, std::unique_ptr<FoldContact> folds = nullptr);

  const Model& model() const { return model_; }
  const Constraints& held() const { return held_; }
  ForceState& tissue() { return tissue_; }
  const ForceState& tissue() const { return tissue_; }
  const Tissues& tissues() const { return tissue_.system().tissues(); }
  bool viscoelastic() const { return tissue_.system().viscoelastic(); }
  bool loaded() const { return !terms_.empty(); }
  /// The measured tool, if it is a contacting one, in contact or not; null: bonded patch.
  RigidContact* tool_contact() { return tool_contact_; }
  const RigidContact* tool_contact() const { return tool_contact_; }
  /// Projects extrapolated contact forces onto the admissible set: see ContactTerm::project_to_admissible().
  void project_to_admissible(Eigen::VectorXd& lambda) const;
  /// Rigid contacts other than the measured tool: walls, and tools that are not measured.
  const std::vector<const RigidContact*>& walls() const { return walls_; }
  /// Null: folds overlap.
  FoldContact* folds() { return folds_.get(); }
  const FoldContact* folds() const { return folds_.get(); }
  /// Each contact, and the place of its unknowns after the patch pressures: first the measured tool, last the
  /// folds.
  struct OneContact {
    ContactTerm* term;
    RigidContact* rigid;  ///< the same; null: folds
    Index first;          ///< counted after the pressures; every sample has a place, active or not
  };
  const std::vector<OneContact>& contacts() const { return contacts_; }
  Index contact_unknowns() const {
    return contacts_.empty() ? 0 : contacts_.back().first + contacts_.back().term->unknowns();
  }
  /// Samples of contacts whose forces are unknowns: those that have penetrated in any search, in that order,
  /// since most of a surface never comes into contact. The list only grows; all of the measured tool's are
  /// active from the start.
  struct ActiveSample {
    Index contact, sample;
  };
  const std::vector<ActiveSample>& active() const { return active_; }
  /// Activates the samples that penetrated at the last force(); a search does so at each step.
  void activate_penetrating();
  /// Position of the tool and fraction of the loads; the fraction is 1 once the tool moves.
  const Instant& now() const { return now_; }

  /// Sets tool and loads. {}: the beginning of the scene's step.
  void set(const Instant& now) {
    now_ = now;
    if (pressure_around_ != 0.0) tissue_.press_around(now.fraction * pressure_around_);
  }
  /// Sets `now` as above and puts the held nodes of u [4xN] m to their prescribed positions.
  void set(const Instant& now, Nodal& u);

  /// f [4xN] N at u [4xN] m, with the pressures and contact forces of the last force_at(); without one,
  /// pressures follow from the volumes, and there is no contact.
  Sweep force(const Nodal& u, Nodal& f);
  /// Force with the pressures and contact forces of `lambda`, see EquilibriumState; without patches these are
  /// contact forces alone.
  Sweep force_at(const Nodal& u, const Eigen::VectorXd& lambda, Nodal& f);
  /// Size of the sum of the forces in f that act within the body, zero but for rounding [N].
  double spurious_resultant(const Nodal& f) const {
    const Eigen::Vector4d all = f.rowwise().sum();
    return load_.cols() > 0 ? (all - load_.rowwise().sum()).norm() : all.norm();
  }
  /// force() in two halves, for a caller that does more with nodes [first, last) once their force is known.
  Sweep stress_sweep(const Nodal& u) { return tissue_.stress_sweep(u); }
  void gather(const Nodal& u, Nodal& f, const std::function<void(Index first, Index last)>& then);
  /// Balance at the last force(). `unbalanced` [4xN] N: the force components that are not held. `added(a,
  /// all)` may add a viscous force to that of node a.
  template <class Added>
  Balance balance(const Nodal& f, Nodal& unbalanced, const Added& added) const;
  Balance balance(const Nodal& f, Nodal& unbalanced) const {
    return balance(f, unbalanced, [](Index, Eigen::Vector4d&) {});
  }
  StoredEnergy stored_energy(const Nodal& u);
  /// Stiffness of the terms alone, for preconditioners of the tissue: a bound at rest, and [9xN] N/m of each
  /// node at u, where a membrane stiffens.
  StiffnessBound stiffness_bound() const;
  NodeStiffness node_stiffness(const Nodal& u) const;
  /// Size of the loads and rigid contacts on node a at the last force() [N].
  double load_on(Index a) const { return load_.cols() > 0 ? load_.col(a).norm() : 0.0; }
  /// Work of the loads and rigid contacts at the last force() on node a over its displacement [J].
  double load_times(const Nodal& u, Index a) const {
    return load_.cols() > 0 ? load_.col(a).dot(u.col(a)) : 0.0;
  }

  /// Total force on the tool and its moment about its reference point.
  Wrench on_tool(const Nodal& u, const Nodal& f) const;
  /// Force on the tool at the last force(), along the press direction, positive where tissue resists [N]; and
  /// the force that does work on the depth, of everything that moves with the tool.
  double along_approach(const Nodal& f) const;
  double force_along_motion(const Nodal& f) const;

  /// Begins a time step of dt [s]; accept_step(u) ends it: viscous stresses and friction anchors become
  /// permanent.
  void begin_step(double dt) { tissue_.begin_step(dt); }
  void accept_step(const Nodal& u);
  /// History of accepted steps that u does not contain, and the active samples.
  std::vector<double> past() const;
  void restore_past(std::vector<double> past);

  /// State at the beginning of a step of a scene, or of a run without steps: undeformed, or under the loads
  /// and earlier steps.
  const EquilibriumState& step_start() const { return step_start_; }
  /// State at the beginning of the run.
  const EquilibriumState& run_start() const { return run_start_; }
  /// Sets the equilibrium at which the motion of `held` begins.
  void set_reference_state(EquilibriumState state, Constraints held);
  /// Begins a further step of a scene at `from`. `held` has its motion; `of_tool`: displacement and rotation
  /// of the tool by the steps before, `of_walls`: those of each of walls(); `travel_before` [m]: total path
  /// of these steps, by which friction detects motion.
  void begin_scene_step(EquilibriumState from, Constraints held, const RigidMotion& of_tool,
                        double travel_before, const std::vector<RigidMotion>& of_walls);
  /// Makes 1 % of the reactions in f [4xN] N, at the beginning of a step, the least of its balance: a tool
  /// that comes back to first contact leaves none to compare with.
  void set_residual_scale(const Nodal& f);
  double least_reactions() const { return least_reactions_; }
  void set_least_reactions(double least) { least_reactions_ = least; }
  /// Displacement of the tip since first contact [m].
  Vec3 tool_displacement() const;
  /// Its component across the press direction.
  Vec3 aside() const;
  /// Rotation vector of the tool [rad].
  Vec3 turned() const;

 private:
  double energy_of_terms(const Nodal& u) const;

  const Model& model_;
  Constraints held_;
  ForceState tissue_;
  ForceTerms terms_;
  std::vector<std::unique_ptr<RigidContact>> rigid_;
  std::unique_ptr<FoldContact> folds_;
  RigidContact* tool_contact_ = nullptr;    // of rigid_
  std::vector<const RigidContact*> walls_;  // likewise
  std::vector<OneContact> contacts_;
  std::vector<ActiveSample> active_;
  std::vector<std::vector<char>> is_active_;  // of each contact's samples
  Instant now_;
  Nodal load_;  // [4xN] N of all loads and rigid contacts; no columns: there are none
  EquilibriumState step_start_, run_start_;
  RigidMotion motion_before_;     // displacement and rotation by earlier steps; held_ has the motion
  double least_reactions_ = 0.0;  // N, for a balance
  double loads_at_start_ = 0.0;   // J
  double pressure_around_ = 0.0;  // Pa, on the entire surface; the tissue's pressures bear it

  bool tissue_alone() const { return !loaded() && contacts_.empty(); }
  void add_terms(const Nodal& u, Nodal& f);
  void activate(const ActiveSample& one);
};

template <class Added>
Balance System::balance(const Nodal& f, Nodal& unbalanced, const Added& added) const {
  Balance sum;
  for (Index a = 0; a < f.cols(); ++a) {
    Eigen::Vector4d all = f.col(a);
    added(a, all);
    unbalanced.col(a) = held_.project(a, all);
    sum.unbalanced += unbalanced.col(a).squaredNorm();
    sum.reactions += 0.5 * (all - unbalanced.col(a)).norm() + load_on(a);
  }
  sum.unbalanced = std::sqrt(sum.unbalanced);
  sum.reactions = std::max(sum.reactions, least_reactions_);
  return sum;
}

/// Body in equilibrium under `loads`, its bonded patch where the tool then meets it, held as `contact` says,
/// and `further` sets; or with `indenter`, a tool that holds no nodes and stays apart until then. `folds` are
/// in contact where they close. `walls`: rigid contacts that are not measured. `preloaded`: this equilibrium,
/// if already computed. Throws SolveError: the body does not carry its loads.
std::unique_ptr<System> make_system(const ForceSystem& tissue, const Model& model, Contact contact,
                                    const std::vector<HeldSet>& further, const Loads& loads = {},
                                    double tolerance = 1e-4, const RigidBody* indenter = nullptr,
                                    std::shared_ptr<const FoldFaces> folds = nullptr,
                                    const std::vector<RigidBody>& walls = {},
                                    const PreloadedState* preloaded = nullptr);

}  // namespace dimple
