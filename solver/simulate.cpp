#include "solver/simulate.hpp"

#include <algorithm>
#include <cmath>

#include "io/error.hpp"
#include "solver/implicit.hpp"
#include "solver/text.hpp"

namespace dimple {

Constraints make_constraints(const Model& model, Contact contact) {
  Constraints result;
  result.kind.assign(static_cast<std::size_t>(model.node_count()), Constraints::Kind::free);
  for (const Index a : model.indenter)
    result.kind[static_cast<std::size_t>(a)] =
        contact == Contact::bonded ? Constraints::Kind::driven : Constraints::Kind::sliding;
  for (const Index a : model.base) result.kind[static_cast<std::size_t>(a)] = Constraints::Kind::fixed;
  result.push << model.tool.push, 0.0;
  return result;
}

namespace {

using Nodal = ForceSystem::Nodal;
using Kind = Constraints::Kind;

constexpr int between_kinetic = 25;  // steps
constexpr double smaller = 0.6;      // step, each time that a guard sends the march back

// Everything that moves on with the march.
struct March {
  Nodal u, v, f;
  double previous_force = 0.0, previous_depth = 0.0, external = 0.0, dissipated = 0.0;
  double next_sample = 0.0, next_energy = 0.0, largest_reaction = 0.0, largest_external = 0.0;
  double previous_dt = 0.0;
  double reached = 0.0;  // depth at which the driven nodes are
};

// The last good state, and how long the tables were then.
struct Kept {
  March march;
  ForceSystem::Past past;
  History history;
};

}  // namespace

void simulate(const ForceSystem& system, const Model& model, const Loading& loading,
              const SolverOptions& options, const Observer& observer, History& history) {
  const Index n = model.node_count();
  const Constraints constraints = make_constraints(model, loading.contact);
  const bool viscoelastic = system.viscoelastic();
  const auto kind = [&](Index a) { return constraints.kind[static_cast<std::size_t>(a)]; };
  const Eigen::Vector4d push = constraints.push;
  const Eigen::VectorXd inverse_mass = model.mass.cwiseInverse();

  March m;
  m.u = m.v = m.f = Nodal::Zero(4, n);
  const double duration = loading.duration(), segment = duration / options.frames;
  bool stopped = false;
  int observed = -1;  // frames
  Guards guards(system, model, duration >= slow_load * shear_crossing_time(system.tissues(), model),
                options.guards, history.guards);

  // The tool brings its nodes to speed at once: the only work that is not force times way.
  for (const Index a : model.indenter)
    if (kind(a) == Kind::driven || kind(a) == Kind::sliding) {
      m.v.col(a) = push * loading.rate;
      m.external += 0.5 * model.mass[a] * loading.rate * loading.rate;
    }

  const auto reaction = [&](const std::vector<Index>& nodes) {
    double sum = 0.0;
    for (const Index a : nodes) sum += m.f.col(a).dot(push);
    return sum;
  };

  // Everything that happens once f(u(t)) is known and before u moves on. False: stop here.
  const auto record = [&](const Moment& now, bool last) {
    const double force = reaction(model.indenter);
    m.external += 0.5 * (force + m.previous_force) * (now.depth - m.previous_depth);
    m.previous_force = force;
    m.previous_depth = now.depth;
    m.largest_external = std::max(m.largest_external, std::abs(m.external));

    if (last || now.t >= m.next_energy) {
      m.next_energy += 1.0 / options.energy_rate;
      double kinetic = 0.0, unseen = 0.0;
      for (Index a = 0; a < n; ++a) {
        Eigen::Vector4d now_v = m.v.col(a);  // still of t - dt/2
        if (kind(a) == Kind::free) now_v -= m.f.col(a) * (0.5 * m.previous_dt * inverse_mass[a]);
        kinetic += 0.5 * model.mass[a] * now_v.squaredNorm();
      }
      const double stored = system.stored_energy(m.u, &unseen);
      history.energy.push_back({now.t, now.depth, kinetic, stored, m.external, m.dissipated});
      guards.check(history.energy.back(), m.largest_external, duration, true, now);
      guards.check_unseen(unseen, stored, now);
    }
    if (last || now.t >= m.next_sample) {
      m.next_sample += 1.0 / options.sample_rate;
      guards.check(m.u, m.f, now);
      history.force.push_back({now.t, now.depth, force, -reaction(model.base)});
      m.largest_reaction = std::max(m.largest_reaction, std::abs(force));
      if (m.largest_reaction > 0.0)
        history.momentum_error =
            std::max(history.momentum_error, m.f.rowwise().sum().norm() / m.largest_reaction);
      if (observer.sample && !observer.sample(history.force.back(), history)) return false;
    }
    return true;
  };

  const auto frame = [&](int number, const Moment& now) {
    if (observer.frame && number > observed) observer.frame({number, now.t, now.depth, m.u, m.f});
    observed = std::max(observed, number);
  };

  const auto stable_step = [&] {
    const StableStep stable = stable_time_step(system, model, model.mass, constraints, m.u);
    history.extra_evaluations += stable.iterations;
    if (!(stable.dt > 0.0))
      throw SolveError({.fact = "no stable time step was found",
                        .where = text("solver, indentation ", m.previous_depth * 1e3, " mm"),
                        .why = "no node is free to move, or the tissue has no stiffness",
                        .remedy = "check the model: nodes, base and material"});
    return stable.dt;
  };

  // From frame k to the next, by at most `longest` [s].
  const auto march = [&](int k, double longest, double stable) {
    const auto steps = static_cast<std::int64_t>(std::ceil(segment / longest));
    const double dt = segment / static_cast<double>(steps);
    if (k == 0) {
      history.dt_stable_first = stable;
      history.dt_first = history.dt_smallest = dt;
    }
    history.dt_smallest = std::min(history.dt_smallest, dt);

    for (std::int64_t s = 0; s < steps && !stopped; ++s) {
      const double t = segment * k + dt * static_cast<double>(s);
      const Moment now = {t, loading.rate * t, dt, stable};
      if (s == 0) guards.check_step(now);
      if (viscoelastic) system.begin_step(m.previous_dt);
      const ForceSystem::Sweep sweep = system.stress_sweep(m.u);
      history.J_min = std::min(history.J_min, sweep.J_min);
      history.inverted = std::max(history.inverted, sweep.inverted);
      guards.check(sweep, now);
      if (s == 0) guards.check_points(sweep, now);

      const double kick = 0.5 * (m.previous_dt > 0.0 ? m.previous_dt + dt : dt);
      const double keep = (1.0 - 0.5 * options.damping * kick) / (1.0 + 0.5 * options.damping * kick);
      const double impulse = kick / (1.0 + 0.5 * options.damping * kick);
      const double next_depth = loading.rate * (t + dt);
      const auto advance = [&](Index first, Index last) {
        for (Index a = first; a < last; ++a) {
          switch (kind(a)) {
            case Kind::fixed:
              break;
            case Kind::driven:
              m.v.col(a) = push * loading.rate;
              m.u.col(a) = push * next_depth;
              break;
            default:
              m.v.col(a) = keep * m.v.col(a) - m.f.col(a) * (impulse * inverse_mass[a]);
              m.u.col(a) += m.v.col(a) * dt;
              if (kind(a) == Kind::free) break;
              m.v.col(a) += push * (loading.rate - m.v.col(a).dot(push));
              m.u.col(a) += push * (next_depth - m.u.col(a).dot(push));
          }
        }
      };
      // Frames and energies need u(t) and v(t - dt/2): there, gather first and move afterwards.
      const bool sampling = s == 0 || t >= m.next_energy;
      system.gather_sweep(m.f, sampling || viscoelastic ? std::function<void(Index, Index)>{} : advance);
      stopped = !record(now, false);
      if (s == 0) frame(k, now);
      if (viscoelastic) system.accept_step(m.u);  // after the frame: its stresses are those of this step
      if (sampling || viscoelastic) advance(0, n);
      if (options.damping > 0.0)
        for (Index a = 0; a < n; ++a)
          if (kind(a) == Kind::free)
            m.dissipated += options.damping * model.mass[a] * m.v.col(a).squaredNorm() * dt;
      m.previous_dt = dt;
      m.reached = next_depth;
      ++history.steps;
      if (s % between_kinetic == between_kinetic - 1)
        guards.check_kinetic(0.5 * (m.v.colwise().squaredNorm() * model.mass).value(), m.external, now);
    }
  };

  const auto finish = [&] {
    const Moment end = {m.reached / loading.rate, m.reached, m.previous_dt, 0.0};
    const ForceSystem::Sweep sweep = system.internal_force(m.u, m.f);
    guards.check(sweep, end);
    guards.check_points(sweep, end);
    record(end, true);
    frame(options.frames, end);
  };

  double stable = stable_step(), safety = options.safety;
  const auto keep = [&] { return Kept{m, system.past(), history}; };
  Kept kept = keep();
  for (int k = 0; k < options.frames && !stopped;) {
    try {
      march(k, safety * stable, stable);
      const double t = segment * (k + 1);
      double next = stable;
      if (!stopped && options.guards) guards.check(m.u, m.f, {t, loading.rate * t, m.previous_dt, stable});
      if (!stopped && (options.guards || k + 1 < options.frames)) next = stable_step();
      if (!stopped) guards.check_step({t, loading.rate * t, m.previous_dt, next});
      if (k + 1 == options.frames || stopped) finish();
      ++k;
      stable = next;
      if (options.guards) kept = keep();
    } catch (const SolveError& error) {
      if (!options.guards) throw;
      // What was counted and tried stays; all else is as it was at the last frame.
      const double depth = m.previous_depth;
      kept.history.steps = history.steps;
      kept.history.extra_evaluations = history.extra_evaluations;
      m = kept.march;
      system.restore(kept.past);
      history = kept.history;
      stopped = false;
      if (history.retries.size() == most_retries)
        throw after_retries(error, text("steps down to ", safety, " of the stable one"));
      safety = std::min(0.9, smaller * safety);
      history.retries.push_back({error.report.code, depth,
                                 text("back to ", 1e3 * m.previous_depth, " mm, with time steps of ", safety,
                                      " of the stable one")});
      kept.history.retries = history.retries;
      if (observer.retry) observer.retry(history.retries.back());
    }
  }
  history.interrupted = stopped;
}

}  // namespace dimple
