#include "solver/implicit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "io/error.hpp"
#include "solver/mixed_iteration.hpp"
#include "solver/path.hpp"
#include "solver/text.hpp"

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;
using Kind = Constraints::Kind;

constexpr double steps_per_period = 6.0;
constexpr double alpha = -1.0 / 3.0, beta = (1.0 - alpha) * (1.0 - alpha) / 4.0, gamma = 0.5 - alpha;
// Of a step: its error does not add up, since the next one starts from the forces that were found.
constexpr double roughly = 2e-3;
constexpr std::size_t remembered =
    3;  // states, for the guess of the next: more would amplify what they are off
constexpr double shortest = 1.0 / 64.0;  // step, of the first one tried
constexpr std::int64_t many = 12;  // evaluations for a step, after which it pays to linearise the volume anew

}  // namespace

double shear_crossing_time(const Tissues& tissues, const Model& model) {
  double speed = std::numeric_limits<double>::infinity();
  for (const Material& m : tissues.material) speed = std::min(speed, shear_wave_speed(m));
  const Eigen::VectorXd along = model.X.transpose() * model.tool.push;
  return (along.maxCoeff() - along.minCoeff()) / speed;
}

void simulate_implicitly(const ForceSystem& system, const Model& model, const Loading& loading,
                         const SolverOptions& options, const Observer& observer, History& history) {
  const Constraints constraints = make_constraints(model, loading.contact);
  MixedIteration solve(system, model, constraints);
  const Index n = model.node_count();
  const auto held = [&](Index a) { return constraints.kind[static_cast<std::size_t>(a)] != Kind::free; };
  const Eigen::Vector4d push = constraints.push;
  const double segment = loading.duration() / options.frames, damping = options.damping;
  // Of a shear wave that stands between the base and the tool's side.
  const double slowest_period = 4.0 * shear_crossing_time(system.tissues(), model);
  const auto steps = static_cast<std::int64_t>(std::ceil(segment / (slowest_period / steps_per_period)));
  const double longest = segment / static_cast<double>(steps);

  Nodal u = Nodal::Zero(4, n), v = u, a = u, f = u;
  Eigen::VectorXd lambda = Eigen::VectorXd::Zero(model.patches.count());
  // The tool brings its nodes to speed at once: the only work that is not force times way.
  double external = 0.0, dissipated = 0.0, force_before = 0.0, largest_reaction = 0.0;
  for (const Index i : model.indenter)
    if (held(i)) {
      v.col(i) = push * loading.rate;
      external += 0.5 * model.mass[i] * loading.rate * loading.rate;
    }
  Path past(remembered);
  past.push(0.0, u, lambda);
  MixedIteration::Inertia inertia;
  double t = 0.0, dt = longest, next_energy = 0.0;
  history.dt_first = history.dt_smallest = dt;

  const auto reaction = [&](const std::vector<Index>& nodes) {
    double sum = 0.0;
    for (const Index i : nodes) sum += f.col(i).dot(push);
    return sum;
  };
  Guards guards(system, model, loading.duration() >= slow_load * shear_crossing_time(system.tissues(), model),
                options.guards, history.guards);
  double largest_external = 0.0;
  const auto record = [&](bool last) {
    const double force = reaction(model.indenter), depth = loading.rate * t;
    history.force.push_back({t, depth, force, -reaction(model.base)});
    largest_reaction = std::max(largest_reaction, std::abs(force));
    if (largest_reaction > 0.0)
      history.momentum_error = std::max(history.momentum_error, f.rowwise().sum().norm() / largest_reaction);
    if (last || t >= next_energy) {
      next_energy = t + 1.0 / options.energy_rate;
      const double kinetic = 0.5 * (v.colwise().squaredNorm() * model.mass).value();
      double unseen = 0.0;
      const double stored = system.stored_energy(u, &unseen);
      history.energy.push_back({t, depth, kinetic, stored, external, dissipated});
      largest_external = std::max(largest_external, std::abs(external));
      guards.check(history.energy.back(), largest_external, loading.duration(), false, {t, depth, dt});
      guards.check_unseen(unseen, stored, {t, depth, dt});
    }
    return !observer.sample || observer.sample(history.force.back(), history);
  };

  record(false);
  if (observer.frame) observer.frame({0, 0.0, 0.0, u, f});
  bool stopped = false;
  bool anew = true;
  for (int frame = 1; frame <= options.frames && !stopped; ++frame) {
    const double end = segment * frame;
    dt = longest;
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
      constraints.prescribe(next, depth);
      system.begin_step(h);
      const Nodal f_before = f;
      const Relaxed found =
          solve(next, next_lambda, f,
                {.tolerance = std::max(options.tolerance, roughly), .evaluations = options.evaluations}, {},
                anew, &inertia);
      history.extra_evaluations += found.evaluations;
      if (!found.converged) {
        f = f_before;
        dt = 0.5 * h;
        anew = true;
        if (dt < shortest * longest)
          throw SolveError(
              {.fact = text("a time step did not converge: unbalanced forces are ", found.residual,
                            " of the reactions"),
               .where = text("solver, t = ", t, " s, indentation ", loading.rate * t * 1e3, " mm, step ", h,
                             " s; smallest det F ", found.sweep.J_min, " at integration point ",
                             found.sweep.point, ", ", found.sweep.inverted, " points inside out"),
               .why = "the load is more than this cloud can follow",
               .remedy = "use more nodes (--nodes), a smaller --depth, or --time explicit",
               .code = "no-equilibrium"});
        history.retries.push_back(
            {"no-equilibrium", depth,
             text("from ", 1e3 * loading.rate * t, " mm on in steps of ", dt, " s until the next frame")});
        if (observer.retry) observer.retry(history.retries.back());
        continue;
      }
      const Moment now = {to, depth, h};
      guards.check(found.sweep, now);
      guards.check(next, f, now);
      if (end - to <= 1e-6 * longest) guards.check_points(found.sweep, now);
      anew = found.evaluations > many;
      for (Index i = 0; i < n; ++i) {
        const Eigen::Vector4d v_before = v.col(i);
        a.col(i) = (next.col(i) - reached.col(i)) / (beta * h * h);
        v.col(i) = drift.col(i) + gamma * h * a.col(i);
        if (!held(i)) {
          dissipated += damping * model.mass[i] * 0.25 * (v.col(i) + v_before).squaredNorm() * h;
          continue;
        }
        // Along the push the tool has one speed from the start.
        v.col(i) +=
            push * ((constraints.kind[static_cast<std::size_t>(i)] == Kind::fixed ? 0.0 : loading.rate) -
                    v.col(i).dot(push));
        a.col(i) -= push * a.col(i).dot(push);
      }
      u = next;
      lambda = next_lambda;
      t = to;
      past.push(t, u, lambda);
      history.dt_smallest = std::min(history.dt_smallest, h);
      history.J_min = std::min(history.J_min, found.sweep.J_min);
      history.inverted = std::max(history.inverted, found.sweep.inverted);
      history.residual = std::max(history.residual, found.residual);
      ++history.steps;
      const double force = reaction(model.indenter);
      external += 0.5 * (force + force_before) * loading.rate * h;
      force_before = force;
      stopped = !record(frame == options.frames && end - t <= 1e-6 * longest);
      if (end - t <= 1e-6 * longest && observer.frame) observer.frame({frame, t, loading.rate * t, u, f});
      system.accept_step(u);
    }
  }
  history.interrupted = stopped;
}

}  // namespace dimple
