#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/error.hpp"
#include "preprocess/model.hpp"
#include "solver/system.hpp"

namespace dimple {

// What every run watches for, one code each; apps/guide/files.md has their table. Where the number would
// be wrong a guard throws, and the march takes up its last good state again, more carefully; where it is
// honest but less good than one might think it leaves a finding.

constexpr const char* tools_overlap = "tools-overlap";  // Report::code
constexpr const char* no_stress = "stress";             // likewise
/// det F below which what the law says is no stress. At the rim of a circle in brain of 210 Pa, 4000 nodes
/// and 8 mm deep, von Mises stress was up to 420 kPa below it and at most 9.2 kPa above.
constexpr double least_J_of_stress = 0.2;
constexpr int most_retries = 3;  ///< that a guard asks for, of one run or step of a scene

/// A guard that fired where the run could go on. `worst`: the number that it watches, at its worst.
struct Finding {
  Report report;
  double worst = 0.0;
  bool is_minor = false;  ///< it changes the force by no more than the error bounds hold
};

/// The last good state was taken up again.
struct Retry {
  std::string code;    ///< of the guard
  double depth = 0.0;  ///< at which it fired [m]
  std::string what;    ///< what is done differently
};

/// When and with which step. [s], [m]; dt_stable 0: the march has no limit.
struct Moment {
  double t = 0.0, depth = 0.0, dt = 0.0, dt_stable = 0.0;
};

/// Energies at one time [J]; balance: external = kinetic + stored + dissipated.
struct EnergySample {
  double t, depth;
  double kinetic, stored, external, dissipated;
  double error() const { return external - (kinetic + stored + dissipated); }
};

/// Before any load: `conditioning`, `supports`, `circle-nodes`. The last is by what few nodes cost on the
/// verification block, whose force is known (tests/verification), at `depth` [m]. Throws ModelError where
/// gradients are wrong.
std::vector<Finding> check_model(const Model& model, const SupportReport& support, double depth);

/// Where a tool that touches is.
struct ToolNow {
  const Touch& touch;
  ToolPose pose;
};
/// Why rigid tools cannot stand so (`tools-overlap`): some place lies in two of them. Nothing: none does.
std::optional<Report> overlap_of_tools(const std::vector<ToolNow>& tools);

/// Watches one run: what it finds is kept in `findings`, one for each code.
class Guards {
 public:
  /// `static_answer`: inertia should play no part. `on` false: only what costs nothing; to measure what
  /// guards cost.
  Guards(System& system, bool static_answer, bool on, std::vector<Finding>& findings);

  /// Of a sweep: `non-finite`, and `inverted` where the energy has no meaning there. Costs nothing.
  void check_sweep(const ForceSystem::Sweep& sweep, const Moment& now) const;
  /// Every component of every node: `non-finite`; and `inverted`, where the tool has come out of the body.
  void check_nodes(const ForceSystem::Nodal& u, const ForceSystem::Nodal& f, const Moment& now) const;
  /// Points after the last sweep, which must have been at an accepted state: `inverted`, `stress` of this
  /// state alone, `volume`.
  void check_points(const ForceSystem::Sweep& sweep, const Moment& now);
  /// `energy`, `kinetic`. `largest_external`: so far [J]. `conserves`: the march and the law neither make nor
  /// lose any. `warns_alone`: it does not throw.
  void check_energy(const EnergySample& e, double largest_external, double duration, bool conserves,
                    const Moment& now, bool warns_alone = false);
  /// Of central differences: `energy`, without the stored energy, which is never negative.
  void check_kinetic(double kinetic, double external, const Moment& now) const;
  /// `hourglass`: the part of the stored energy in what averaged gradients do not see [J]; see
  /// GradientVariance.
  void check_hourglass(double hourglass, double stored, const Moment& now);
  static constexpr double most_penetration =
      1e-3;  ///< of the radius of a tool that touches, until it is told
  /// What the force may be off by, as a part of it, where the surface of a body reaches so far into a tool
  /// that has come so deep [m]: a sphere's force grows as its depth^1.5.
  static double off_by_penetration(double penetration, double depth) { return 1.4 * penetration / depth; }
  /// Of a tool that touches: `penetration`, where the surface reaches into it by more than `most` [m] between
  /// the places where contact is enforced; minor, where that may change the force by a tenth or less. Throws
  /// SolveError: by fifty times as much; or `contact-surface`:
  /// it has come to a part of the surface that has no samples.
  void check_contact(const TouchingTool::Audit& audit, double most, const Touch& touch, const Moment& now);
  /// Throws SolveError: they overlap.
  void check_apart(const std::vector<ToolNow>& tools, const Moment& now) const;
  /// Of a wall or a further tool (`wall-penetration`, `tool-penetration`): how deep the body's surface is in
  /// it between the places where contact is looked for [m]; nodes are as far apart there as its samples.
  /// Throws SolveError: of a tool, by as much as check_contact() throws for, and it touches at no sample.
  void check_wall(const Touch& wall, double penetration, bool touches, const Moment& now);
  /// `hourglass` of gradients at points, where nothing holds it: what the displacements of each point's nodes
  /// differ from the linear field with the point's gradient,
  ///
  ///     sum_q V_q 3 mu/2 sum_a |u_a - mean u - H_q (X_a - mean X)|^2 / sum_a |X_a - mean X|^2
  ///
  /// beside the stored energy. As Ganzenmueller 2015 measures it for particles. It takes two sweeps.
  void check_fluctuation(const ForceSystem::Nodal& u, const Moment& now);
  /// Of central differences, `force` [N] at the samples since the last frame: `jagged`, where a load slow
  /// enough for a static answer makes it jump from one to the next.
  void check_smooth(const std::vector<double>& force, double largest, double duration, const Moment& now);
  /// `limit-point`: the tissue gave way at a held load and came to rest elsewhere, `jump` [m] from where the
  /// path would have led, the tool having moved by `way` [m], by more than that: a shorter jump leaves the
  /// curve as it is, and the tissue under a tool that first touches moves as far. The first one stays.
  void found_limit_point(const ForceSystem::Nodal& jump, double way, bool folds_touch, const Moment& now);
  /// `tool-left`: the tool, having moved by `way` [m], touches nothing, and the tissue sprang back by `jump`
  /// [m], by more than that. The first one stays.
  void found_lost_contact(const ForceSystem::Nodal& jump, double way, const Moment& now);
  /// `time-step`.
  void check_step(const Moment& now) const;

 private:
  ForceState& forces_;
  const Model& model_;
  bool static_answer_, on_;
  std::vector<Finding>& findings_;
  double beneath_;  // the circle, as far as the body reaches [m]

  void find(Finding finding);
  /// The load lasts long enough for a static answer, and its beginning is over.
  bool should_rest(const Moment& now, double duration) const;
};

/// "node 7 at rest at (1.00, 2.00, 3.00) mm".
std::string place_of(const Model& model, Index node);

/// What a message says at last: that it came again after `most_retries`, whatever was done.
SolveError after_retries(const SolveError& error, const std::string& what);

}  // namespace dimple
