#pragma once

// What every way of marching is given and hands out: explicit.hpp, quasi_static.hpp; solve.hpp chooses.

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

/// A piece of a scene: one thing moves, straight and evenly; all others stay where they are. A tool that
/// touches may turn meanwhile. Or nothing moves at all, and tissue relaxes.
struct Step {
  std::string name;
  std::string moves;               ///< the tool (empty), or the name of a further set
  Vec3 way = Vec3::Zero();         ///< [m]
  Vec3 turn = Vec3::Zero();        ///< rotation vector [rad]
  std::optional<Vec3> about = {};  ///< what it turns about [m]; nothing: its tip, as the step begins
  double lever = 0.0;  ///< [m] of what turns: an angle of 1 is as long a way; of a hold its length()
  double lasts = 0.0;  ///< [s]; 0: as long as its way takes at the loading's rate
  bool turns() const { return !turn.isZero(0.0); }
  bool holds() const { return !turns() && way.isZero(0.0); }
  /// Of all its way, by which the march goes [m].
  double length() const {
    if (holds()) return lever;
    return turns() ? std::hypot(way.norm(), lever * turn.norm()) : way.norm();
  }
  double rate(double of_loading) const { return lasts > 0.0 ? length() / lasts : of_loading; }  ///< [m/s]
  double seconds(double rate_of_loading) const { return length() / rate(rate_of_loading); }
};

/// Where a step begins: what the steps before it have left.
struct Begun {
  double t = 0.0, depth = 0.0;  ///< [s], [m] of the tool along its push
  bool holds = false;           ///< nothing moves in this step
  double sinks = 1.0;           ///< the tool's depth gains so much of the way in this step
  RigidWay of_tool = {};        ///< where it turns: what its tip sinks besides, along `push`
  Vec3 push = Vec3::Zero();
  int frame = 0;
  std::int64_t evaluations = 0;  ///< that the steps before may have taken, at most
};

/// How the tool moves: straight, at constant speed, from touching to `depth`; or in steps.
struct Loading {
  double depth = 8e-3;  ///< [m] with steps: the longest distance of what moves from where it began
  double rate = 1e-3;   ///< [m/s]
  Contact contact = Contact::bonded;
  std::vector<HeldSet> further{};  ///< beside the circle and the base
  Loads loads{};                   ///< that act before the tool touches, and go on acting
  std::vector<Step> steps{};       ///< one after the other, each from the last one's equilibrium
  Begun begun{};                   ///< for march_in_steps() alone
  /// A tool that touches, in place of the circle; quasi-statically. Of a body that loads move its pose is
  /// that of rest_under_loads(). Null: the circle.
  std::shared_ptr<const Touch> touch{};
  std::shared_ptr<const Settled> settled{};  ///< of this body under these loads; null: not looked for yet
  std::shared_ptr<const FoldBanks> folds{};  ///< that touch where they close; null: they pass
  std::vector<Touch> walls{};                ///< rigid contacts beside the tool; quasi-statically
  double way() const {
    double sum = 0.0;
    for (const Step& step : steps) sum += step.length();
    return steps.empty() ? depth : sum;
  }
  double duration() const {
    if (std::all_of(steps.begin(), steps.end(), [](const Step& step) { return step.lasts == 0.0; }))
      return way() / rate;
    double sum = 0.0;
    for (const Step& step : steps) sum += step.seconds(rate);
    return sum;
  }
  /// After so much of a step's way [m]: the time, and the tool's depth.
  double t_at(double come) const { return begun.t + come / rate; }
  double depth_at(double come) const {
    const double straight = begun.depth + begun.sinks * come;
    return begun.of_tool.turns() ? straight + begun.push.dot(begun.of_tool.by_turning(come)) : straight;
  }
};

struct SolverOptions {
  double safety = 0.9;              ///< time step = safety x stable step
  double damping = 0.0;             ///< mass-proportional [1/s]
  int frames = 8;                   ///< after the first; explicit: the step is re-estimated at each
  double step_radii = 0.0;          ///< slowly: longest step of the load, in radii of the tool; 0: chosen
  double sample_rate = 150.0;       ///< of the force [1/s]; the paper's sensor
  double energy_rate = 20.0;        ///< of the energies [1/s]
  double tolerance = 1e-4;          ///< of static equilibrium: unbalanced force / reactions
  std::int64_t evaluations = 2000;  ///< of the force for one static equilibrium, at most
  bool guards = true;               ///< false: only to measure what they cost
};

/// What longest step is chosen, in radii of the tool: shorter under one that touches, whose contact changes
/// as it goes.
inline double longest_step(bool touches) {
  return touches ? 0.1 : 0.2;
}

/// The tool at one time. `force` and `base_force` are components along the push, positive when tissue
/// resists.
struct ForceSample {
  double t, depth;    ///< [s], [m]
  double force;       ///< on the circle's nodes [N]
  double base_force;  ///< on the base's nodes, with which the bed holds the body [N]
  /// All of the force on the tool [N] and its moment [N m], as a Wrench (tool_force.hpp).
  std::array<double, 6> on_tool = {};
  std::array<double, 3> aside = {};   ///< how far the tool has come across its push [m]; LPS
  std::array<double, 3> turned = {};  ///< by which rotation vector it has turned [rad]; LPS
};

/// Of the pieces between neighbouring samples of a tool's way in equilibrium: by how much one differs at most
/// from what its neighbours on either side would make of it [N], and the sample at its end.
struct Jump {
  double force = 0.0;
  std::size_t sample = 0;
};
Jump largest_jump(const std::vector<ForceSample>& curve);

/// The body at one time.
struct Frame {
  int number;
  double t, depth;
  const ForceSystem::Nodal& u;  ///< [N] m
  const ForceSystem::Nodal& f;  ///< [N] N, System::force() at u; on held nodes it is the reaction
  const ForceState& forces;     ///< with the history and the pressures that belong to f
  Vec3 aside = Vec3::Zero();    ///< how far the tool has come across its push [m]
  double contact_force = 0.0;   ///< of a tool that touches, along its push, which no held node bears [N]
  Vec3 turned = Vec3::Zero();   ///< by which rotation vector the tool has turned [rad]
  const TouchingTool* tool = nullptr;  ///< that touches, with the forces that belong to f; null: the circle
  std::vector<const TouchingTool*> walls = {};  ///< likewise, in the order of Loading::walls
};

struct History {
  std::vector<ForceSample> force;
  std::vector<EnergySample> energy;
  /// With inertia the number of steps, each of which evaluates the force once; quasi-statically the
  /// evaluations that the searches for equilibrium took.
  std::int64_t evaluations = 0;
  /// Of the force besides: for the stable step; quasi-statically for frames between equilibria.
  std::int64_t extra_evaluations = 0;
  double dt_stable_first = 0.0, dt_first = 0.0, dt_smallest = 0.0;  ///< [s]
  double J_min = 1.0;                                               ///< smallest det F at any point and step
  Index inverted = 0;                                               ///< most points inverted at once
  double residual = 0.0;  ///< largest that a static equilibrium was left with
  bool interrupted = false;
  double settled = 0.0;         ///< longest way of a node under the loads before the tool touches [m]
  Vec3 carried = Vec3::Zero();  ///< mean displacement of the circle under the loads before it moves [m]
  /// Of a tool that touches: how deep the body's surface came into it at most, between samples too [m]; and
  /// at the last equilibrium the area of the contact [m^2], both at rest, its largest pressure [Pa] and its
  /// samples.
  double penetration = 0.0, contact_area = 0.0, contact_pressure = 0.0;
  Index contact_samples = 0;
  /// The depth at which the first of these was [m]; 0: it is too little to warn of.
  double penetration_at = 0.0;
  double contact_sticks = 0.0;  ///< of contact_area, what friction holds [m^2]
  double contact_heat = 0.0;    ///< that friction under the tool has taken so far [J]
  FoldContact::Audit folds;     ///< at the last equilibrium, but for the deepest penetration of all
  std::vector<TouchingTool::Touched> walls = {};  ///< likewise, of each wall
  /// The tissue's force on each wall [N] and its moment about that one's tip [N m], as a Wrench: of the first
  /// of `force` those of all walls, then of the next.
  std::vector<std::array<double, 6>> on_walls = {};
  double momentum_error = 0.0;  ///< largest |sum of internal forces| / largest single reaction
  std::vector<Finding> guards;
  std::vector<Retry> retries;
};

/// What a Ledger hands from one step to the next.
struct Account {
  double depth_before = 0.0, force_before = 0.0;          ///< at the last time that work was done [m], [N]
  double external = 0.0, dissipated = 0.0;                ///< [J]
  double next_sample = 0.0, next_energy = 0.0;            ///< when they are due [s]
  double largest_reaction = 0.0, largest_external = 0.0;  ///< so far [N], [J]
};

/// All that one step leaves to the next. A run that starts from it goes on to the same bits as if it had
/// never stopped. Each way of marching fills in what it needs.
struct MarchState {
  int frame = 0;           ///< explicit: the stretch before the next; slowly: the last done
  std::int64_t step = 0;   ///< explicit: the next one of that stretch; slowly: the last done
  std::int64_t steps = 0;  ///< explicit: of that stretch
  double dt = 0.0, dt_before = 0.0, dt_stable = 0.0;  ///< [s]
  double depth = 0.0;                                 ///< [m]
  Account account;
  double safety = 0.0, longest = 0.0;  ///< explicit; slowly [m]: smaller once a guard has sent it back
  int refused = 0;                     ///< slowly: equilibria that a guard has sent back
  std::int64_t looked = 0;             ///< explicit: steps until Guards::check_fluctuation()
  std::vector<double> depths, forces;  ///< slowly: of all equilibria [m], [N]
  Nodal u, v;                          ///< [N] m, m/s
  std::deque<Predictor::Point> path;
  std::vector<double> past;      ///< of viscoelastic tissue, as ForceState::past()
  int step_of_scene = 0;         ///< of Loading::steps, from 0
  Rest begun;                    ///< where that step began
  double least_reactions = 0.0;  ///< System::measure_by() [N]
  History history;
};

struct Observer {
  std::function<void(const Frame&)> frame = {};
  std::function<bool(const ForceSample&, const History&)> sample =
      {};  ///< false: stop here, keep what there is
  /// Where a run can be taken up again, the last frame apart: explicit: at frames; else between two steps.
  /// `state` copies: call it only when it is to be kept.
  std::function<void(const std::function<MarchState()>& state)> between_steps = {};
  std::function<void(const Retry&)> retry = {};
};

}  // namespace dimple
