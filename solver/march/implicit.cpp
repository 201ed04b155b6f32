#include "solver/march/implicit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/equilibrium/mixed_iteration.hpp"
#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/march/path.hpp"
#include "solver/text.hpp"

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;

constexpr double steps_per_period = 6.0;
constexpr double alpha = -1.0 / 3.0, beta = (1.0 - alpha) * (1.0 - alpha) / 4.0, gamma = 0.5 - alpha;
// Of a step: its error does not add up, since the next one starts from the forces that were found.
constexpr double roughly = 1e-3;
constexpr std::size_t remembered = 2;  // states, for the guess of the next: more amplify what they are off
constexpr double shorter = 0.25;       // step, of the longest, that is tried when that does not converge
constexpr double of_stable_step = 0.9;
constexpr std::int64_t most_small_steps = 20000;  // in place of a long one; usual: some hundreds
constexpr std::int64_t same_step = 200;           // of them, until the stable step is asked for again

void step_implicitly(System& system, const Loading& loading, const SolverOptions& options,
                     const Observer& observer, History& history, const State* from) {
  const Model& model = system.model();
  const Constraints& constraints = system.held();
  MixedIteration solve(system);
  const Index n = model.node_count();
  const double segment = loading.duration() / options.frames, damping = options.damping;
  // Of a shear wave that stands between the base and the tool's side.
  const double slowest_period = 4.0 * shear_crossing_time(system.tissues(), model);
  const auto steps = static_cast<std::int64_t>(std::ceil(segment / (slowest_period / steps_per_period)));
  const double longest = segment / static_cast<double>(steps);

  Path past(remembered);
  MixedIteration::Inertia inertia;
  State state;
  Nodal &u = state.u, &v = state.v, &a = state.a, &f = state.f;
  Eigen::VectorXd& lambda = state.lambda;
  double &external = state.external, &dissipated = state.dissipated, &force_before = state.force_before;
  double &largest_reaction = state.largest_reaction, &next_energy = state.next_energy;
  double &t = state.t, &dt = state.dt;
  if (from) {
    state = *from;
    history = from->history;
    past.state = from->path;
    system.restore_past(from->past);
    solve.restore(from->mixed);
    inertia.inertia = from->mixed.inertia;
  } else {
    u = system.at_rest().u;
    lambda = system.at_rest().lambda;
    v = a = f = Nodal::Zero(4, n);
    if (system.loaded()) {  // in equilibrium: f is the reactions
      system.tissue().hold_pressures(lambda.cwiseQuotient(model.patches.volume));
      system.force(u, f);
      external = system.stored_energy(u).sum();
    }
    past.push(0.0, u, lambda);
    history.dt_first = history.dt_smallest = longest;
    // The tool brings its nodes to speed at once: the only work that is not force times way.
    external += constraints.set_off(v, loading.rate, model.mass);
  }

  Guards guards(system, loading.duration() >= slow_load * shear_crossing_time(system.tissues(), model),
                options.guards, history.guards);
  double& largest_external = state.largest_external;
  const auto record = [&](bool last) {
    const double depth = loading.rate * t;
    history.force.push_back(ForceSample::at(t, depth, system, u, f));
    largest_reaction = std::max(largest_reaction, std::abs(history.force.back().force));
    if (largest_reaction > 0.0)
      history.momentum_error = std::max(history.momentum_error, system.sum_of_tissue(f) / largest_reaction);
    if (last || t >= next_energy) {
      next_energy = t + 1.0 / options.energy_rate;
      const double kinetic = 0.5 * (v.colwise().squaredNorm() * model.mass).value();
      const StoredEnergy stored = system.stored_energy(u);
      history.energy.push_back({t, depth, kinetic, stored.sum(), external, dissipated});
      largest_external = std::max(largest_external, std::abs(external));
      guards.check(history.energy.back(), largest_external, loading.duration(), false, {t, depth, dt});
      guards.check_hourglass(stored.hourglass, stored.tissue, {t, depth, dt});
    }
    return !observer.sample || observer.sample(history.force.back(), history);
  };

  // What follows the end of a step. False: stop here.
  const auto arrive = [&](int frame, double end, double step) {
    past.push(t, u, lambda);
    history.dt_smallest = std::min(history.dt_smallest, step);
    ++history.steps;
    const bool at_end = end - t <= 1e-6 * longest, goes_on = record(frame == options.frames && at_end);
    if (at_end && observer.frame) observer.frame({frame, t, loading.rate * t, u, f, system.tissue()});
    system.accept_step(u);
    if (observer.between_steps && (frame < options.frames || !at_end))
      observer.between_steps([&] {
        State copy = state;
        copy.path = past.state;
        copy.mixed = solve.memory();
        copy.past = system.past();
        copy.history = history;
        return copy;
      });
    return goes_on;
  };
  // Central differences until `to`, as march_explicitly(): where the tissue gives way the path jumps, and no
  // step that is longer than the jump's own waves has an end that an iteration could find.
  const auto march = [&](double to) {
    system.begin_step(to - t);
    system.set({.t = t, .depth = loading.rate * t});
    system.tissue().hold_pressures({});
    const auto where = [&] {
      return text("solver, t = ", t, " s, indentation ", loading.rate * t * 1e3, " mm");
    };
    const auto accelerate = [&](double h, double stable) {
      const ForceSystem::Sweep sweep = system.force(u, f);
      guards.check(sweep, {t, loading.rate * t, h, stable});
      history.J_min = std::min(history.J_min, sweep.J_min);
      history.inverted = std::max(history.inverted, sweep.inverted);
      for (Index i = 0; i < n; ++i)
        a.col(i) = constraints.project(i, -f.col(i) / model.mass[i] - damping * v.col(i));
      ++history.extra_evaluations;
    };
    std::int64_t taken = 0;
    while (to - t > 1e-9 * longest) {
      // Again and again: tissue that is squeezed on the way bears shorter steps only.
      const StableStep stable = stable_time_step(system, model.mass, u);
      history.extra_evaluations += stable.iterations;
      if (!(stable.dt > 0.0))
        throw SolveError({.fact = "a time step did not converge, and no stable one was found",
                          .where = where(),
                          .why = "the load is more than this cloud can follow",
                          .remedy = "use more nodes (--nodes) or a smaller --depth",
                          .code = "no-equilibrium"});
      const double needed = std::ceil((to - t) / (of_stable_step * stable.dt));
      if (needed + static_cast<double>(taken) > static_cast<double>(most_small_steps))
        throw SolveError(
            {.fact = text("a time step did not converge, and ", needed,
                          " stable ones would be needed in its place"),
             .where = text(where(), "; stable step ", stable.dt, " s"),
             .why = text("more than ", most_small_steps,
                         " are not taken: tissue is compressed beyond what this cloud can follow"),
             .remedy = "use more nodes (--nodes), a smaller --depth, or --time explicit, which "
                       "takes as many steps as there must be",
             .code = "no-equilibrium"});
      const auto left = static_cast<std::int64_t>(needed), count = std::min(left, same_step);
      const double h = (to - t) / static_cast<double>(left), start = t;
      accelerate(h, stable.dt);
      for (std::int64_t k = 1; k <= count; ++k) {
        stop_if_asked();
        v += 0.5 * h * a;
        u += h * v;
        t = k == left ? to : start + h * static_cast<double>(k);
        system.set({.t = t, .depth = loading.rate * t}, u);
        accelerate(h, stable.dt);
        v += 0.5 * h * a;
        for (Index i = 0; i < n; ++i)
          if (constraints.is_free(i)) dissipated += damping * model.mass[i] * v.col(i).squaredNorm() * h;
        const double force = constraints.working_force(f);
        external += 0.5 * (force + force_before) * loading.rate * h;
        force_before = force;
      }
      taken += count;
    }
    lambda = pressures_of_volumes(system);
  };

  if (!from) {
    record(false);
    if (observer.frame) observer.frame({0, 0.0, 0.0, u, f, system.tissue()});
  }
  bool stopped = false;
  bool& anew = state.anew;
  for (int frame = std::max(state.frame, 1); frame <= options.frames && !stopped; ++frame) {
    const double end = segment * frame;
    if (frame > state.frame) dt = longest;
    state.frame = frame;
    while (end - t > 1e-6 * longest && !stopped) {
      const double to = std::min(t + dt, end), h = to - t, depth = loading.rate * to;
      // a+ = (u+ - reached) / (beta h^2), v+ = drift + gamma h a+.
      const Nodal reached = u + h * v + (0.5 - beta) * h * h * a, drift = v + (1.0 - gamma) * h * a;
      const double stiff = (1.0 + gamma * h * damping) / (beta * h * h * (1.0 + alpha));
      if (inertia.inertia.size() == 0 || std::abs(inertia.inertia[0] / model.mass[0] / stiff - 1.0) > 1e-9)
        inertia.inertia = stiff * model.mass;
      inertia.about = reached - damping / (1.0 + alpha) / stiff * drift +
                      (alpha / (1.0 + alpha) / stiff) * f * model.mass.cwiseInverse().asDiagonal();
      Nodal next = Nodal::Zero(4, n);
      Eigen::VectorXd next_lambda = Eigen::VectorXd::Zero(lambda.size());
      past.extrapolate(to, next, next_lambda);
      system.set({.t = to, .depth = depth}, next);
      system.begin_step(h);
      const Nodal f_before = f;
      const Relaxed found =
          solve(next, next_lambda, f,
                {.tolerance = std::max(options.tolerance, roughly), .evaluations = options.evaluations}, anew,
                &inertia);
      history.extra_evaluations += found.evaluations;
      if (!found.converged) {
        f = f_before;
        anew = true;
        if (h > 1.01 * shorter * longest) {
          dt = std::max(0.5 * h, shorter * longest);
          continue;
        }
        const double start = t, until = std::min(t + longest, end);
        history.retries.push_back({"no-equilibrium", loading.rate * t,
                                   text("by central differences to ", 1e3 * loading.rate * until, " mm")});
        if (observer.retry) observer.retry(history.retries.back());
        march(until);
        dt = shorter * longest;  // the next is tried carefully
        stopped = !arrive(frame, end, t - start);
        continue;
      }
      const Moment now = {to, depth, h};
      guards.check(found.sweep, now);
      guards.check(next, f, now);
      if (end - to <= 1e-6 * longest) guards.check_points(found.sweep, now);
      anew = false;
      for (Index i = 0; i < n; ++i) {
        const Eigen::Vector4d v_before = v.col(i);
        a.col(i) = (next.col(i) - reached.col(i)) / (beta * h * h);
        v.col(i) = drift.col(i) + gamma * h * a.col(i);
        if (constraints.is_free(i)) {
          dissipated += damping * model.mass[i] * 0.25 * (v.col(i) + v_before).squaredNorm() * h;
          continue;
        }
        // What moves with the tool has one speed from the start.
        constraints.speed(i, v.col(i), loading.rate);
        a.col(i) = constraints.project(i, a.col(i));
      }
      u = next;
      lambda = next_lambda;
      t = to;
      history.J_min = std::min(history.J_min, found.sweep.J_min);
      history.inverted = std::max(history.inverted, found.sweep.inverted);
      history.residual = std::max(history.residual, found.residual);
      const double force = constraints.working_force(f);
      external += 0.5 * (force + force_before) * loading.rate * h;
      force_before = force;
      dt = std::min(2.0 * h, longest);
      stopped = !arrive(frame, end, h);
    }
  }
  history.interrupted = stopped;
}

}  // namespace

void march_implicitly(System& system, const Loading& loading, const SolverOptions& options,
                      const Observer& observer, History& history, const State* from) {
  try {
    step_implicitly(system, loading, options, observer, history, from);
  } catch (const Stopped&) {
    history.interrupted = true;
  }
}

}  // namespace dimple
