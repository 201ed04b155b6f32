#pragma once

#include <algorithm>
#include <functional>

#include "solver/terms/fold_contact.hpp"
#include "solver/terms/force_term.hpp"
#include "solver/terms/internal_force.hpp"
#include "solver/terms/loads.hpp"
#include "solver/terms/tool_force.hpp"
#include "solver/terms/touching_tool.hpp"

namespace dimple {

/// How far the forces on a body are from equilibrium.
struct Balance {
  double unbalanced = 0.0;  ///< norm of the forces on what is free to move [N]
  /// Sum of the sizes of all reactions and of all loads and rigid contacts [N], of reactions the half: what
  /// the tool puts in comes out at the base again.
  double reactions = 0.0;
  double residual() const { return unbalanced / std::max(reactions, 1e-30); }
};

/// [J]; `hourglass`: the part of the tissue's in what averaged gradients leave out (GradientVariance);
/// `loads`: of all other forces, less what they had where the run began.
struct StoredEnergy {
  double tissue = 0.0, hourglass = 0.0, loads = 0.0;
  double sum() const { return tissue + loads; }
};

/// Displacements [4xN] m, their fourth row zero (a column is one vector of a processor); and lambda: the
/// pressure of each patch (neighbouring points that share one) times its volume [N m], see MixedIteration,
/// behind them the contact forces [N] as System::contacts() has them.
struct Rest {
  Nodal u;
  Eigen::VectorXd lambda;
};

/// Where a body rests under its loads before anything else moves it, and System::past() there.
struct Settled {
  Rest rest;
  std::vector<double> past;
};

/// A body in one run: its tissue, all other forces on it, and what is held of it. Every march, every search
/// for an equilibrium and every guard is given this, and asks nothing else for a force. f resists: where
/// there is an energy it is its derivative by the displacements, so that a load counts with the opposite
/// sign. It is zero on free nodes in equilibrium, on held ones the reaction.
///
///     f(u, now, lambda) = tissue(u, lambda) + terms(u, now) + contacts(u, now, lambda)
///
/// Terms are loads and membranes; lambda are pressures in the tissue, and forces of contacts.
class System {
 public:
  using Sweep = ForceSystem::Sweep;  ///< the worst point that was met: its J, and whether it is inverted
  /// `tissue` and `model` must outlive it. Of the `rigid` contacts one at most is measured.
  System(const ForceSystem& tissue, const Model& model, Constraints held, ForceTerms terms = {},
         std::vector<std::unique_ptr<TouchingTool>> rigid = {}, std::unique_ptr<FoldContact> folds = nullptr);

  const Model& model() const { return model_; }
  const Constraints& held() const { return held_; }
  ForceState& tissue() { return tissue_; }
  const ForceState& tissue() const { return tissue_; }
  const Tissues& tissues() const { return tissue_.system().tissues(); }
  bool viscoelastic() const { return tissue_.system().viscoelastic(); }
  bool loaded() const { return !terms_.empty(); }
  /// The measured tool, if it is one that touches, whether it does so now or not; null: it holds nodes.
  TouchingTool* touching() { return touching_; }
  const TouchingTool* touching() const { return touching_; }
  /// Takes from contact forces that were extrapolated what no contact could bear: see
  /// ContactTerm::bring_back().
  void bring_back(Eigen::VectorXd& lambda) const;
  /// What is rigid beside it: walls, and tools that are not measured.
  const std::vector<const TouchingTool*>& walls() const { return walls_; }
  /// Null: folds pass through each other.
  FoldContact* folds() { return folds_.get(); }
  const FoldContact* folds() const { return folds_.get(); }
  /// Each of these contacts, and where its unknowns stand in a search for equilibrium, behind the patches'
  /// pressures: first the tool that is measured, last the folds.
  struct OneContact {
    ContactTerm* term;
    TouchingTool* rigid;  ///< the same; null: folds
    Index first;          ///< counted from behind the pressures; every sample has its place, active or not
  };
  const std::vector<OneContact>& contacts() const { return contacts_; }
  Index contact_unknowns() const {
    return contacts_.empty() ? 0 : contacts_.back().first + contacts_.back().term->unknowns();
  }
  /// The samples of contacts whose forces are looked for. Most of a surface never meets anything: those that
  /// have at any state of any search, in the order of that. It only grows; all of the measured tool's are
  /// active from the start.
  struct ActiveSample {
    Index contact, sample;
  };
  const std::vector<ActiveSample>& active() const { return active_; }
  /// Adds the samples that the last force() found beyond what they face; a search does so as it goes.
  void activate_penetrating();
  /// Where the tool stands and which share of the loads acts: all of them once the tool moves.
  const Instant& now() const { return now_; }

  /// Tool and loads stand so from now on. {}: where the step of the scene begins.
  void set(const Instant& now) {
    now_ = now;
    if (pressure_around_ != 0.0) tissue_.press_around(now.share * pressure_around_);
  }
  /// The same, and puts what is held of u [4xN] m where it then is.
  void set(const Instant& now, Nodal& u);

  /// f [4xN] N at u [4xN] m: with the pressures and contact forces that force_at() was last given; where none
  /// were, pressures follow from the volumes, and nothing touches.
  Sweep force(const Nodal& u, Nodal& f);
  /// The same with those of `lambda`, see Rest. Of a scheme without patches these are contact forces alone.
  Sweep force_at(const Nodal& u, const Eigen::VectorXd& lambda, Nodal& f);
  /// Size of the sum of the forces in f that act within the body, which is nothing but for rounding [N].
  double spurious_resultant(const Nodal& f) const {
    const Eigen::Vector4d all = f.rowwise().sum();
    return load_.cols() > 0 ? (all - load_.rowwise().sum()).norm() : all.norm();
  }
  /// force() in two halves, for a caller that goes on with nodes [first, last) once their force is known.
  Sweep stress_sweep(const Nodal& u) { return tissue_.stress_sweep(u); }
  void gather(const Nodal& u, Nodal& f, const std::function<void(Index first, Index last)>& then);
  /// Of the last force(). `unbalanced` [4xN] N: what of it is not held. `beside(a, all)` may add to the force
  /// of node a: what slows it down, in a viscous step.
  template <class Beside>
  Balance balance(const Nodal& f, Nodal& unbalanced, const Beside& beside) const;
  Balance balance(const Nodal& f, Nodal& unbalanced) const {
    return balance(f, unbalanced, [](Index, Eigen::Vector4d&) {});
  }
  StoredEnergy stored_energy(const Nodal& u);
  /// Of terms alone, for preconditioners made of the tissue: from the rest shape, and [9xN] N/m of each node
  /// as the body is deformed, where a film stiffens.
  StiffnessBound stiffness_bound() const;
  NodeStiffness node_stiffness(const Nodal& u) const;
  /// [N] of the loads and rigid contacts at the last force() on node a.
  double load_on(Index a) const { return load_.cols() > 0 ? load_.col(a).norm() : 0.0; }
  /// Of the loads and rigid contacts at the last force(), times u [J].
  double load_times(const Nodal& u, Index a) const {
    return load_.cols() > 0 ? load_.col(a).dot(u.col(a)) : 0.0;
  }

  /// All of the force on the tool and its moment about its reference point.
  Wrench on_tool(const Nodal& u, const Nodal& f) const;
  /// Of the last force(): on the tool along its push, positive where tissue resists [N]; and what does work
  /// on the depth, of all that moves with the tool.
  double along_push(const Nodal& f) const;
  double working_force(const Nodal& f) const;

  /// A step in time of dt [s] begins; accept_step(u) ends it: viscous stresses and what friction has dragged
  /// along stay so.
  void begin_step(double dt) { tissue_.begin_step(dt); }
  void accept_step(const Nodal& u);
  /// All that these steps have left and u does not tell, and which samples are active.
  std::vector<double> past() const;
  void restore_past(std::vector<double> past);

  /// Where a step of a scene, or a run without steps, begins: undeformed, or as loads and earlier steps have
  /// it.
  const Rest& step_start() const { return step_start_; }
  /// Where the first of them began.
  const Rest& run_start() const { return run_start_; }
  /// The body rests so; what is held from now on is moved from there.
  void begin_at(Rest rest, Constraints held);
  /// A further step of a scene begins at `from`. `held` has its motion; `of_tool`: the shift and turn by
  /// which the steps before have left the tool, `of_walls`: the same of each of walls(); `travel_before` [m]:
  /// how far these steps went in all, by which friction knows whether anything has moved since.
  void go_on(Rest from, Constraints held, const RigidWay& of_tool, double travel_before,
             const std::vector<RigidWay>& of_walls);
  /// The forces f [4xN] N that a step begins with are the measure of its balance, down to a hundredth of
  /// them: a tool that comes back to where it touched leaves no reactions to compare with.
  void measure_by(const Nodal& f);
  double least_reactions() const { return least_reactions_; }
  void set_least_reactions(double least) { least_reactions_ = least; }
  /// Of its tip, from where it touched [m].
  Vec3 tool_displacement() const;
  /// What of it is across its push.
  Vec3 aside() const;
  /// By which rotation vector it has turned [rad].
  Vec3 turned() const;

 private:
  double energy_of_terms(const Nodal& u) const;

  const Model& model_;
  Constraints held_;
  ForceState tissue_;
  ForceTerms terms_;
  std::vector<std::unique_ptr<TouchingTool>> rigid_;
  std::unique_ptr<FoldContact> folds_;
  TouchingTool* touching_ = nullptr;        // of rigid_
  std::vector<const TouchingTool*> walls_;  // likewise
  std::vector<OneContact> contacts_;
  std::vector<ActiveSample> active_;
  std::vector<std::vector<char>> is_active_;  // of each contact's samples
  Instant now_;
  Nodal load_;  // [4xN] N of all loads and rigid contacts; no columns: there are none
  Rest step_start_, run_start_;
  RigidWay way_before_;           // shift and turn by which earlier steps left the tool; held_ has its motion
  double least_reactions_ = 0.0;  // N, for a balance
  double loads_at_rest_ = 0.0;    // J
  double pressure_around_ = 0.0;  // Pa, on all of the surface, which the tissue's pressures bear

  bool tissue_alone() const { return !loaded() && contacts_.empty(); }
  void add_terms(const Nodal& u, Nodal& f);
  void activate(const ActiveSample& one);
};

template <class Beside>
Balance System::balance(const Nodal& f, Nodal& unbalanced, const Beside& beside) const {
  Balance sum;
  for (Index a = 0; a < f.cols(); ++a) {
    Eigen::Vector4d all = f.col(a);
    beside(a, all);
    unbalanced.col(a) = held_.project(a, all);
    sum.unbalanced += unbalanced.col(a).squaredNorm();
    sum.reactions += 0.5 * (all - unbalanced.col(a)).norm() + load_on(a);
  }
  sum.unbalanced = std::sqrt(sum.unbalanced);
  sum.reactions = std::max(sum.reactions, least_reactions_);
  return sum;
}

/// A body under `loads`, come to rest, its circle (the nodes that the tool holds) where the tool then touches
/// it: bonded or not, and `further` sets held likewise; or `touch`: a tool that holds no nodes, and stands
/// apart until then. `folds` that close touch. `walls`: rigid contacts that are not measured. `settled`:
/// where this body rests under these loads beside these walls, if that was looked for before. Throws
/// SolveError: it does not carry its loads.
std::unique_ptr<System> make_system(const ForceSystem& tissue, const Model& model, Contact contact,
                                    const std::vector<HeldSet>& further, const Loads& loads = {},
                                    double tolerance = 1e-4, const Touch* touch = nullptr,
                                    std::shared_ptr<const FoldBanks> folds = nullptr,
                                    const std::vector<Touch>& walls = {}, const Settled* settled = nullptr);

}  // namespace dimple
