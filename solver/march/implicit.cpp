#include "solver/march/implicit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/equilibrium/mixed_iteration.hpp"
#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/march/central_differences.hpp"
#include "solver/march/ledger.hpp"
#include "solver/march/predictor.hpp"
#include "solver/text.hpp"

namespace dimple {
namespace {

constexpr double steps_per_period = 6.0;
constexpr double alpha = -1.0 / 3.0, beta = (1.0 - alpha) * (1.0 - alpha) / 4.0, gamma = 0.5 - alpha;
// Of a step: its error does not add up, since the next one starts from the forces that were found.
constexpr double roughly = 1e-3;
constexpr std::size_t remembered = 2;  // states, for the guess of the next: more amplify what they are off
constexpr double shorter = 0.25;       // step, of the longest, that is tried when that does not converge
constexpr double of_stable_step = 0.9;
constexpr std::int64_t most_small_steps = 20000;  // in place of a long one; usual: some hundreds
constexpr std::int64_t same_step = 200;           // of them, until the stable step is asked for again
constexpr double same_time = 1e-6;                // of the longest step

// What the rule makes of u, v and a in a step of h [s], but for what it adds of the acceleration at its end:
//
//     u+ = reached + beta h^2 a+,   v+ = drift + gamma h a+
struct BeforeAcceleration {
  double h;
  Nodal reached, drift;
  BeforeAcceleration(const MarchState& s, double h_)
      : h(h_), reached(s.u + h * s.v + (0.5 - beta) * h * h * s.a), drift(s.v + (1.0 - gamma) * h * s.a) {}
};

class ImplicitMarch {
 public:
  ImplicitMarch(System& system, const Loading& loading, const SolverOptions& options,
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
  Nodal &u_, &v_, &a_, &f_;
  Ledger ledger_;
  Guards guards_;
  MixedIteration solve_;
  MixedIteration::Inertia inertia_;
  Predictor past_{remembered};
  const Eigen::VectorXd inverse_mass_;
  const double stretch_;  // from a frame to the next [s]
  double longest_;        // step [s]
  bool stopped_ = false;

  void begin_at_rest();
  void step_towards(double end);
  void balance_with_inertia(const BeforeAcceleration& before);
  void check(const Relaxed& found, const Nodal& next, const Moment& now, bool ends_stretch);
  void take(const BeforeAcceleration& before, const Nodal& next, const Eigen::VectorXd& next_lambda,
            double to);
  void shorten(double h, double end);
  void step_explicitly(double to);
  std::int64_t small_steps(double to, double stable, std::int64_t taken) const;
  void find_force(const Moment& now);
  void small_step(double h, double to, double stable);
  void add_work(double h);
  bool arrive(double end, double step);
  bool write(bool last);
  void write_energy(const Moment& now);
};

ImplicitMarch::ImplicitMarch(System& system, const Loading& loading, const SolverOptions& options,
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
      a_(state_.a),
      f_(state_.f),
      ledger_(system, options, observer, state_.account, history),
      guards_(system, loading.duration() >= slow_load * shear_crossing_time(system.tissues(), model_),
              options.guards, history.guards),
      solve_(system),
      inverse_mass_(model_.mass.cwiseInverse()),
      stretch_(loading.duration() / options.frames) {
  // Of a shear wave that stands between the base and the tool's side.
  const double slowest_period = 4.0 * shear_crossing_time(system.tissues(), model_);
  longest_ = stretch_ / std::ceil(stretch_ / (slowest_period / steps_per_period));
  if (from) {
    history = from->history;
    past_.point = from->path;
    system.restore_past(from->past);
    solve_.restore(from->mixed);
    inertia_.inertia = from->mixed.inertia;
  } else {
    begin_at_rest();
  }
}

void ImplicitMarch::begin_at_rest() {
  u_ = system_.step_start().u;
  state_.lambda = system_.step_start().lambda;
  v_ = a_ = f_ = Nodal::Zero(4, model_.node_count());
  if (system_.loaded()) {  // in equilibrium: f is the reactions
    system_.force_at(u_, state_.lambda, f_);
    ledger_.add_work(system_.stored_energy(u_).sum());
  }
  past_.push(0.0, u_, state_.lambda);
  history_.dt_first = history_.dt_smallest = longest_;
  // The tool brings its nodes to speed at once: the only work that is not force times way.
  ledger_.add_work(held_.set_off(v_, loading_.rate, model_.mass));
  write(false);
  if (observer_.frame) observer_.frame({0, 0.0, 0.0, u_, f_, system_.tissue()});
}

void ImplicitMarch::run() {
  for (int frame = std::max(state_.frame, 1); frame <= options_.frames && !stopped_; ++frame) {
    const double end = stretch_ * frame;
    if (frame > state_.frame) state_.dt = longest_;
    state_.frame = frame;
    while (end - state_.t > same_time * longest_ && !stopped_) step_towards(end);
  }
  history_.interrupted = stopped_;
}

void ImplicitMarch::step_towards(double end) {
  const double to = std::min(state_.t + state_.dt, end), h = to - state_.t, depth = loading_.rate * to;
  const BeforeAcceleration before(state_, h);
  balance_with_inertia(before);
  Nodal next = Nodal::Zero(4, u_.cols());
  Eigen::VectorXd next_lambda = Eigen::VectorXd::Zero(state_.lambda.size());
  past_.extrapolate(to, next, next_lambda);
  system_.set({.t = to, .depth = depth}, next);
  system_.begin_step(h);
  const Nodal f_before = f_;
  const Relaxed found =
      solve_(next, next_lambda, f_,
             {.tolerance = std::max(options_.tolerance, roughly), .evaluations = options_.evaluations},
             state_.anew, &inertia_);
  history_.extra_evaluations += found.evaluations;
  if (!found.converged) {
    f_ = f_before;
    state_.anew = true;
    return shorten(h, end);
  }
  check(found, next, {to, depth, h}, end - to <= same_time * longest_);
  take(before, next, next_lambda, to);
  ledger_.keep_worst(found.sweep);
  history_.residual = std::max(history_.residual, found.residual);
  add_work(h);
  state_.dt = std::min(2.0 * h, longest_);
  stopped_ = !arrive(end, h);
}

// The rule's equation at the step's end, over 1 + alpha: f + inertia (u+ - about) = 0.
void ImplicitMarch::balance_with_inertia(const BeforeAcceleration& before) {
  const double h = before.h, damping = options_.damping;
  const double stiff = (1.0 + gamma * h * damping) / (beta * h * h * (1.0 + alpha));
  if (inertia_.inertia.size() == 0 || std::abs(inertia_.inertia[0] / model_.mass[0] / stiff - 1.0) > 1e-9)
    inertia_.inertia = stiff * model_.mass;
  inertia_.about = before.reached - damping / (1.0 + alpha) / stiff * before.drift +
                   (alpha / (1.0 + alpha) / stiff) * f_ * model_.mass.cwiseInverse().asDiagonal();
}

void ImplicitMarch::check(const Relaxed& found, const Nodal& next, const Moment& now, bool ends_stretch) {
  guards_.check_sweep(found.sweep, now);
  guards_.check_nodes(next, f_, now);
  if (ends_stretch) guards_.check_points(found.sweep, now);
}

void ImplicitMarch::take(const BeforeAcceleration& before, const Nodal& next,
                         const Eigen::VectorXd& next_lambda, double to) {
  const double h = before.h;
  for (Index i = 0; i < u_.cols(); ++i) {
    const Eigen::Vector4d v_before = v_.col(i);
    a_.col(i) = (next.col(i) - before.reached.col(i)) / (beta * h * h);
    v_.col(i) = before.drift.col(i) + gamma * h * a_.col(i);
    if (held_.is_free(i)) {
      state_.account.dissipated +=
          options_.damping * model_.mass[i] * 0.25 * (v_.col(i) + v_before).squaredNorm() * h;
      continue;
    }
    // What moves with the tool has one speed from the start.
    held_.speed(i, v_.col(i), loading_.rate);
    a_.col(i) = held_.project(i, a_.col(i));
  }
  u_ = next;
  state_.lambda = next_lambda;
  state_.t = to;
  state_.anew = false;
}

// After a step of h that did not converge.
void ImplicitMarch::shorten(double h, double end) {
  if (h > 1.01 * shorter * longest_) {
    state_.dt = std::max(0.5 * h, shorter * longest_);
    return;
  }
  const double start = state_.t, until = std::min(start + longest_, end);
  ledger_.note(Retry{"no-equilibrium", loading_.rate * start,
                     text("by central differences to ", 1e3 * loading_.rate * until, " mm")});
  step_explicitly(until);
  state_.dt = shorter * longest_;  // the next is tried carefully
  stopped_ = !arrive(end, until - start);
}

// As march_explicitly(): where the tissue gives way the path jumps, and no step that is longer than the
// jump's own waves has an end that an iteration could find.
void ImplicitMarch::step_explicitly(double to) {
  system_.begin_step(to - state_.t);
  system_.set({.t = state_.t, .depth = loading_.rate * state_.t});
  system_.tissue().hold_pressures({});
  std::int64_t taken = 0;
  while (to - state_.t > 1e-9 * longest_) {
    // Again and again: tissue that is squeezed on the way bears shorter steps only.
    const StableStep stable = stable_time_step(system_, model_.mass, u_);
    history_.extra_evaluations += stable.iterations;
    const std::int64_t left = small_steps(to, stable.dt, taken), count = std::min(left, same_step);
    const double h = (to - state_.t) / static_cast<double>(left), start = state_.t;
    find_force({start, loading_.rate * start, h, stable.dt});
    for (std::int64_t k = 1; k <= count; ++k)
      small_step(h, k == left ? to : start + h * static_cast<double>(k), stable.dt);
    taken += count;
  }
  for (Index i = 0; i < u_.cols(); ++i)
    a_.col(i) = held_.project(i, -f_.col(i) * inverse_mass_[i] - options_.damping * v_.col(i));
  state_.lambda = pressures_of_volumes(system_);
}

// How many it takes. Throws where they are too many.
std::int64_t ImplicitMarch::small_steps(double to, double stable, std::int64_t taken) const {
  const auto where = [&] {
    return text("solver, t = ", state_.t, " s, indentation ", loading_.rate * state_.t * 1e3, " mm");
  };
  if (!(stable > 0.0))
    throw SolveError({.fact = "a time step did not converge, and no stable one was found",
                      .where = where(),
                      .why = "the load is more than this cloud can follow",
                      .remedy = "use more nodes (--nodes) or a smaller --depth",
                      .code = "no-equilibrium"});
  const double needed = std::ceil((to - state_.t) / (of_stable_step * stable));
  if (needed + static_cast<double>(taken) > static_cast<double>(most_small_steps))
    throw SolveError({.fact = text("a time step did not converge, and ", needed,
                                   " stable ones would be needed in its place"),
                      .where = text(where(), "; stable step ", stable, " s"),
                      .why = text("more than ", most_small_steps,
                                  " are not taken: tissue is compressed beyond what this cloud can follow"),
                      .remedy = "use more nodes (--nodes), a smaller --depth, or --time explicit, which "
                                "takes as many steps as there must be",
                      .code = "no-equilibrium"});
  return static_cast<std::int64_t>(needed);
}

void ImplicitMarch::find_force(const Moment& now) {
  const ForceSystem::Sweep sweep = system_.force(u_, f_);
  guards_.check_sweep(sweep, now);
  ledger_.keep_worst(sweep);
  ++history_.extra_evaluations;
}

// Half of the leapfrog's kick before and half after, so that v too is that of the step's end.
void ImplicitMarch::small_step(double h, double to, double stable) {
  stop_if_asked();
  CentralDifferences half{.dt = h,
                          .kick = 0.5 * h,
                          .rate = loading_.rate,
                          .depth = loading_.rate * to,
                          .damping = options_.damping};
  half(0, u_.cols(), held_, inverse_mass_, f_, v_, u_);
  state_.t = to;
  system_.set({.t = to, .depth = half.depth});
  find_force({to, half.depth, h, stable});
  half.dt = 0.0;
  half(0, u_.cols(), held_, inverse_mass_, f_, v_, u_);
  for (Index i = 0; i < u_.cols(); ++i)
    if (held_.is_free(i))
      state_.account.dissipated += options_.damping * model_.mass[i] * v_.col(i).squaredNorm() * h;
  add_work(h);
}

void ImplicitMarch::add_work(double h) {
  const double mean = ledger_.mean_force(f_);
  ledger_.add_work(mean * loading_.rate * h);
}

// What follows the end of a step. False: stop here.
bool ImplicitMarch::arrive(double end, double step) {
  past_.push(state_.t, u_, state_.lambda);
  history_.dt_smallest = std::min(history_.dt_smallest, step);
  ++history_.evaluations;
  const int frame = state_.frame;
  const bool at_end = end - state_.t <= same_time * longest_,
             goes_on = write(frame == options_.frames && at_end);
  if (at_end && observer_.frame)
    observer_.frame({frame, state_.t, loading_.rate * state_.t, u_, f_, system_.tissue()});
  system_.accept_step(u_);
  if (observer_.between_steps && (frame < options_.frames || !at_end))
    observer_.between_steps([&] {
      MarchState copy = ledger_.kept(state_);
      copy.path = past_.point;
      copy.mixed = solve_.memory();
      return copy;
    });
  return goes_on;
}

bool ImplicitMarch::write(bool last) {
  const Moment now = {state_.t, loading_.rate * state_.t, state_.dt};
  ledger_.write(ledger_.force(now, u_, f_), f_);
  if (last || ledger_.energy_is_due(now.t)) write_energy(now);
  return ledger_.show_force();
}

void ImplicitMarch::write_energy(const Moment& now) {
  ledger_.next_energy_after(now.t);
  const double kinetic = 0.5 * (v_.colwise().squaredNorm() * model_.mass).value();
  const StoredEnergy stored = system_.stored_energy(u_);
  ledger_.write(ledger_.energy(now, kinetic, stored));
  guards_.check_energy(history_.energy.back(), state_.account.largest_external, loading_.duration(), false,
                       now);
  guards_.check_hourglass(stored.hourglass, stored.tissue, now);
}

}  // namespace

void march_implicitly(System& system, const Loading& loading, const SolverOptions& options,
                      const Observer& observer, History& history, const MarchState* from) {
  ImplicitMarch(system, loading, options, observer, history, from).run();
}

}  // namespace dimple
