#include "solver/march/quasi_static.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/equilibrium/relax.hpp"
#include "solver/march/path.hpp"
#include "solver/text.hpp"

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;

constexpr double touch = 0.02;  // of the first way
// Of a step: the shortest way on which an equilibrium is looked for; and evaluations, on the average, of a
// whole run.
constexpr double shortest = 1.0 / 16.0;
constexpr std::int64_t evaluations_of_step = 60;
constexpr double same_depth = 1e-6;  // of a step

SolveError after_halving(const SolveError& error, double depth, double way, std::int64_t evaluations) {
  Report report = error.report;
  report.where = text("indentation ", 1e3 * depth, " mm; ", report.where);
  report.why += text("; it came again with steps of the load down to ", 1e3 * way, " mm, after ", evaluations,
                     " evaluations in all");
  return SolveError(report);
}

// Of the force over the last piece of the way: the parabola through the last three places, or a line.
double work_of_last(const std::vector<double>& depth, const std::vector<double>& force, bool straight) {
  const std::size_t k = depth.size() - 1;
  const double h = depth[k] - depth[k - 1], slope = (force[k] - force[k - 1]) / h;
  const double line = 0.5 * h * (force[k] + force[k - 1]);
  if (k == 1 || straight) return line;
  const double slope_before = (force[k - 1] - force[k - 2]) / (depth[k - 1] - depth[k - 2]);
  return line - h * h * h / 6.0 * (slope - slope_before) / (depth[k] - depth[k - 2]);
}

// Frames at depths between two equilibria of the march, which does not notice.
struct FramesBetween {
  System& system;
  const Relaxation& relax;
  const Loading& loading;
  const SolverOptions& options;
  const Observer& observer;
  History& history;

  double depth_of(int frame) const { return loading.depth / options.frames * frame; }

  // Those after the frame `last` that lie before a depth; `path` holds the equilibria on both sides, and that
  // at `from` is the last that the tissue's past knows. False: the observer has enough.
  bool show(int& last, double before, double from, const Path& path) {
    Nodal u = path.state.back().u, f = u;
    Eigen::VectorXd lambda = path.state.back().lambda;
    for (; last < options.frames && depth_of(last + 1) < before; ++last) {
      const double depth = depth_of(last + 1), t = loading.t_at(depth), shown = loading.depth_at(depth);
      system.begin_step((depth - from) / loading.rate);
      const std::int64_t swept = system.tissue().sweeps();
      path.extrapolate(depth, u, lambda);
      system.set({.t = t, .depth = depth}, u);
      const bool found = find(u, lambda, f);
      history.extra_evaluations += system.tissue().sweeps() - swept;
      if (found) {
        history.force.push_back(ForceSample::at(t, shown, system, u, f));
      } else {
        show_line(shown);
      }
      if (observer.frame)
        observer.frame({loading.begun.frame + last + 1, t, shown, u, f, system.tissue(), system.aside()});
      if (found && observer.sample && !observer.sample(history.force.back(), history)) return false;
    }
    return true;
  }

  // `u` and `lambda` stay as they were where there is none.
  bool find(Nodal& u, Eigen::VectorXd& lambda, Nodal& f) {
    const Nodal guess = u;
    try {
      const bool mixed = relax.has_mixed();
      const RelaxOptions how{.tolerance = options.tolerance,
                             .evaluations = mixed ? std::min(options.evaluations, 2 * evaluations_of_step)
                                                  : options.evaluations};
      if ((mixed ? relax.from_near(u, lambda, f, how) : relax(u, f, how, &lambda)).converged) return true;
    } catch (const SolveError&) {
      u = guess;
    }
    evaluate(u, lambda, f);
    return false;
  }

  // The force at what is known.
  void evaluate(const Nodal& u, const Eigen::VectorXd& lambda, Nodal& f) {
    if (relax.has_mixed())
      system.tissue().hold_pressures(lambda.cwiseQuotient(system.model().patches.volume));
    system.force(u, f);
  }

  void show_line(double depth) {
    if (std::any_of(history.guards.begin(), history.guards.end(),
                    [](const Finding& f) { return f.report.code == "frame"; }))
      return;
    history.guards.push_back(
        {.report = {.fact = text("the frame at ", 1e3 * depth, " mm shows the line between two equilibria"),
                    .where = "static solver",
                    .why = "none was found at its own depth; the force curve leaves it out",
                    .remedy = "look at the frames before and after it, or choose other --frames",
                    .code = "frame"},
         .worst = depth});
  }
};

// The body at rest, before the tool moves.
void begin_history(System& system, const Nodal& u, const Eigen::VectorXd& lambda, Nodal& f,
                   History& history) {
  if (!system.loaded()) {
    history.force.push_back({0.0, 0.0, 0.0, 0.0});
    history.energy.push_back({0.0, 0.0, 0.0, 0.0, 0.0, 0.0});
    return;
  }
  if (lambda.size() > 0) system.tissue().hold_pressures(lambda.cwiseQuotient(system.model().patches.volume));
  system.set({});
  system.force(u, f);
  history.force.push_back(ForceSample::at(0.0, 0.0, system, u, f));
  const double stored =
      system.stored_energy(u).sum();  // what the loads did before counts as done from outside
  history.energy.push_back({0.0, 0.0, 0.0, stored, stored, 0.0});
}

void find_equilibria(System& system, const Loading& loading, const SolverOptions& options,
                     const Observer& observer, History& history, const State* from, Rest* ended) {
  const Model& model = system.model();
  const Relaxation relax(system);
  auto [u, lambda] = system.at_rest();
  Nodal f = Nodal::Zero(4, model.node_count());
  Path past(4);  // where the next equilibrium is looked for
  Guards guards(system, true, options.guards, history.guards);
  const int steps = steps_of_load(model, loading, options);
  const double step = loading.depth / steps;
  FramesBetween between{system, relax, loading, options, observer, history};
  double halved = step;          // way after an equilibrium that was not found
  double least_curvature = 1.0;  // since the last that was found
  bool gave_way = false;
  State state;
  std::vector<double>&depths = state.depths, &working = state.forces;
  double &external = state.external, &largest_external = state.largest_external, &longest = state.longest;
  if (from) {
    state = *from;
    history = from->history;
    past.state = from->path;
    system.restore_past(from->past);
    system.set_least_reactions(from->least_reactions);
  } else {
    depths = working = {0.0};
    longest = step;
    past.push(0.0, u, lambda);
    if (loading.begun.frame == 0) {
      begin_history(system, u, lambda, f, history);
      if (observer.frame) observer.frame({0, 0.0, 0.0, u, f, system.tissue()});
    } else {
      system.set({.t = loading.begun.t});
      between.evaluate(u, lambda, f);
      system.measure_by(f);
      working = {system.held().working_force(f)};
      state.dissipated = history.energy.back().dissipated;
    }
    external = history.energy.back().external;
  }
  // All equilibria together.
  const std::int64_t most =
      relax.has_mixed() ? options.evaluations + evaluations_of_step * steps : options.evaluations * steps;
  for (std::int64_t level = state.step + 1; level <= steps;) {
    const double end = step * static_cast<double>(level), at = depths.back();
    // Where it was short it becomes long again by and by.
    const double last = depths.size() > 1 ? at - depths[depths.size() - 2] : step;
    const double way = std::min({halved, longest, 2.0 * last, end - at});
    const bool arrives = end - at - way < same_depth * step;
    const double depth = arrives ? end : at + way, t = loading.t_at(depth);
    const Moment now = {t, loading.depth_at(depth)};
    system.begin_step((depth - at) / loading.rate);
    const std::size_t equilibria = depths.size();
    const bool sets_off = past.state.size() == 1;
    Relaxed relaxed;
    relaxed.converged = false;
    ForceSample felt;
    StoredEnergy stored;
    double work = 0.0;
    try {
      const auto find = [&](double tolerance) {
        const RelaxOptions how{.tolerance = tolerance,
                               .evaluations = relax.has_mixed()
                                                  ? std::min(options.evaluations, most - history.steps)
                                                  : options.evaluations};
        relaxed.converged = false;
        if (how.evaluations < 1) throw no_equilibrium(relaxed, model);
        const std::int64_t before = system.tissue().sweeps();
        try {
          relaxed = relax.has_mixed() ? relax.from_near(u, lambda, f, how) : relax(u, f, how, &lambda);
        } catch (const Stopped&) {
          history.steps += system.tissue().sweeps() - before;
          throw;
        }
        history.steps += relaxed.evaluations;
        least_curvature = std::min(least_curvature, relaxed.curvature);
        if (relaxed.converged) return;
        relaxed.curvature = least_curvature;
        throw no_equilibrium(relaxed, model);
      };
      if (sets_off) {
        u = past.state.back().u;
        lambda = past.state.back().lambda;
      }
      if (sets_off && model.scheme.pressure_patches) {
        // A touch, to a low accuracy: the direction in which the tissue sets off.
        const double a_touch = at + touch * (depth - at);
        first_guess(model, touch * (depth - at) * system.held().motion(tool_set), u);
        system.set({.t = loading.t_at(a_touch), .depth = a_touch}, u);
        find(std::max(1e-2, options.tolerance));
        Path touched = past;
        touched.push(a_touch, u, lambda);
        touched.extrapolate(depth, u, lambda);
        system.set({.t = t, .depth = depth}, u);
      } else if (sets_off) {
        first_guess(model, (depth - at) * system.held().motion(tool_set), u);
        system.set({.t = t, .depth = depth}, u);
      } else {
        past.extrapolate(depth, u, lambda);
        system.set({.t = t, .depth = depth}, u);
      }
      const Nodal expected = u;
      find(options.tolerance);
      gave_way = relaxed.gave_way();

      guards.check(relaxed.sweep, now);
      guards.check(u, f, now);
      guards.check_points(relaxed.sweep, now);
      guards.check_fluctuation(u, now);
      felt = ForceSample::at(t, now.depth, system, u, f);
      depths.push_back(depth);
      working.push_back(system.held().working_force(f));
      work = work_of_last(depths, working, sets_off || gave_way);
      stored = system.stored_energy(u);
      guards.check_hourglass(stored.hourglass, stored.tissue, now);
      // Before the third the curve between two is a guess.
      if (depths.size() > 3)
        guards.check(EnergySample{t, now.depth, 0.0, stored.sum(), external + work,
                                  state.dissipated + (gave_way ? relaxed.dissipated : 0.0)},
                     std::max(largest_external, std::abs(external + work)), t, false, now);
      if (gave_way) guards.found_limit_point(u - expected, way, now);
    } catch (const SolveError& error) {
      if (!options.guards || error.report.code == "hourglass") throw;  // which no shorter way mends
      depths.resize(equilibria);
      working.resize(equilibria);
      if (!relaxed.converged) {
        halved = 0.5 * way;
        if (halved < shortest * step || history.steps >= most)
          throw after_halving(error, depth, way, history.steps);
      } else {
        if (history.retries.size() == most_retries)
          throw after_retries(error, text("steps of the load down to ", 1e3 * way, " mm"));
        longest = 0.5 * way;
      }
      history.retries.push_back(
          {error.report.code, now.depth,
           text("back to ", 1e3 * loading.depth_at(at), " mm, and on in steps of ", 1e3 * 0.5 * way, " mm")});
      if (observer.retry) observer.retry(history.retries.back());
      continue;
    }
    halved = step;
    least_curvature = 1.0;
    if (gave_way) {  // the new branch has nothing to do with the old one
      past.state.erase(past.state.begin(), past.state.end() - 1);
      state.dissipated += relaxed.dissipated;
    }
    past.push(depth, u, lambda);
    external += work;
    largest_external = std::max(largest_external, std::abs(external));
    history.J_min = std::min(history.J_min, relaxed.sweep.J_min);
    history.inverted = std::max(history.inverted, relaxed.sweep.inverted);
    history.residual = std::max(history.residual, relaxed.residual);
    history.momentum_error = std::max(history.momentum_error, system.sum_of_tissue(f) / std::abs(felt.force));
    if (const int shown = state.frame; between.depth_of(shown + 1) < depth - same_depth * step) {
      if (!between.show(state.frame, depth - same_depth * step, at, past)) {
        history.interrupted = true;
        return;
      }
      system.begin_step((depth - at) / loading.rate);  // and back to this step's end
      system.set({.t = t, .depth = depth});
      between.evaluate(u, lambda, f);
      ++history.extra_evaluations;
    }
    if (gave_way) past.state.pop_front();
    history.force.push_back(felt);
    history.energy.push_back({t, now.depth, 0.0, stored.sum(), external, state.dissipated});
    if (state.frame < options.frames && between.depth_of(state.frame + 1) < depth + same_depth * step) {
      ++state.frame;
      if (observer.frame)
        observer.frame(
            {loading.begun.frame + state.frame, t, now.depth, u, f, system.tissue(), system.aside()});
    }
    const bool is_last = arrives && level == steps;
    if (observer.sample && !observer.sample(history.force.back(), history)) {
      history.interrupted = !is_last;
      return;
    }
    system.accept_step(u);  // after the frame: its stresses are those of this step
    if (arrives) state.step = level++;
    if (observer.between_steps && !is_last)
      observer.between_steps([&] {
        State copy = state;
        copy.path = past.state;
        copy.past = system.past();
        copy.least_reactions = system.least_reactions();
        copy.history = history;
        return copy;
      });
  }
  if (ended) *ended = {std::move(u), std::move(lambda)};
}

}  // namespace

int steps_of_load(const Model& model, const Loading& loading, const SolverOptions& options) {
  const double way = loading.depth * longest_share(loading.further);
  const double steps = std::ceil(way / (options.step_radii * model.tool.radius) - same_depth);
  return std::max(1, static_cast<int>(steps));
}

void first_guess(const Model& model, const Vec3& way, Nodal& u) {
  const Eigen::VectorXd along = model.X.transpose() * model.tool.push;
  const double top = model.tool.centre.dot(model.tool.push), bottom = along.maxCoeff();
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 d = model.X.col(a) - model.tool.centre;
    const double lateral = (d - d.dot(model.tool.push) * model.tool.push).norm();
    const double away =
        std::hypot(std::max(0.0, lateral - model.tool.radius), d.dot(model.tool.push)) / model.tool.radius;
    const double held = std::clamp((bottom - along[a]) / (bottom - top), 0.0, 1.0);
    u.col(a) += padded(way) * (held / ((1.0 + away) * (1.0 + away)));
  }
}

void march_quasi_statically(System& system, const Loading& loading, const SolverOptions& options,
                            const Observer& observer, History& history, const State* from, Rest* ended) {
  try {
    find_equilibria(system, loading, options, observer, history, from, ended);
  } catch (const Stopped&) {
    history.interrupted = true;
  }
}

}  // namespace dimple
