#pragma once

// Data of both marches, explicit.hpp and quasi_static.hpp; solve() chooses one.

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/guards.hpp"
#include "solver/march/predictor.hpp"
#include "solver/system.hpp"

namespace dimple {

/// Step of a scene: one object moves along a straight path at constant speed, all others stay fixed. A
/// contacting tool may also rotate. If nothing moves, viscoelastic tissue relaxes.
struct Step {
  std::string name;
  std::string moves;                 ///< the tool (empty), or the name of a further set
  Vec3 displacement = Vec3::Zero();  ///< [m]
  Vec3 turn = Vec3::Zero();          ///< rotation vector [rad]
  std::optional<Vec3> about = {};    ///< centre of rotation [m]; nothing: the tip as the step begins
  double lever = 0.0;                ///< path length of 1 rad [m]; of a hold its length()
  double duration = 0.0;             ///< [s]; 0: by its length at the loading's rate
  bool turns() const { return !turn.isZero(0.0); }
  bool holds() const { return !turns() && displacement.isZero(0.0); }
  /// Path length of the step, by which the march measures its progress [m].
  double length() const {
    if (holds()) return lever;
    return turns() ? std::hypot(displacement.norm(), lever * turn.norm()) : displacement.norm();
  }
  double rate(double of_loading) const {
    return duration > 0.0 ? length() / duration : of_loading;
  }  ///< [m/s]
  double seconds(double rate_of_loading) const { return length() / rate(rate_of_loading); }
};

/// State of a scene at the beginning of a step.
struct StepStart {
  double t = 0.0, depth = 0.0;    ///< [s]; [m] along the press direction
  bool holds = false;             ///< nothing moves in this step
  double depth_per_travel = 1.0;  ///< change of the tool's depth per metre of the path
  RigidMotion of_tool = {};       ///< a rotation also moves its tip along `approach`
  Vec3 approach = Vec3::Zero();
  int frame = 0;
  std::int64_t evaluations = 0;  ///< largest number that earlier steps may have used
};

/// Motion of the tool: straight at constant speed from first contact to `depth`, or in steps.
struct Loading {
  double depth = 8e-3;  ///< [m]; with steps the longest distance from a starting point
  double rate = 1e-3;   ///< [m/s]
  Contact contact = Contact::bonded;
  std::vector<HeldSet> further{};  ///< other than the bonded patch and the base
  Loads loads{};                   ///< act before first contact and afterwards
  std::vector<Step> steps{};       ///< each starts from the last equilibrium
  StepStart start{};               ///< for march_in_steps() alone
  /// Contacting tool in place of the bonded patch; quasi-static only. If loads move the body, its pose is
  /// that of equilibrium_under_loads(). Null: bonded patch.
  std::shared_ptr<const RigidBody> indenter{};
  std::shared_ptr<const PreloadedState> preloaded{};  ///< preloaded state; null: not computed yet
  std::shared_ptr<const FoldFaces> folds{};           ///< in contact where they close; null: they overlap
  std::vector<RigidBody> walls{};                     ///< rigid contacts other than the tool; quasi-static
  double path_length() const {
    double sum = 0.0;
    for (const Step& step : steps) sum += step.length();
    return steps.empty() ? depth : sum;
  }
  double duration() const {
    if (std::all_of(steps.begin(), steps.end(), [](const Step& step) { return step.duration == 0.0; }))
      return path_length() / rate;
    double sum = 0.0;
    for (const Step& step : steps) sum += step.seconds(rate);
    return sum;
  }
  /// Time, and depth of the tool, after a path of `travelled` [m] in the step.
  double t_at(double travelled) const { return start.t + travelled / rate; }
  double depth_at(double travelled) const {
    const double straight = start.depth + start.depth_per_travel * travelled;
    return start.of_tool.turns() ? straight + start.approach.dot(start.of_tool.by_turning(travelled))
                                 : straight;
  }
};

struct SolverOptions {
  double safety = 0.9;              ///< time step = safety x stable step
  double damping = 0.0;             ///< mass-proportional [1/s]
  int frames = 8;                   ///< after the first; explicit: the step is re-estimated at each
  double step_radii = 0.0;          ///< quasi-static: longest load step in tool radii; 0: default
  double sample_rate = 150.0;       ///< of the force [1/s]; the paper's sensor
  double energy_rate = 20.0;        ///< of the energies [1/s]
  double tolerance = 1e-4;          ///< of static equilibrium: unbalanced force / reactions
  std::int64_t evaluations = 2000;  ///< of the force for one static equilibrium, at most
  bool guards = true;               ///< false: only to measure what they cost
};

/// Default longest step, in radii of the tool. It is shorter under a contacting tool, whose contact area
/// changes during the step.
inline double longest_step(bool has_contact) {
  return has_contact ? 0.1 : 0.2;
}

/// Tool at one time. `force` and `base_force` are components along the press direction, positive when tissue
/// resists.
struct ForceSample {
  double t, depth;    ///< [s], [m]
  double force;       ///< on the tool [N]
  double base_force;  ///< on the nodes of the base [N]
  /// Total force on the tool [N] and its moment [N m], as a Wrench (tool_force.hpp).
  std::array<double, 6> on_tool = {};
  std::array<double, 3> aside = {};   ///< displacement across the press direction [m]; LPS
  std::array<double, 3> turned = {};  ///< rotation vector [rad]; LPS
};

/// Largest irregularity of a curve of equilibria: the deviation of one increment of the force from the
/// extrapolation of both neighbours [N], and the sample at its end.
struct Jump {
  double force = 0.0;
  std::size_t sample = 0;
};
Jump largest_jump(const std::vector<ForceSample>& curve);

/// The body at one time.
struct Frame {
  int number;
  double t, depth;
  const ForceSystem::Nodal& u;         ///< [N] m
  const ForceSystem::Nodal& f;         ///< [N] N, System::force() at u; on held nodes it is the reaction
  const ForceState& forces;            ///< with the history and the pressures that belong to f
  Vec3 aside = Vec3::Zero();           ///< displacement of the tool across its press direction [m]
  double contact_force = 0.0;          ///< of a contacting tool, along its press direction [N]
  Vec3 turned = Vec3::Zero();          ///< rotation vector of the tool [rad]
  const RigidContact* tool = nullptr;  ///< contacting, with the forces of f; null: bonded patch
  std::vector<const RigidContact*> walls = {};  ///< likewise, in the order of Loading::walls
};

struct History {
  std::vector<ForceSample> force;
  std::vector<EnergySample> energy;
  /// Force evaluations: with inertia one for each step; quasi-statically those of the searches for
  /// equilibrium.
  std::int64_t evaluations = 0;
  /// Further force evaluations: for the stable step, or quasi-statically for output frames between
  /// equilibria.
  std::int64_t extra_evaluations = 0;
  double dt_stable_first = 0.0, dt_first = 0.0, dt_smallest = 0.0;  ///< [s]
  double J_min = 1.0;                                               ///< smallest det F at any point and step
  Index inverted = 0;                                               ///< most points inverted at once
  double residual = 0.0;                                            ///< largest of a static equilibrium
  bool interrupted = false;
  double preload_displacement = 0.0;  ///< largest displacement of a node by the preload [m]
  Vec3 carried = Vec3::Zero();        ///< mean displacement of the bonded patch by it [m]
  /// Contact of the measured tool: largest penetration of the body's surface at any equilibrium, also between
  /// samples [m]. At the last equilibrium: contact area at rest [m^2], largest pressure at rest [Pa], and
  /// samples.
  double penetration = 0.0, contact_area = 0.0, contact_pressure = 0.0;
  Index contact_samples = 0;
  /// Depth at which `penetration` was largest [m]; 0 if it is too small for a warning.
  double penetration_at = 0.0;
  double no_slip_area = 0.0;         ///< no-slip part of contact_area [m^2]
  double contact_dissipation = 0.0;  ///< frictional dissipation under the tool so far [J]
  FoldContact::Audit folds;          ///< at the last equilibrium; penetration: largest of all
  std::vector<RigidContact::ContactSummary> walls = {};  ///< likewise, of each wall
  /// The tissue's force on each wall [N] and its moment about the tip of the wall [N m], as a Wrench: for
  /// each sample of `force` those of all walls.
  std::vector<std::array<double, 6>> on_walls = {};
  double momentum_error = 0.0;  ///< largest |sum of internal forces| / largest single reaction
  std::vector<Finding> guards;
  std::vector<Retry> retries;
};

/// Sums that a Ledger carries from one step to the next.
struct Account {
  double depth_before = 0.0, force_before = 0.0;          ///< at the last update of the work [m], [N]
  double external = 0.0, dissipated = 0.0;                ///< [J]
  double next_sample = 0.0, next_energy = 0.0;            ///< next due times [s]
  double largest_reaction = 0.0, largest_external = 0.0;  ///< so far [N], [J]
};

/// State that one step passes to the next. A run restarted from it gives the same bits as one without a stop.
/// Each march uses the members that it needs.
struct MarchState {
  int frame = 0;           ///< explicit: completed stretches; else last frame
  std::int64_t step = 0;   ///< explicit: next of that stretch; else completed load steps
  std::int64_t steps = 0;  ///< explicit: of that stretch
  double dt = 0.0, dt_before = 0.0, dt_stable = 0.0;  ///< [s]
  double depth = 0.0;                                 ///< [m]
  Account account;
  double safety = 0.0, longest = 0.0;  ///< explicit; quasi-static [m]: reduced by guards
  int refused = 0;                     ///< quasi-static: equilibria that a guard refused
  std::int64_t looked = 0;             ///< explicit: steps at the last check_fluctuation()
  std::vector<double> depths, forces;  ///< quasi-static: of all equilibria [m], [N]
  Nodal u, v;                          ///< [N] m, m/s
  std::deque<Predictor::Point> path;
  std::vector<double> past;      ///< System::past()
  int step_of_scene = 0;         ///< of Loading::steps, from 0
  EquilibriumState step_start;   ///< state at the beginning of that step
  double least_reactions = 0.0;  ///< System::set_residual_scale() [N]
  History history;
};

struct Observer {
  std::function<void(const Frame&)> frame = {};
  std::function<bool(const ForceSample&, const History&)> sample =
      {};  ///< false: stop and keep the results so far
  /// States from which a run can be continued, except the last: explicit: at output frames; else between two
  /// steps. `state` copies: call it only to keep the result.
  std::function<void(const std::function<MarchState()>& state)> between_steps = {};
  std::function<void(const Retry&)> retry = {};
};

}  // namespace dimple
