#include "solver/march/quasi_static.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "io/error.hpp"
#include "solver/march/frames_between.hpp"
#include "solver/text.hpp"

// Quasi-static march, one increment:
// 1. Length: at most a load step, twice the last increment, and half of one that failed.
// 2. Predict u and lambda: polynomial through the last four equilibria; at the start from a small first
//    motion.
// 3. Move the tool and search: mixed iteration, then viscous steps or loss of contact (Relaxation).
// 4. Check the equilibrium by the guards; book the work of the increment and the dissipation.
// 5. If none is found, repeat with half the length, this once; if a guard refuses it, halve all further
//    increments.
// 6. Accept: output frames in between, force, energies; then history of tissue and friction.
//
// Source:   none: incremental loading with extrapolation.

namespace dimple {
namespace {

constexpr double nudge = 0.02;           // first motion, in increments
constexpr double shortest = 1.0 / 16.0;  // increment in load steps, below which the search ends
constexpr double same_depth = 1e-6;      // of a load step
constexpr std::size_t few = 3;           // equilibria, before which the curve between two is a guess

// First increment under friction, in load steps. New contact slides freely for one increment, since its
// anchors are unknown (RigidContact::predict_contact). Three increments, each twice the last, lose a fifth of
// the loss of one.
constexpr double first_with_friction = 1.0 / 7.0;

bool has_friction(const Loading& loading) {
  return (loading.indenter && loading.indenter->friction > 0.0) ||
         std::any_of(loading.walls.begin(), loading.walls.end(),
                     [](const RigidBody& t) { return t.friction > 0.0; });
}

// Work of a growing contact force over the last increment: a power of the depth through both ends. Nothing if
// the force is not at its beginning.
std::optional<double> work_of_growing(const std::vector<double>& depth, const std::vector<double>& force) {
  const std::size_t k = depth.size() - 1;
  if (depth.front() != 0.0 || force.front() != 0.0 || !(force[k - 1] > 0.0 && force[k] > 0.0))
    return std::nullopt;
  const double power = std::log(force[k] / force[k - 1]) / std::log(depth[k] / depth[k - 1]);
  if (!(power > 0.5 && power < 3.0)) return std::nullopt;  // it is not at its beginning
  return (force[k] * depth[k] - force[k - 1] * depth[k - 1]) / (power + 1.0);
}

// Work of the force over the last increment: of the parabola through the last three points, or of a line.
// From first contact it is `first_scale` of depth times force.
double work_of_last(const std::vector<double>& depth, const std::vector<double>& force, bool straight,
                    double first_scale) {
  const std::size_t k = depth.size() - 1;
  const double h = depth[k] - depth[k - 1], slope = (force[k] - force[k - 1]) / h;
  const double line = 0.5 * h * (force[k] + force[k - 1]);
  if (k == 1 && depth.front() == 0.0 && force.front() == 0.0) return first_scale * h * force[k];
  if (k == 1 || straight) return line;
  const double slope_before = (force[k - 1] - force[k - 2]) / (depth[k - 1] - depth[k - 2]);
  const double curved = line - h * h * h / 6.0 * (slope - slope_before) / (depth[k] - depth[k - 2]);
  // Lost or regained contact leaves the parabola.
  if (force[k] == 0.0 || force[k - 1] == 0.0)
    return std::clamp(curved, 2.0 * std::min(line, 0.0), 2.0 * std::max(line, 0.0));
  return curved;
}

// Travel [m]: distance of the tool, or of the set that moves instead, in this step of a scene. It is an
// Instant's depth; a Moment's depth includes earlier steps.

// Increment from one equilibrium to the next.
struct Increment {
  double from, length, to;  // of the travel [m]
  bool arrives;             // the end of a load step
  bool has_no_curve;        // only one equilibrium, at the start or after a snap: no extrapolation
  Moment end;
};

// Result of the search at the end of an increment, and its entries in the ledger.
struct Found {
  Found() { relaxed.converged = false; }  // until a search has ended: restore() reads it
  Relaxed relaxed;
  bool snapped = false;  // passed a limit point, or lost contact
  ForceSample force = {};
  EnergySample energy = {};
};

class QuasiStaticMarch {
 public:
  QuasiStaticMarch(System& system, const Loading& loading, const SolverOptions& options,
                   const Observer& observer, History& history, const MarchState* from);
  void run();
  AfterCut equilibrate_cut(double t);
  EquilibriumState ended() && { return std::move(now_); }

 private:
  System& system_;
  const Model& model_;
  const Loading& loading_;
  const SolverOptions& options_;
  const Observer& observer_;
  History& history_;
  MarchState state_;
  const Relaxation relax_;
  Predictor path_{4};  // last equilibria, for the first guess
  EquilibriumState now_;
  Nodal f_;
  Ledger ledger_;  // force() and energy() only compute; write() books them
  // check...() records doubtful results and throws SolveError for wrong ones; found_...() only records.
  Guards guards_;
  FramesBetween between_;
  const int steps_;
  const double step_;             // of the load [m]
  const std::int64_t most_;       // force evaluations of all equilibria
  double after_failure_ = step_;  // increment after a failed search
  double least_curvature_ = 1.0;  // least Relaxed::curvature since the last one; < 0: limit point
  bool stopped_ = false;

  void begin_undeformed();
  void begin_after_steps();
  Increment next_increment() const;
  void go(const Increment& increment, Found& found);
  void predict(const Increment& increment, Found& found);
  void set_tool(double travel);
  void search(double tolerance, Found& found);
  void check(const Increment& increment, Found& found);
  bool friction_begins() const { return loading_.start.frame == 0 && has_friction(loading_); }
  bool tool_alone_moves(double along) const;
  double work_of(const Increment& increment, bool snapped) const;
  void check_equilibrium(const Moment& now, const Found& found);
  void check_contact(const Moment& now);
  void look_at_walls(const Moment& now);
  void note_contacts();
  void look_at_tools(const Moment& now);
  void look_at_folds();
  void take(const Increment& increment, const Found& found);
  bool show_frames_before(const Increment& increment);
  void show_frame_at(const Increment& increment);
  void restore(const Increment& increment, const Found& found, const SolveError& error);
};

QuasiStaticMarch::QuasiStaticMarch(System& system, const Loading& loading, const SolverOptions& options,
                                   const Observer& observer, History& history, const MarchState* from)
    : system_(system),
      model_(system.model()),
      loading_(loading),
      options_(options),
      observer_(observer),
      history_(history),
      state_(from ? *from : MarchState()),
      relax_(system),
      now_(system.step_start()),
      f_(Nodal::Zero(4, model_.node_count())),
      ledger_(system, options, observer, state_.account, history),
      guards_(system, /*static_answer=*/true, options.guards, history.guards),
      between_{system, relax_, loading, options, observer, ledger_, history},
      steps_(steps_of_load(model_, loading, options)),
      step_(loading.depth / steps_),
      most_(loading.start.evaluations +
            (relax_.has_mixed() ? most_evaluations(steps_, options) : options.evaluations * steps_)) {
  if (from) {
    history = from->history;
    path_.point = from->path;
    system.restore_past(from->past);
    system.set_least_reactions(from->least_reactions);
  } else if (loading.start.frame > 0) {
    begin_after_steps();
  } else {
    begin_undeformed();
  }
}

void QuasiStaticMarch::begin_undeformed() {
  state_.depths = state_.forces = {0.0};
  state_.longest = step_;
  path_.push(0.0, now_.u, now_.lambda);
  StoredEnergy stored;
  if (system_.loaded()) {
    system_.set({});
    system_.force_at(now_.u, now_.lambda, f_);
    ledger_.add(ledger_.force({}, now_.u, f_));  // not write(): the first sample has no work
    stored = system_.stored_energy(now_.u);
    ledger_.add_work(stored.sum());  // work of the preload counts as external
  } else {
    ledger_.add({0.0, 0.0, 0.0, 0.0});
  }
  ledger_.write(ledger_.energy({}, 0.0, stored));
  if (observer_.frame) observer_.frame(frame_of(system_, 0, {}, now_.u, f_));
}

// Begins a later step of a scene; curve and ledger continue.
void QuasiStaticMarch::begin_after_steps() {
  path_.push(0.0, now_.u, now_.lambda);
  system_.set({.t = loading_.start.t});
  system_.force_at(now_.u, now_.lambda, f_);
  system_.set_residual_scale(f_);
  state_.depths = {0.0};
  state_.forces = {system_.force_along_motion(f_)};
  state_.longest = step_;
  state_.account.external = history_.energy.back().external;
  state_.account.dissipated = history_.energy.back().dissipated;
  for (const EnergySample& e : history_.energy)
    state_.account.largest_external = std::max(state_.account.largest_external, std::abs(e.external));
}

void QuasiStaticMarch::run() {
  while (state_.step < steps_ && !stopped_) {
    const Increment increment = next_increment();
    const std::size_t equilibria = state_.depths.size();
    Found found;
    try {
      go(increment, found);
    } catch (const SolveError& error) {
      // A shorter increment helps neither hourglass modes nor overlapping tools. Runs without guards measure
      // their cost and must keep the same path.
      if (!options_.guards || error.report.code == "hourglass" || error.report.code == tools_overlap) throw;
      state_.depths.resize(equilibria);
      state_.forces.resize(equilibria);
      restore(increment, found, error);
      continue;
    }
    take(increment, found);
  }
}

// The next increment is at most twice the last, so that shortened increments grow again.
Increment QuasiStaticMarch::next_increment() const {
  const std::vector<double>& depths = state_.depths;
  const double end = step_ * static_cast<double>(state_.step + 1), at = depths.back();
  const double last = depths.size() > 1 ? at - depths[depths.size() - 2] : step_;
  const double first = depths.size() == 1 && friction_begins() ? first_with_friction * step_ : step_;
  const double length = std::min({after_failure_, state_.longest, 2.0 * last, end - at, first});
  const bool arrives = end - at - length < same_depth * step_;
  const double to = arrives ? end : at + length;
  return {at, length, to, arrives, path_.point.size() == 1, {loading_.t_at(to), loading_.depth_at(to)}};
}

void QuasiStaticMarch::go(const Increment& increment, Found& found) {
  const Moment& now = increment.end;
  system_.begin_step((increment.to - increment.from) / loading_.rate);
  predict(increment, found);
  const Nodal expected = now_.u;
  search(options_.tolerance, found);
  found.snapped = found.relaxed.passed_limit_point() || found.relaxed.lost_contact;
  check(increment, found);
  if (found.snapped && system_.tool_contact() && system_.tool_contact()->contact_summary().samples == 0)
    guards_.found_lost_contact(now_.u - path_.point.back().u, increment.length, now);
  else if (found.snapped)
    guards_.found_limit_point(now_.u - expected, increment.length, system_.folds() != nullptr, now);
}

// Predicts u and lambda at the end of the increment.
void QuasiStaticMarch::predict(const Increment& increment, Found& found) {
  const double length = increment.to - increment.from;
  if (!increment.has_no_curve) {
    path_.extrapolate(increment.to, now_.u, now_.lambda);
    return set_tool(increment.to);
  }
  // The first iteration predicts better than a first motion: contact grows from a point, and a hold has no
  // motion.
  if (system_.tool_contact() || loading_.start.holds) {
    now_ = {path_.point.back().u, path_.point.back().lambda};
    return set_tool(increment.to);
  }
  const Vec3 motion = system_.held().motion(tool_set);
  now_ = {path_.point.back().u, path_.point.back().lambda};
  if (!model_.scheme.pressure_patches) {
    first_guess(model_, motion, length, now_.u);
    return set_tool(increment.to);
  }
  // First motion, at low accuracy: it gives the direction in which the tissue moves.
  const double nudged_to = increment.from + nudge * length;
  first_guess(model_, motion, nudge * length, now_.u);
  set_tool(nudged_to);
  search(std::max(1e-2, options_.tolerance), found);
  Predictor nudged = path_;
  nudged.push(nudged_to, now_.u, now_.lambda);
  nudged.extrapolate(increment.to, now_.u, now_.lambda);
  set_tool(increment.to);
}

void QuasiStaticMarch::set_tool(double travel) {
  system_.set({.t = loading_.t_at(travel), .depth = travel}, now_.u);
}

void QuasiStaticMarch::search(double tolerance, Found& found) {
  const RelaxOptions how{.tolerance = tolerance,
                         .evaluations = relax_.has_mixed()
                                            ? std::min(options_.evaluations, most_ - history_.evaluations)
                                            : options_.evaluations,
                         .allow_separation = true};
  Relaxed& relaxed = found.relaxed;
  relaxed.converged = false;
  if (how.evaluations < 1) throw no_equilibrium(relaxed, model_);
  const std::int64_t before = system_.tissue().sweeps();
  try {
    // Both u and lambda are unknown; without patches u alone, by dynamic relaxation without contact.
    relaxed = relax_.has_mixed() ? relax_.from_near(now_.u, now_.lambda, f_, how)
                                 : relax_(now_.u, f_, how, &now_.lambda);
  } catch (...) {
    history_.evaluations += system_.tissue().sweeps() - before;
    throw;
  }
  history_.evaluations += relaxed.evaluations;
  least_curvature_ = std::min(least_curvature_, relaxed.curvature);
  if (relaxed.converged) return;
  relaxed.curvature = least_curvature_;
  throw no_equilibrium(relaxed, model_);
}

void QuasiStaticMarch::check_equilibrium(const Moment& now, const Found& found) {
  guards_.check_sweep(found.relaxed.sweep, now);  // throws: not finite, or inverted
  guards_.check_nodes(now_.u, f_, now);
  guards_.check_points(found.relaxed.sweep, now);  // inverted points and changed volume
  guards_.check_fluctuation(now_.u, now);          // displacements that gradients do not resolve
  if (system_.tool_contact()) check_contact(now);
  look_at_walls(now);
  look_at_tools(now);
  if (system_.folds()) look_at_folds();
}

// True if a contacting tool alone moves, straight along its press direction (1) or back (-1).
bool QuasiStaticMarch::tool_alone_moves(double along) const {
  const auto moves = [](const RigidBody& wall) { return wall.motion && !wall.motion->isZero(0.0); };
  return system_.tool_contact() &&
         along * system_.held().motion(tool_set).dot(model_.tool.approach) > 1.0 - same_depth &&
         std::none_of(loading_.walls.begin(), loading_.walls.end(), moves) &&
         std::all_of(loading_.further.begin(), loading_.further.end(),
                     [](const HeldSet& set) { return set.fraction == 0.0; });
}

// Work of the last increment. Near first contact and near the loss of contact the force follows the tool's
// shape.
double QuasiStaticMarch::work_of(const Increment& increment, bool snapped) const {
  const std::vector<double>&at = state_.depths, &force = state_.forces;
  const std::size_t k = at.size() - 1;
  const double before = history_.force.back().depth;
  if (tool_alone_moves(-1.0) && force[k] == 0.0 && before > 0.0 &&
      before <= at[k] - at[k - 1] + same_depth * step_)
    return fraction_of_first_work(system_.tool_contact()->body().shape, before) * before * force[k - 1];
  constexpr std::size_t first_few = 4;  // up to the end of a load step with friction
  const bool begins = k > 1 && k < first_few && tool_alone_moves(1.0) && !increment.has_no_curve && !snapped;
  if (const std::optional<double> work = begins ? work_of_growing(at, force) : std::nullopt) return *work;
  const double first_scale = tool_alone_moves(1.0)
                                 ? fraction_of_first_work(system_.tool_contact()->body().shape, increment.to)
                                 : 0.5;
  return work_of_last(at, force, increment.has_no_curve || snapped, first_scale);
}

// Applies the guards to the new equilibrium and adds its depth and force to the curve.
void QuasiStaticMarch::check(const Increment& increment, Found& found) {
  const Moment& now = increment.end;
  const Relaxed& relaxed = found.relaxed;
  check_equilibrium(now, found);
  found.force = ledger_.force(now, now_.u, f_);
  state_.depths.push_back(increment.to);
  state_.forces.push_back(system_.force_along_motion(f_));
  const double work = work_of(increment, found.snapped);
  const StoredEnergy stored = system_.stored_energy(now_.u);
  guards_.check_hourglass(stored.hourglass, stored.tissue, now);
  double dissipated = found.snapped ? relaxed.dissipated : 0.0;
  // The search does not compute the work of a spring back from the tool: all missing energy is dissipated.
  if (relaxed.lost_contact && !system_.viscoelastic())
    dissipated = std::max(0.0, history_.energy.back().stored + work - stored.sum());
  for (const System::OneContact& one : system_.contacts())
    if (one.rigid) dissipated += one.rigid->dissipation();  // since accept_step()
  found.energy = ledger_.energy(now, /*kinetic=*/0.0, stored, work, dissipated);
  // Once the body is free of the tool, the imbalance is older than this increment; a shorter one cannot
  // remove it.
  const bool rests = system_.tool_contact() && stored.sum() <= 1e-6 * state_.account.largest_external &&
                     system_.tool_contact()->contact_summary().samples == 0;
  if (state_.depths.size() > few + (friction_begins() ? 2 : 0))  // one step in three increments
    guards_.check_energy(found.energy,
                         std::max(state_.account.largest_external, std::abs(found.energy.external)),
                         /*duration=*/now.t, /*conserves=*/false, now, /*warns_alone=*/rests);
}

// A contacting tool may neither penetrate the body nor meet surface without contact samples.
void QuasiStaticMarch::check_contact(const Moment& now) {
  const RigidContact& tool = *system_.tool_contact();
  const RigidContact::Audit audit = tool.audit(now_.u, system_.now());
  const double most = Guards::most_penetration * tool.body().shape.radius;
  // A finding above this; throws above fifty times as much.
  guards_.check_contact(audit, most, tool.body(), now);
  if (audit.penetration > history_.penetration) {
    history_.penetration = audit.penetration;
    if (audit.penetration > most) history_.penetration_at = now.depth;
  }
}

// Records the contacts of the accepted equilibrium in the history.
void QuasiStaticMarch::note_contacts() {
  if (const RigidContact* tool = system_.tool_contact()) {
    const RigidContact::ContactSummary contact_summary = tool->contact_summary();
    history_.contact_samples = contact_summary.samples;
    history_.contact_area = contact_summary.area;
    history_.no_slip_area = contact_summary.no_slip;
    history_.contact_dissipation = contact_summary.dissipation;
    history_.contact_pressure = contact_summary.pressure;
  }
  for (std::size_t k = 0; k < history_.walls.size(); ++k) {
    const double deepest = history_.walls[k].penetration;
    history_.walls[k] = system_.walls()[k]->contact_summary();
    history_.walls[k].penetration = deepest;
  }
}

void QuasiStaticMarch::look_at_walls(const Moment& now) {
  history_.walls.resize(system_.walls().size());
  for (std::size_t k = 0; k < history_.walls.size(); ++k) {
    double& deepest = history_.walls[k].penetration;
    deepest = std::max(deepest, system_.walls()[k]->audit(now_.u, system_.now()).penetration);
    guards_.check_wall(system_.walls()[k]->body(), deepest, system_.walls()[k]->contact_summary().samples > 0,
                       now);
  }
}

void QuasiStaticMarch::look_at_tools(const Moment& now) {
  std::vector<ToolNow> tools;
  for (const System::OneContact& one : system_.contacts())
    if (one.rigid && (one.rigid->is_measured() || one.rigid->body().is_tool))
      tools.push_back({one.rigid->body(), one.rigid->pose_at(system_.now().depth)});
  guards_.check_apart(tools, now);
}

void QuasiStaticMarch::look_at_folds() {
  const double deepest = history_.folds.penetration;
  history_.folds = system_.folds()->audit();
  history_.folds.penetration = std::max(history_.folds.penetration, deepest);
}

void QuasiStaticMarch::take(const Increment& increment, const Found& found) {
  after_failure_ = step_;
  least_curvature_ = 1.0;
  // After a limit point the new branch is unrelated to the old one.
  if (found.snapped) path_.point.erase(path_.point.begin(), path_.point.end() - 1);
  path_.push(increment.to, now_.u, now_.lambda);
  ledger_.keep_worst(found.relaxed.sweep);
  history_.residual = std::max(history_.residual, found.relaxed.residual);
  if (!show_frames_before(increment)) {
    history_.interrupted = stopped_ = true;
    return;
  }
  if (found.snapped) path_.point.pop_front();
  note_contacts();
  ledger_.write(found.force, f_);
  ledger_.write(found.energy);
  show_frame_at(increment);
  const bool ended = increment.arrives && state_.step + 1 == steps_;
  if (!ledger_.show_force()) {
    history_.interrupted = !ended;
    stopped_ = true;
    return;
  }
  system_.accept_step(now_.u);  // after the frame: its stresses are those of this increment
  if (increment.arrives) ++state_.step;
  if (observer_.between_steps && !ended)
    observer_.between_steps([&] {
      MarchState copy = ledger_.kept(state_);  // with the history and the past so far
      copy.path = path_.point;
      copy.least_reactions = system_.least_reactions();
      return copy;
    });
}

// False: the observer stops the run.
bool QuasiStaticMarch::show_frames_before(const Increment& increment) {
  const double before = increment.to - same_depth * step_;
  if (between_.travel_of(state_.frame + 1) >= before) return true;
  if (!between_.show(state_.frame, before, increment.from, path_)) return false;
  system_.begin_step((increment.to - increment.from) / loading_.rate);  // and back to its end
  system_.set({.t = increment.end.t, .depth = increment.to});
  system_.force_at(now_.u, now_.lambda, f_);
  ++history_.extra_evaluations;
  return true;
}

void QuasiStaticMarch::show_frame_at(const Increment& increment) {
  if (state_.frame == options_.frames ||
      between_.travel_of(state_.frame + 1) >= increment.to + same_depth * step_)
    return;
  ++state_.frame;
  if (observer_.frame)
    observer_.frame(frame_of(system_, loading_.start.frame + state_.frame, increment.end, now_.u, f_));
}

// Nothing moves: the energy that the tissue releases is dissipated by the cut.
AfterCut QuasiStaticMarch::equilibrate_cut(double t) {
  const Moment now{t, loading_.start.depth};
  Found found;
  set_tool(0.0);  // no begin_step(): a cut takes no time, and viscoelastic tissue is refused
  search(options_.tolerance, found);
  check_equilibrium(now, found);
  const StoredEnergy stored = system_.stored_energy(now_.u);
  guards_.check_hourglass(stored.hourglass, stored.tissue, now);
  AfterCut result{.released = history_.energy.back().stored - stored.sum(),
                  .passed_limit_point = found.relaxed.passed_limit_point()};
  ledger_.keep_worst(found.relaxed.sweep);
  history_.residual = std::max(history_.residual, found.relaxed.residual);
  note_contacts();
  ledger_.write(ledger_.force(now, now_.u, f_), f_);
  ledger_.write(ledger_.energy(now, 0.0, stored, 0.0, result.released));
  if (observer_.frame)
    // A frame of its own, which the caller has counted.
    observer_.frame(frame_of(system_, loading_.start.frame, now, now_.u, f_));
  if (!ledger_.show_force()) history_.interrupted = true;
  system_.accept_step(now_.u);
  return result;
}

// Returns to the last equilibrium and continues with a shorter increment, or ends here. Nothing is restored:
// predict() starts from path_, and the next begin_step() discards what was not accepted.
void QuasiStaticMarch::restore(const Increment& increment, const Found& found, const SolveError& error) {
  const double depth = increment.end.depth, shorter = 0.5 * increment.length;
  if (found.relaxed.converged) {  // a guard refused it: shorter from now on
    if (state_.refused++ == most_retries)
      throw after_retries(error, text("steps of the load down to ", 1e3 * increment.length, " mm"));
    state_.longest = shorter;
  } else {  // shorter this once
    after_failure_ = shorter;
    if (after_failure_ < shortest * step_ || history_.evaluations >= most_) {
      Report report = error.report;
      report.where = text("indentation ", 1e3 * depth, " mm; ", report.where);
      report.why += text("; it recurred with steps of the load down to ", 1e3 * increment.length,
                         " mm, after ", history_.evaluations, " force evaluations in all");
      throw SolveError(report);
    }
  }
  ledger_.note(Retry{error.report.code, depth,
                     text("back to ", 1e3 * loading_.depth_at(increment.from), " mm, and on in steps of ",
                          1e3 * shorter, " mm")});
}

}  // namespace

std::int64_t most_evaluations(int steps, const SolverOptions& options) {
  return options.evaluations + evaluations_of_step * steps;
}

int steps_of_load(const Model& model, const Loading& loading, const SolverOptions& options) {
  // Largest travel of anything that moves, per metre of the tool's travel.
  double fraction = max_displacement_ratio(loading.further);
  for (const RigidBody& wall : loading.walls)
    fraction = std::max(fraction, wall.motion.value_or(Vec3::Zero().eval()).norm());
  const double distance = loading.depth * fraction;
  const double radius = loading.indenter ? loading.indenter->shape.radius : model.tool.radius;
  const double longest =
      options.step_radii > 0.0 ? options.step_radii : longest_step(loading.indenter != nullptr);
  const double steps = std::ceil(distance / (longest * radius) - same_depth);
  return std::max(1, static_cast<int>(steps));
}

// The motion decreases with the square of the distance from the tool, in radii, as under a small load on a
// half-space; and with the height above the far side, which is often held.
void first_guess(const Model& model, const Vec3& direction, double distance, Nodal& u) {
  if (model.base.empty()) {  // it moves as a whole until something stops it
    u.colwise() += padded(direction) * distance;
    return;
  }
  const Eigen::VectorXd along = model.X.transpose() * model.tool.approach;
  const double top = model.tool.centre.dot(model.tool.approach), bottom = along.maxCoeff();
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 d = model.X.col(a) - model.tool.centre;
    const double lateral = (d - d.dot(model.tool.approach) * model.tool.approach).norm();
    const double away = std::hypot(std::max(0.0, lateral - model.tool.radius), d.dot(model.tool.approach)) /
                        model.tool.radius;
    const double follows = std::clamp((bottom - along[a]) / (bottom - top), 0.0, 1.0);
    u.col(a) += padded(direction) * (distance * follows / ((1.0 + away) * (1.0 + away)));
  }
}

void march_quasi_statically(System& system, const Loading& loading, const SolverOptions& options,
                            const Observer& observer, History& history, const MarchState* from,
                            EquilibriumState* ended) {
  QuasiStaticMarch march(system, loading, options, observer, history, from);
  march.run();
  if (ended) *ended = std::move(march).ended();
}

AfterCut equilibrate_after_cut(System& system, const Loading& loading, double t, const SolverOptions& options,
                               const Observer& observer, History& history, EquilibriumState& ended) {
  QuasiStaticMarch march(system, loading, options, observer, history, nullptr);
  const AfterCut result = march.equilibrate_cut(t);
  ended = std::move(march).ended();
  return result;
}

}  // namespace dimple
