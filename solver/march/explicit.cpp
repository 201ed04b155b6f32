#include "solver/march/explicit.hpp"

#include <algorithm>
#include <cmath>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/march/central_differences.hpp"
#include "solver/march/ledger.hpp"
#include "solver/text.hpp"

// Explicit march, in stretches from one output frame to the next:
// 1. Equal steps dt, at most `safety` of the stable step; in short loads at least one for each sample, up to
//    20.
// 2. Forces f(u(t)), with the tool and the loads at t; check_sweep().
// 3. Force, energies and output frame, if they are due, from u(t) and v(t - dt/2).
// 4. Viscoelastic tissue and loads accept u(t).
// 5. Central differences: v(t + dt/2), then u(t + dt); held nodes move as prescribed.
// 6. End of a stretch: guards, and the stable step at the new state.
// 7. If a guard throws, return to the last output frame with `safety` reduced to 0.6 of it, three times at
//    most.
//
// Source:   Horton et al. 2007, sections 2.3 and 3.2; departures are in the header.

namespace dimple {
namespace {

constexpr int between_kinetic = 25;                 // steps
constexpr std::int64_t between_fluctuations = 200;  // steps
constexpr double smaller = 0.6;                     // step, each time that a guard sends the march back

// The march in stretches, each from one output frame to the next in equal steps.
class ExplicitMarch {
 public:
  ExplicitMarch(System& system, const Loading& loading, const SolverOptions& options,
                const Observer& observer, History& history, const MarchState* from);
  void run();

 private:
  System& system_;
  const Model& model_;
  const Constraints& held_;
  const Loading& loading_;
  const SolverOptions& options_;
  const Observer& observer_;
  History& history_;
  MarchState state_;
  Nodal &u_, &v_, f_;
  Ledger ledger_;
  Guards guards_;
  const double duration_, stretch_;
  const Eigen::VectorXd inverse_mass_;
  int shown_;  // last output frame
  bool stopped_ = false;

  void begin_undeformed();
  void begin_stretch();
  void march_stretch();
  void step(const Moment& now, bool first);
  void finish_stretch();
  void look_at_stretch(const Moment& end);
  bool write(const Moment& now, bool last);
  void write_energy(const Moment& now);
  void show_frame(int number, const Moment& now);
  double stable_step();
  void restore(const MarchState& kept, const SolveError& error);
};

ExplicitMarch::ExplicitMarch(System& system, const Loading& loading, const SolverOptions& options,
                             const Observer& observer, History& history, const MarchState* from)
    : system_(system),
      model_(system.model()),
      held_(system.held()),
      loading_(loading),
      options_(options),
      observer_(observer),
      history_(history),
      state_(from ? *from : MarchState()),
      u_(state_.u),
      v_(state_.v),
      f_(Nodal::Zero(4, model_.node_count())),
      ledger_(system, options, observer, state_.account, history),
      guards_(system, loading.duration() >= slow_load * shear_crossing_time(system.tissues(), model_),
              options.guards, history.guards),
      duration_(loading.duration()),
      stretch_(duration_ / options.frames),
      inverse_mass_(model_.mass.cwiseInverse()),
      shown_(state_.frame - 1) {
  if (from) {
    history = from->history;
    system.restore_past(from->past);
  } else {
    begin_undeformed();
  }
}

void ExplicitMarch::begin_undeformed() {
  state_.safety = options_.safety;
  u_ = system_.step_start().u;
  v_ = Nodal::Zero(4, model_.node_count());
  if (system_.loaded()) ledger_.add_work(system_.stored_energy(u_).sum());
  // The initial velocity of held nodes is the only work that is not a force times a distance.
  ledger_.add_work(held_.apply_initial_velocity(v_, loading_.rate, model_.mass));
  state_.dt_stable = stable_step();
}

void ExplicitMarch::run() {
  const auto keep = [&] { return ledger_.kept(state_); };
  MarchState kept = keep();
  while (state_.frame < options_.frames && !stopped_) {
    try {
      begin_stretch();
      march_stretch();
      finish_stretch();
      if (state_.frame < options_.frames && observer_.between_steps) observer_.between_steps(keep);
      if (options_.guards) kept = keep();
    } catch (const SolveError& error) {
      if (!options_.guards) throw;
      restore(kept, error);
    }
  }
  history_.interrupted = stopped_;
}

void ExplicitMarch::begin_stretch() {
  state_.step = 0;
  // A load shorter than a few stable steps has as many steps as the force has samples, up to twenty.
  constexpr double enough = 20.0;
  const double samples = std::min(enough, stretch_ * options_.sample_rate);
  state_.steps =
      static_cast<std::int64_t>(std::ceil(std::max(stretch_ / (state_.safety * state_.dt_stable), samples)));
  state_.dt = stretch_ / static_cast<double>(state_.steps);
  if (state_.frame == 0) {
    history_.dt_stable_first = state_.dt_stable;
    history_.dt_first = history_.dt_smallest = state_.dt;
  }
  history_.dt_smallest = std::min(history_.dt_smallest, state_.dt);
}

void ExplicitMarch::march_stretch() {
  for (; state_.step < state_.steps && !stopped_; ++state_.step) {
    stop_if_requested();
    const double t = stretch_ * state_.frame + state_.dt * static_cast<double>(state_.step);
    step({t, loading_.rate * t, state_.dt, state_.dt_stable}, state_.step == 0);
    if (state_.step % between_kinetic == between_kinetic - 1)
      guards_.check_kinetic(0.5 * (v_.colwise().squaredNorm() * model_.mass).value(), state_.account.external,
                            {t, loading_.rate * t, state_.dt, state_.dt_stable});
  }
}

// One step from u at `now`; v is that of half a step before.
void ExplicitMarch::step(const Moment& now, bool first) {
  const bool viscoelastic = system_.viscoelastic();
  const double before = state_.dt_before;
  if (first) guards_.check_step(now);
  if (viscoelastic) system_.begin_step(before);
  system_.set({.t = now.t, .depth = now.depth});
  const ForceSystem::Sweep sweep = system_.stress_sweep(u_);
  ledger_.keep_worst(sweep);
  guards_.check_sweep(sweep, now);

  const CentralDifferences differences{.dt = now.dt,
                                       .kick = 0.5 * (before > 0.0 ? before + now.dt : now.dt),
                                       .rate = loading_.rate,
                                       .depth = loading_.rate * (now.t + now.dt),
                                       .damping = options_.damping};
  const auto advance = [&](Index begin, Index end) {
    differences(begin, end, held_, inverse_mass_, f_, v_, u_);
  };
  // Output needs u(t) and v(t - dt/2): in such steps all forces are gathered before anything moves.
  const bool whole = first || ledger_.energy_is_due(now.t) || ledger_.force_is_due(now.t) ||
                     system_.loaded() || viscoelastic;
  system_.gather(u_, f_, whole ? std::function<void(Index, Index)>{} : advance);
  stopped_ = !write(now, false);
  if (first) show_frame(state_.frame, now);
  if (viscoelastic || system_.loaded())
    system_.accept_step(u_);  // after the frame: its stresses are those of this step
  if (whole) advance(0, u_.cols());
  if (options_.damping > 0.0)
    for (Index a = 0; a < u_.cols(); ++a)
      if (held_.is_free(a))
        state_.account.dissipated += options_.damping * model_.mass[a] * v_.col(a).squaredNorm() * now.dt;
  state_.dt_before = now.dt;
  state_.depth = differences.depth;
  ++history_.evaluations;
}

// Ends a stretch: guards, and the stable step for the next one.
void ExplicitMarch::finish_stretch() {
  const Moment end = {state_.depth / loading_.rate, state_.depth, state_.dt_before, state_.dt_stable};
  const bool last = stopped_ || state_.frame + 1 == options_.frames;
  double next_stable = state_.dt_stable;
  if (!stopped_) {
    look_at_stretch(end);
    if (last || history_.evaluations - state_.looked >= between_fluctuations) {
      guards_.check_fluctuation(u_, end);
      state_.looked = history_.evaluations;
    }
    if (options_.guards || !last) next_stable = stable_step();
    guards_.check_step({end.t, end.depth, end.dt, next_stable});
  }
  if (last || options_.guards) {
    system_.set({.t = end.t, .depth = end.depth});
    const ForceSystem::Sweep sweep = last ? system_.force(u_, f_) : system_.stress_sweep(u_);
    guards_.check_sweep(sweep, end);
    guards_.check_points(sweep, end);
  }
  if (last) {
    write(end, true);
    show_frame(options_.frames, end);
  }
  ++state_.frame;
  state_.dt_stable = next_stable;
}

void ExplicitMarch::look_at_stretch(const Moment& end) {
  guards_.check_nodes(u_, f_, end);
  std::vector<double> force;
  for (const ForceSample& sample : history_.force)
    if (sample.t >= stretch_ * state_.frame) force.push_back(sample.force);
  guards_.check_smooth(force, state_.account.largest_reaction, duration_, end);
}

// Output at time t, between f(u(t)) and the motion of u. False: stop here.
bool ExplicitMarch::write(const Moment& now, bool last) {
  Account& account = state_.account;
  const double mean = ledger_.mean_force(f_);
  ledger_.add_work(mean * (now.depth - account.depth_before));
  account.depth_before = now.depth;
  if (last || ledger_.energy_is_due(now.t)) write_energy(now);
  if (!last && !ledger_.force_is_due(now.t)) return true;
  ledger_.next_force_after(account.next_sample);
  guards_.check_nodes(u_, f_, now);
  ledger_.write(ledger_.force(now, u_, f_), f_);
  return ledger_.show_force();
}

void ExplicitMarch::write_energy(const Moment& now) {
  ledger_.next_energy_after(state_.account.next_energy);
  double kinetic = 0.0;
  for (Index a = 0; a < u_.cols(); ++a) {
    Eigen::Vector4d v = v_.col(a);  // still of t - dt/2
    if (held_.is_free(a)) v -= f_.col(a) * (0.5 * state_.dt_before * inverse_mass_[a]);
    kinetic += 0.5 * model_.mass[a] * v.squaredNorm();
  }
  const StoredEnergy stored = system_.stored_energy(u_);
  ledger_.write(ledger_.energy(now, kinetic, stored));
  guards_.check_energy(history_.energy.back(), state_.account.largest_external, duration_, true, now);
  guards_.check_hourglass(stored.hourglass, stored.tissue, now);
}

void ExplicitMarch::show_frame(int number, const Moment& now) {
  if (observer_.frame && number > shown_)
    observer_.frame({number, now.t, now.depth, u_, f_, system_.tissue()});
  shown_ = std::max(shown_, number);
}

double ExplicitMarch::stable_step() {
  const StableStep stable = stable_time_step(system_, model_.mass, u_);
  history_.extra_evaluations += stable.iterations;
  if (!(stable.dt > 0.0))
    throw SolveError({.fact = "no stable time step was found",
                      .where = text("solver, indentation ", state_.account.depth_before * 1e3, " mm"),
                      .why = "no node is free to move, or the tissue has no stiffness",
                      .remedy = "check the model: nodes, base and material"});
  return stable.dt;
}

// Returns to the last output frame, with smaller steps. Evaluations and retries stay counted.
void ExplicitMarch::restore(const MarchState& kept, const SolveError& error) {
  const bool smaller_steps_help = error.report.code != "hourglass";
  const double depth = state_.account.depth_before, safety = state_.safety;
  History before = kept.history;
  before.evaluations = history_.evaluations;
  before.extra_evaluations = history_.extra_evaluations;
  before.retries = std::move(history_.retries);
  history_ = std::move(before);
  state_ = kept;
  system_.restore_past(kept.past);
  stopped_ = false;
  const double reached = state_.depth;  // where the tool is
  if (history_.retries.size() == most_retries || !smaller_steps_help) {
    // The curve ends at the last frame.
    if (system_.viscoelastic()) system_.begin_step(state_.dt_before);
    system_.set({.t = reached / loading_.rate, .depth = reached});
    system_.force(u_, f_);
    ledger_.add(ledger_.force({reached / loading_.rate, reached}, u_, f_));
    if (!smaller_steps_help) throw SolveError(error);
    throw after_retries(error, text("steps down to ", safety, " of the stable one"));
  }
  state_.safety = std::min(0.9, smaller * safety);
  ledger_.note(Retry{
      error.report.code, depth,
      text("back to ", 1e3 * reached, " mm, with time steps of ", state_.safety, " of the stable one")});
}

}  // namespace

void march_explicitly(System& system, const Loading& loading, const SolverOptions& options,
                      const Observer& observer, History& history, const MarchState* from) {
  ExplicitMarch(system, loading, options, observer, history, from).run();
}

}  // namespace dimple
