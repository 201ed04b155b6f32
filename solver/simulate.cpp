#include "solver/simulate.hpp"

#include <algorithm>
#include <cmath>

#include "io/error.hpp"
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

struct Place {
  double t, depth, dt, dt_stable;
};

[[noreturn]] void stop_inverted(const Model& model, const ForceSystem::Sweep& sweep, const Place& now) {
  const Vec3 x = model.point.col(sweep.point) * 1e3;
  const bool number = std::isfinite(sweep.J_min);
  throw SolveError(
      {.fact = number ? text("the tissue turned inside out: det F = ", sweep.J_min, " at integration point ",
                             sweep.point)
                      : text("the displacement is no longer a number at integration point ", sweep.point),
       .where =
           text("solver, t = ", now.t, " s, indentation ", now.depth * 1e3, " mm; point at rest at (", x.x(),
                ", ", x.y(), ", ", x.z(), ") mm; step ", now.dt, " s, stable ", now.dt_stable, " s"),
       .why = "the load is more than this cloud can follow, or the time step was too long",
       .remedy = "use more nodes (--nodes), a smaller --depth, or a smaller solver.safety"});
}

[[noreturn]] void stop_energy(const EnergySample& e, const Place& now) {
  throw SolveError({.fact = text("energy appeared from nowhere: the tool did ", e.external,
                                 " J of work, the tissue holds ", e.kinetic + e.stored + e.dissipated, " J"),
                    .where = text("solver, t = ", now.t, " s, indentation ", now.depth * 1e3, " mm; step ",
                                  now.dt, " s, stable ", now.dt_stable, " s"),
                    .why = "the time integration became unstable",
                    .remedy = "use a smaller solver.safety, for instance --set solver.safety=0.6"});
}

}  // namespace

void simulate(const ForceSystem& system, const Model& model, const Loading& loading,
              const SolverOptions& options, const Observer& observer, History& history, const State* from) {
  const Index n = model.node_count();
  const Constraints constraints = make_constraints(model, loading.contact);
  const bool viscoelastic = system.viscoelastic();
  const auto kind = [&](Index a) { return constraints.kind[static_cast<std::size_t>(a)]; };
  const Eigen::Vector4d push = constraints.push;
  const Eigen::VectorXd inverse_mass = model.mass.cwiseInverse();

  State state;
  if (from) {
    state = *from;
    history = from->history;
    system.restore_past(from->past);
  } else {
    state.u = state.v = Nodal::Zero(4, n);
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

  // The tool brings its nodes to speed at once: the only work that is not force times way.
  for (const Index a : model.indenter)
    if (!from && (kind(a) == Kind::driven || kind(a) == Kind::sliding)) {
      v.col(a) = push * loading.rate;
      external += 0.5 * model.mass[a] * loading.rate * loading.rate;
    }

  const auto reaction = [&](const std::vector<Index>& nodes) {
    double sum = 0.0;
    for (const Index a : nodes) sum += f.col(a).dot(push);
    return sum;
  };

  // Everything that happens once f(u(t)) is known and before u moves on. False: stop here.
  const auto record = [&](const Place& now, bool last) {
    const double force = reaction(model.indenter);
    external += 0.5 * (force + previous_force) * (now.depth - previous_depth);
    previous_force = force;
    previous_depth = now.depth;
    largest_external = std::max(largest_external, std::abs(external));

    if (last || now.t >= next_energy) {
      next_energy += 1.0 / options.energy_rate;
      double kinetic = 0.0;
      for (Index a = 0; a < n; ++a) {
        Eigen::Vector4d now_v = v.col(a);  // still of t - dt/2
        if (kind(a) == Kind::free) now_v -= f.col(a) * (0.5 * previous_dt * inverse_mass[a]);
        kinetic += 0.5 * model.mass[a] * now_v.squaredNorm();
      }
      history.energy.push_back({now.t, now.depth, kinetic, system.stored_energy(u), external, dissipated});
      const EnergySample& e = history.energy.back();
      const bool conservative = !system.as_printed() && !viscoelastic;
      if (!std::isfinite(e.kinetic) || (conservative && -e.error() > 0.1 * largest_external + 1e-9))
        stop_energy(e, now);
    }
    if (last || now.t >= next_sample) {
      next_sample += 1.0 / options.sample_rate;
      history.force.push_back({now.t, now.depth, force, -reaction(model.base)});
      largest_reaction = std::max(largest_reaction, std::abs(force));
      if (largest_reaction > 0.0)
        history.momentum_error =
            std::max(history.momentum_error, f.rowwise().sum().norm() / largest_reaction);
      if (observer.sample && !observer.sample(history.force.back(), history)) return false;
    }
    return true;
  };

  const auto frame = [&](int number, const Place& now) {
    if (observer.frame) observer.frame({number, now.t, now.depth, u, f});
  };

  const auto begin_segment = [&](int k) {
    const StableStep stable = stable_time_step(system, model, model.mass, constraints, u);
    history.extra_evaluations += stable.iterations;
    if (!(stable.dt > 0.0))
      throw SolveError({.fact = "no stable time step was found",
                        .where = text("solver, indentation ", previous_depth * 1e3, " mm"),
                        .why = "no node is free to move, or the tissue has no stiffness",
                        .remedy = "check the model: nodes, base and material"});
    state.frame = k;
    state.step = 0;
    state.steps = static_cast<std::int64_t>(std::ceil(segment / (options.safety * stable.dt)));
    state.dt = segment / static_cast<double>(state.steps);
    state.dt_stable = stable.dt;
    if (k == 0) {
      history.dt_stable_first = stable.dt;
      history.dt_first = history.dt_smallest = state.dt;
    }
    history.dt_smallest = std::min(history.dt_smallest, state.dt);
  };

  for (int k = state.frame; k < options.frames && !stopped; ++k) {
    if (!from || k > from->frame) begin_segment(k);
    const double dt = state.dt;
    for (std::int64_t& s = state.step; s < state.steps && !stopped; ++s) {
      if (observer.between_steps)
        observer.between_steps([&] {
          State copy = state;
          copy.history = history;
          copy.past = system.past();
          return copy;
        });
      const double t = segment * k + dt * static_cast<double>(s);
      const Place now = {t, loading.rate * t, dt, state.dt_stable};
      if (viscoelastic) system.begin_step(previous_dt);
      const ForceSystem::Sweep sweep = system.stress_sweep(u);
      history.J_min = std::min(history.J_min, sweep.J_min);
      history.inverted = std::max(history.inverted, sweep.inverted);
      if (!sweep.ok()) stop_inverted(model, sweep, now);

      const double kick = 0.5 * (previous_dt > 0.0 ? previous_dt + dt : dt);
      const double keep = (1.0 - 0.5 * options.damping * kick) / (1.0 + 0.5 * options.damping * kick);
      const double impulse = kick / (1.0 + 0.5 * options.damping * kick);
      const double next_depth = loading.rate * (t + dt);
      const auto advance = [&](Index first, Index last) {
        for (Index a = first; a < last; ++a) {
          switch (kind(a)) {
            case Kind::fixed:
              break;
            case Kind::driven:
              v.col(a) = push * loading.rate;
              u.col(a) = push * next_depth;
              break;
            default:
              v.col(a) = keep * v.col(a) - f.col(a) * (impulse * inverse_mass[a]);
              u.col(a) += v.col(a) * dt;
              if (kind(a) == Kind::free) break;
              v.col(a) += push * (loading.rate - v.col(a).dot(push));
              u.col(a) += push * (next_depth - u.col(a).dot(push));
          }
        }
      };
      // Frames and energies need u(t) and v(t - dt/2): there, gather first and move afterwards.
      const bool sampling = s == 0 || t >= next_energy;
      system.gather_sweep(f, sampling || viscoelastic ? std::function<void(Index, Index)>{} : advance);
      stopped = !record(now, false);
      if (s == 0) frame(k, now);
      if (viscoelastic) system.accept_step(u);  // after the frame: its stresses are those of this step
      if (sampling || viscoelastic) advance(0, n);
      if (options.damping > 0.0)
        for (Index a = 0; a < n; ++a)
          if (kind(a) == Kind::free)
            dissipated += options.damping * model.mass[a] * v.col(a).squaredNorm() * dt;
      previous_dt = dt;
      reached = next_depth;
      ++history.steps;
    }
  }

  const Place end = {reached / loading.rate, reached, previous_dt, 0.0};
  const ForceSystem::Sweep sweep = system.internal_force(u, f);
  if (!sweep.ok()) stop_inverted(model, sweep, end);
  record(end, true);
  frame(options.frames, end);
  history.interrupted = stopped;
}

}  // namespace dimple
