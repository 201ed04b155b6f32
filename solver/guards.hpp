#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/error.hpp"
#include "preprocess/model.hpp"
#include "solver/system.hpp"

namespace dimple {

// Guards of every run, one code each; apps/guide/files.md has their table. If the result would be wrong a
// guard throws, and the march restarts from its last good state with smaller steps. If it is less accurate
// than expected, the guard leaves a finding.

constexpr const char* tools_overlap = "tools-overlap";  // Report::code
constexpr const char* no_stress = "stress";             // likewise
/// det F below which the law gives no valid stress. At the edge of a bonded patch in brain of 210 Pa, 4000
/// nodes and 8 mm deep, von Mises stress was up to 420 kPa below it and at most 9.2 kPa above.
constexpr double least_J_of_stress = 0.2;
constexpr int most_retries = 3;  ///< after a guard, of one run or step of a scene

/// Finding of a guard in a run that can continue. `worst`: worst value of the number that it watches.
struct Finding {
  Report report;
  double worst = 0.0;
  bool is_minor = false;  ///< it changes the force by no more than the error bounds
};

/// Retry from the last good state.
struct Retry {
  std::string code;    ///< of the guard
  double depth = 0.0;  ///< at which it fired [m]
  std::string what;    ///< what is done differently
};

/// Time, depth and time step. [s], [m]; dt_stable 0: the march has no limit.
struct Moment {
  double t = 0.0, depth = 0.0, dt = 0.0, dt_stable = 0.0;
};

/// Energies at one time [J]; balance: external = kinetic + stored + dissipated.
struct EnergySample {
  double t, depth;
  double kinetic, stored, external, dissipated;
  double error() const { return external - (kinetic + stored + dissipated); }
};

/// Checks a model before any load: `conditioning`, `supports`, `bonded_patch-nodes`. The last is the error by
/// few nodes on the verification block (tests/verification), at `depth` [m]. Throws ModelError: gradients are
/// wrong.
std::vector<Finding> check_model(const Model& model, const SupportReport& support, double depth);

/// Present pose of a contacting tool.
struct ToolNow {
  const RigidBody& body;
  ToolPose pose;
};
/// Error if two rigid tools overlap (`tools-overlap`); empty if none do.
std::optional<Report> overlap_of_tools(const std::vector<ToolNow>& tools);

/// Watches one run: what it finds is kept in `findings`, one for each code.
class Guards {
 public:
  /// `static_answer`: inertia should be negligible. `on` false: only checks without cost; to measure the cost
  /// of the guards.
  Guards(System& system, bool static_answer, bool on, std::vector<Finding>& findings);

  /// Checks a sweep: `non-finite`, and `inverted` where the energy is undefined for inverted points. Costs
  /// nothing.
  void check_sweep(const ForceSystem::Sweep& sweep, const Moment& now) const;
  /// Checks every component of every node: `non-finite`; `inverted`, if the tool has passed the far side.
  void check_nodes(const ForceSystem::Nodal& u, const ForceSystem::Nodal& f, const Moment& now) const;
  /// Points after the last sweep, which must have been at an accepted state: `inverted`, `stress` of this
  /// state alone, `volume`.
  void check_points(const ForceSystem::Sweep& sweep, const Moment& now);
  /// `energy`, `kinetic`. `largest_external`: so far [J]. `conserves`: the march and the law neither make nor
  /// lose any. `warns_alone`: it does not throw.
  void check_energy(const EnergySample& e, double largest_external, double duration, bool conserves,
                    const Moment& now, bool warns_alone = false);
  /// Checks central differences: `energy`, without the stored energy, which is never negative.
  void check_kinetic(double kinetic, double external, const Moment& now) const;
  /// `hourglass`: the part of the stored energy in what averaged gradients do not see [J]; see
  /// GradientVariance.
  void check_hourglass(double hourglass, double stored, const Moment& now);
  static constexpr double most_penetration =
      1e-3;  ///< of the radius of a contacting tool: the largest penetration without a finding
  /// Relative error of the force by a penetration at a depth [m]: the force on a sphere grows as depth^1.5.
  static double off_by_penetration(double penetration, double depth) { return 1.4 * penetration / depth; }
  /// Checks a contacting tool: `penetration` by more than `most` [m] between samples; minor if it may change
  /// the force by a tenth or less. Throws SolveError: fifty times as much; or `contact-surface`: the tool
  /// meets surface without samples.
  void check_contact(const RigidContact::Audit& audit, double most, const RigidBody& body, const Moment& now);
  /// Throws SolveError: they overlap.
  void check_apart(const std::vector<ToolNow>& tools, const Moment& now) const;
  /// Checks a wall or a further tool (`wall-penetration`, `tool-penetration`): penetration between samples
  /// [m], compared with the node spacing for a wall, with the radius for a tool. Throws SolveError: a tool
  /// without contact at any sample is penetrated by as much as check_contact() throws for.
  void check_wall(const RigidBody& wall, double penetration, bool has_contact, const Moment& now);
  /// `hourglass` of gradients at points, without a variance term: energy of nodal displacements beyond the
  /// linear field with the gradient of their point,
  ///
  ///     sum_q V_q 3 mu/2 sum_a |u_a - mean u - H_q (X_a - mean X)|^2 / sum_a |X_a - mean X|^2
  ///
  /// over the stored energy, as Ganzenmueller 2015 measures it for particles. It takes two sweeps.
  void check_fluctuation(const ForceSystem::Nodal& u, const Moment& now);
  /// Checks `force` [N] at the samples since the last output frame, under central differences: `jagged`, if
  /// it jumps from sample to sample although the load is slow enough for a static answer.
  void check_smooth(const std::vector<double>& force, double largest, double duration, const Moment& now);
  /// `limit-point`: the tissue passed a limit point at a held load and came to rest `jump` [m] from the
  /// predicted state, by more than the tool's motion `distance` [m]. A shorter jump leaves the curve
  /// unchanged; tissue at first contact moves as far. The first one stays.
  void found_limit_point(const ForceSystem::Nodal& jump, double distance, bool folds_make_contact,
                         const Moment& now);
  /// `tool-left`: contact is lost after a motion by `distance` [m], and the tissue sprang back by `jump` [m],
  /// more than that. The first one stays.
  void found_lost_contact(const ForceSystem::Nodal& jump, double distance, const Moment& now);
  /// `time-step`.
  void check_step(const Moment& now) const;

 private:
  ForceState& forces_;
  const Model& model_;
  bool static_answer_, on_;
  std::vector<Finding>& findings_;
  double beneath_;  // distance from the bonded patch to the far side [m]

  void find(Finding finding);
  /// The load lasts long enough for a static answer, and its beginning is over.
  bool should_be_static(const Moment& now, double duration) const;
};

/// "node 7 at rest at (1.00, 2.00, 3.00) mm".
std::string place_of(const Model& model, Index node);

/// Error after the last retry: it adds that the guard fired again after `most_retries`, with `what`.
SolveError after_retries(const SolveError& error, const std::string& what);

}  // namespace dimple
