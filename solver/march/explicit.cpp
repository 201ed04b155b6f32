#include "solver/march/explicit.hpp"

#include <algorithm>
#include <cmath>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/text.hpp"

namespace dimple {

namespace {

using Nodal = ForceSystem::Nodal;

constexpr int between_kinetic = 25;                 // steps
constexpr std::int64_t between_fluctuations = 200;  // steps
constexpr double smaller = 0.6;                     // step, each time that a guard sends the march back

void follow_all_waves(System& system, const Loading& loading, const SolverOptions& options,
                      const Observer& observer, History& history, const State* from) {
  const Model& model = system.model();
  const Constraints& constraints = system.held();
  const Index n = model.node_count();
  const bool viscoelastic = system.viscoelastic();
  const Eigen::VectorXd inverse_mass = model.mass.cwiseInverse();

  State state;
  if (from) {
    state = *from;
    history = from->history;
    system.restore_past(from->past);
  } else {
    state.safety = options.safety;
    state.u = system.at_rest().u;
    state.v = Nodal::Zero(4, n);
    if (system.loaded()) state.external = system.stored_energy(state.u).sum();
  }
  Nodal &u = state.u, &v = state.v, f = Nodal::Zero(4, n);
  const double duration = loading.duration(), segment = duration / options.frames;

  double &previous_force = state.force_before, &previous_depth = state.depth_before;
  double &external = state.external, &dissipated = state.dissipated;
  double &next_sample = state.next_sample, &next_energy = state.next_energy;
  double &largest_reaction = state.largest_reaction, &largest_external = state.largest_external;
  double& previous_dt = state.dt_before;
  double& reached = state.depth;  // depth at which the driven nodes are
  bool stopped = false;
  int observed = state.frame - 1;  // frames
  std::int64_t& looked = state.looked;
  Guards guards(system, duration >= slow_load * shear_crossing_time(system.tissues(), model), options.guards,
                history.guards);

  // The tool brings its nodes to speed at once: the only work that is not force times way.
  if (!from) external += constraints.set_off(v, loading.rate, model.mass);

  // Everything that happens once f(u(t)) is known and before u moves on. False: stop here.
  const auto record = [&](const Moment& now, bool last) {
    const double working = constraints.working_force(f);
    external += 0.5 * (working + previous_force) * (now.depth - previous_depth);
    previous_force = working;
    previous_depth = now.depth;
    largest_external = std::max(largest_external, std::abs(external));

    if (last || now.t >= next_energy) {
      next_energy += 1.0 / options.energy_rate;
      double kinetic = 0.0;
      for (Index a = 0; a < n; ++a) {
        Eigen::Vector4d now_v = v.col(a);  // still of t - dt/2
        if (constraints.is_free(a)) now_v -= f.col(a) * (0.5 * previous_dt * inverse_mass[a]);
        kinetic += 0.5 * model.mass[a] * now_v.squaredNorm();
      }
      const StoredEnergy stored = system.stored_energy(u);
      history.energy.push_back({now.t, now.depth, kinetic, stored.sum(), external, dissipated});
      guards.check(history.energy.back(), largest_external, duration, true, now);
      guards.check_hourglass(stored.hourglass, stored.tissue, now);
    }
    if (last || now.t >= next_sample) {
      next_sample += 1.0 / options.sample_rate;
      guards.check(u, f, now);
      history.force.push_back(ForceSample::at(now.t, now.depth, system, u, f));
      largest_reaction = std::max(largest_reaction, std::abs(history.force.back().force));
      if (largest_reaction > 0.0)
        history.momentum_error = std::max(history.momentum_error, system.sum_of_tissue(f) / largest_reaction);
      if (observer.sample && !observer.sample(history.force.back(), history)) return false;
    }
    return true;
  };

  const auto frame = [&](int number, const Moment& now) {
    if (observer.frame && number > observed)
      observer.frame({number, now.t, now.depth, u, f, system.tissue()});
    observed = std::max(observed, number);
  };

  const auto stable_step = [&] {
    const StableStep stable = stable_time_step(system, model.mass, u);
    history.extra_evaluations += stable.iterations;
    if (!(stable.dt > 0.0))
      throw SolveError({.fact = "no stable time step was found",
                        .where = text("solver, indentation ", previous_depth * 1e3, " mm"),
                        .why = "no node is free to move, or the tissue has no stiffness",
                        .remedy = "check the model: nodes, base and material"});
    return stable.dt;
  };

  const auto begin_segment = [&] {
    state.step = 0;
    state.steps = static_cast<std::int64_t>(std::ceil(segment / (state.safety * state.dt_stable)));
    state.dt = segment / static_cast<double>(state.steps);
    if (state.frame == 0) {
      history.dt_stable_first = state.dt_stable;
      history.dt_first = history.dt_smallest = state.dt;
    }
    history.dt_smallest = std::min(history.dt_smallest, state.dt);
  };

  const auto march = [&] {
    const double dt = state.dt;
    for (std::int64_t& s = state.step; s < state.steps && !stopped; ++s) {
      stop_if_asked();
      const double t = segment * state.frame + dt * static_cast<double>(s);
      const Moment now = {t, loading.rate * t, dt, state.dt_stable};
      if (s == 0) guards.check_step(now);
      if (viscoelastic) system.begin_step(previous_dt);
      system.set({.t = now.t, .depth = now.depth});
      const ForceSystem::Sweep sweep = system.stress_sweep(u);
      history.J_min = std::min(history.J_min, sweep.J_min);
      history.inverted = std::max(history.inverted, sweep.inverted);
      guards.check(sweep, now);

      const double kick = 0.5 * (previous_dt > 0.0 ? previous_dt + dt : dt);
      const double keep = (1.0 - 0.5 * options.damping * kick) / (1.0 + 0.5 * options.damping * kick);
      const double impulse = kick / (1.0 + 0.5 * options.damping * kick);
      const double next_depth = loading.rate * (t + dt);
      const auto advance = [&](Index first, Index last) {
        for (Index a = first; a < last; ++a) {
          if (!constraints.is_held_wholly(a)) {
            v.col(a) = keep * v.col(a) - f.col(a) * (impulse * inverse_mass[a]);
            u.col(a) += v.col(a) * dt;
          }
          constraints.speed(a, v.col(a), loading.rate);
          constraints.place(a, u.col(a), next_depth);
        }
      };
      // Frames, energies and forces need u(t) and v(t - dt/2): there, gather first and move afterwards.
      const bool sampling = s == 0 || t >= next_energy || t >= next_sample || system.loaded();
      system.gather(u, f, sampling || viscoelastic ? std::function<void(Index, Index)>{} : advance);
      stopped = !record(now, false);
      if (s == 0) frame(state.frame, now);
      if (viscoelastic || system.loaded())
        system.accept_step(u);  // after the frame: its stresses are those of this step
      if (sampling || viscoelastic) advance(0, n);
      if (options.damping > 0.0)
        for (Index a = 0; a < n; ++a)
          if (constraints.is_free(a))
            dissipated += options.damping * model.mass[a] * v.col(a).squaredNorm() * dt;
      previous_dt = dt;
      reached = next_depth;
      ++history.steps;
      if (s % between_kinetic == between_kinetic - 1)
        guards.check_kinetic(0.5 * (v.colwise().squaredNorm() * model.mass).value(), external, now);
    }
  };

  // The segment that was marched through, looked at from its end; then the next begins.
  const auto finish_segment = [&] {
    const Moment end = {reached / loading.rate, reached, previous_dt, state.dt_stable};
    double next_stable = state.dt_stable;
    const bool last = stopped || state.frame + 1 == options.frames;
    if (!stopped) {
      guards.check(u, f, end);
      std::vector<double> force;
      for (const ForceSample& sample : history.force)
        if (sample.t >= segment * state.frame) force.push_back(sample.force);
      guards.check_smooth(force, largest_reaction, duration, end);
      if (last || history.steps - looked >= between_fluctuations) {
        guards.check_fluctuation(u, end);
        looked = history.steps;
      }
      if (options.guards || !last) next_stable = stable_step();
      guards.check_step({end.t, end.depth, previous_dt, next_stable});
    }
    if (last || options.guards) {
      system.set({.t = end.t, .depth = end.depth});
      const ForceSystem::Sweep sweep = last ? system.force(u, f) : system.stress_sweep(u);
      guards.check(sweep, end);
      guards.check_points(sweep, end);
    }
    if (last) {
      record(end, true);
      frame(options.frames, end);
    }
    ++state.frame;
    state.dt_stable = next_stable;
  };

  const auto keep = [&] {
    State copy = state;
    copy.past = system.past();
    copy.history = history;
    return copy;
  };
  const auto go_back = [&](const State& kept) {  // what was counted and tried stays
    History before = kept.history;
    before.steps = history.steps;
    before.extra_evaluations = history.extra_evaluations;
    before.retries = std::move(history.retries);
    history = std::move(before);
    state = kept;
    system.restore_past(kept.past);
    stopped = false;
  };

  if (!from) state.dt_stable = stable_step();
  State kept = keep();
  while (state.frame < options.frames && !stopped) {
    try {
      begin_segment();
      march();
      finish_segment();
      if (state.frame < options.frames && observer.between_steps) observer.between_steps(keep);
      if (options.guards) kept = keep();
    } catch (const SolveError& error) {
      if (!options.guards) throw;
      const bool smaller_steps_help = error.report.code != "hourglass";
      const double depth = previous_depth, safety = state.safety;
      go_back(kept);
      if (history.retries.size() == most_retries || !smaller_steps_help) {
        // The curve ends at the last frame.
        if (viscoelastic) system.begin_step(previous_dt);
        system.set({.t = reached / loading.rate, .depth = reached});
        system.force(u, f);
        history.force.push_back(ForceSample::at(reached / loading.rate, reached, system, u, f));
        if (!smaller_steps_help) throw;
        throw after_retries(error, text("steps down to ", safety, " of the stable one"));
      }
      state.safety = std::min(0.9, smaller * safety);
      history.retries.push_back(
          {error.report.code, depth,
           text("back to ", 1e3 * reached, " mm, with time steps of ", state.safety, " of the stable one")});
      if (observer.retry) observer.retry(history.retries.back());
    }
  }
  history.interrupted = stopped;
}

}  // namespace

void march_explicitly(System& system, const Loading& loading, const SolverOptions& options,
                      const Observer& observer, History& history, const State* from) {
  try {
    follow_all_waves(system, loading, options, observer, history, from);
  } catch (const Stopped&) {
    history.interrupted = true;
  }
}

}  // namespace dimple
