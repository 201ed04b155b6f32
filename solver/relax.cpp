#include "solver/relax.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/path.hpp"
#include "solver/text.hpp"

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;

constexpr double near = 1e-2;  // residual at which an iteration that did not end is gone on from
// Of viscous steps: their viscosity at first, and where it is given up; what one may take, and how few let
// the next be larger.
constexpr double first_share = 0.3, largest_share = 30.0;
constexpr std::int64_t evaluations_of_step = 30, few_evaluations = 12;
constexpr int between_checks = 10;
constexpr double touch = 0.02;  // of the first way
// Of a frame: the shortest way on which an equilibrium is looked for; and evaluations, on the average, of a
// whole run.
constexpr double shortest = 1.0 / 16.0;
constexpr std::int64_t evaluations_of_frame = 60;
constexpr int memory = 60;  // iterations over which a change is compared for the frequency

SolveError no_equilibrium(const Relaxed& found, const Model& model) {
  const bool gave_way = found.gave_way();
  return SolveError(
      {.fact = text(gave_way ? "the tissue gave way, and no equilibrium was found beyond: "
                             : "no equilibrium was found: ",
                    "unbalanced forces are ", found.residual, " of the reactions after ", found.evaluations,
                    " evaluations"),
       .where = text("static solver; smallest det F ", found.sweep.J_min, " at integration point ",
                     found.sweep.point, ", ", found.sweep.inverted, " points inside out",
                     found.furthest < 0 ? std::string() : "; moving: " + place_of(model, found.furthest)),
       .why = gave_way ? "the path of equilibria has a limit point here: a wall has buckled or a fold rolled "
                         "over, and no surface of the body rests on another one, which is not modelled"
                       : "the load is more than this cloud can follow in one step, or the body has lost its "
                         "stiffness",
       .remedy = gave_way ? "use a smaller --depth, a place further from folds and edges (--indent-at), or "
                            "--time dynamic"
                          : "use more frames (--frames), more nodes (--nodes), or a smaller --depth",
       .code = gave_way ? "limit-point" : "no-equilibrium"});
}

}  // namespace

Eigen::VectorXd stiffness_row_sums(const ForceSystem& system, const Model& model) {
  const Tissues& tissues = system.tissues();
  std::vector<int> node;
  Points dphi;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(model.node_count());
  const auto material = [&](Index q) -> const Material& {
    return tissues.material[static_cast<std::size_t>(tissues.of_point[q])];
  };
  const bool projected = model.patches.count() > 0;
  for (Index q = 0; q < model.point_count(); ++q) {
    const Material& m = material(q);
    const double stiffness = 2.0 * m.mu + (projected ? pointwise_bulk_modulus(m) : m.kappa);
    system.gradients_at(q, node, dphi);
    double all = 0.0;
    for (std::size_t k = 0; k < node.size(); ++k) all += dphi.col(static_cast<Index>(k)).norm();
    for (std::size_t k = 0; k < node.size(); ++k)
      sum[node[k]] += model.volume[q] * stiffness * dphi.col(static_cast<Index>(k)).norm() * all;
  }
  // The patches' part: (kappa - ks) V_b g_b g_b^T, g_b = sum_q psi V_q / V_b dphi_q.
  const PressurePatches& patches = model.patches;
  Eigen::VectorXi slot;
  const CompressedRows members = transpose(patches.of_point, patches.count(), &slot);
  Points g = Points::Zero(3, model.node_count());
  std::vector<int> touched;
  for (Index b = 0; b < patches.count(); ++b) {
    touched.clear();
    double bulk = 0.0;
    for (int k = members.offset[b]; k < members.offset[b + 1]; ++k) {
      const int q = members.member[k];
      bulk = material(q).kappa - pointwise_bulk_modulus(material(q));
      const double share = patches.psi[slot[k]] * model.volume[q] / patches.volume[b];
      system.gradients_at(q, node, dphi);
      for (std::size_t e = 0; e < node.size(); ++e) {
        const int a = node[e];
        if (g.col(a).isZero(0.0)) touched.push_back(a);
        g.col(a) += share * dphi.col(static_cast<Index>(e));
      }
    }
    std::sort(touched.begin(), touched.end());
    touched.erase(std::unique(touched.begin(), touched.end()), touched.end());
    double all = 0.0;
    for (const int a : touched) all += g.col(a).lpNorm<1>();
    for (const int a : touched) {
      sum[a] += bulk * patches.volume[b] * g.col(a).norm() * all;
      g.col(a).setZero();
    }
  }
  for (const GradientVariance& v : model.variance) {
    const double mu = tissues.material[static_cast<std::size_t>(v.tissue)].mu;
    for (Index a = 0; a < model.node_count(); ++a)
      for (int k = v.rows.offset[a]; k < v.rows.offset[a + 1]; ++k) sum[a] += mu * std::abs(v.K[k]);
  }
  return sum;
}

Relaxation::Relaxation(ForceState& forces, const Model& model, const Constraints& constraints)
    : forces_(forces), model_(model), constraints_(constraints) {
  if (MixedIteration::serves(forces.system(), model))
    mixed_ = std::make_unique<MixedIteration>(forces, model, constraints);
}

Relaxed Relaxation::operator()(Nodal& u, Nodal& f, const RelaxOptions& options, const Nodal& external,
                               Eigen::VectorXd* lambda) const {
  std::int64_t spent = 0;
  if (mixed_) {
    Eigen::VectorXd l = lambda ? *lambda : Eigen::VectorXd::Zero(model_.patches.count());
    Relaxed found = from_near(u, l, f, options, external);
    if (found.converged) {
      if (lambda) *lambda = l;
      return found;
    }
    spent = found.evaluations;
    forces_.hold_pressures({});
  }
  Relaxed found = swing(u, f, options, external, spent);
  if (lambda && mixed_) *lambda = pressures_of_volumes(forces_, model_);
  return found;
}

Relaxed Relaxation::from_near(Nodal& u, Eigen::VectorXd& lambda, Nodal& f, const RelaxOptions& options,
                              const Nodal& external) const {
  Nodal v = u;
  Eigen::VectorXd l = lambda;
  Relaxed found = (*mixed_)(v, l, f, options, external, true);
  RelaxOptions rest = options;
  rest.evaluations -= found.evaluations;
  if (!found.converged && found.residual < near && rest.evaluations > 1) {
    const std::int64_t spent = found.evaluations;
    found = give_way(v, l, f, rest, external);
    found.evaluations += spent;
  }
  if (found.converged) {
    u = v;
    lambda = l;
  }
  return found;
}

Relaxed Relaxation::give_way(Nodal& u, Eigen::VectorXd& lambda, Nodal& f, const RelaxOptions& options,
                             const Nodal& external) const {
  const Index n = u.cols();
  const bool loaded = external.cols() == n;
  Relaxed result;
  result.converged = false;
  // The unbalanced force at u, once `f` is that there.
  const auto unbalanced = [&](Nodal& force) {
    double reactions = 0.0;
    for (Index a = 0; a < n; ++a) {
      Eigen::Vector4d all = f.col(a);
      if (loaded) all -= external.col(a);
      force.col(a) = constraints_.project(a, all);
      reactions += 0.5 * (all - force.col(a)).norm() + (loaded ? external.col(a).norm() : 0.0);
    }
    return force.norm() / std::max(reactions, 1e-30);
  };
  const Nodal start = u;
  Nodal force = Nodal::Zero(4, n), force_before = force, moved = force;
  Eigen::VectorXd lambda_moved = Eigen::VectorXd::Zero(lambda.size());
  forces_.hold_pressures(lambda.cwiseQuotient(model_.patches.volume));
  result.sweep = forces_.internal_force(u, f);
  ++result.evaluations;
  result.residual = unbalanced(force_before);
  double tried = result.residual;  // from which no equilibrium was reached
  double too_little = 0.0;         // viscosity
  MixedIteration::Viscosity viscosity{.share = first_share, .about = {}};
  for (bool anew = true; result.evaluations < options.evaluations && viscosity.share < largest_share;) {
    viscosity.about = u;
    Nodal next = u + moved;
    Eigen::VectorXd next_lambda = lambda + lambda_moved;
    const Relaxed step = (*mixed_)(
        next, next_lambda, f,
        {.tolerance = std::clamp(0.2 * result.residual, 0.5 * options.tolerance, 10.0 * options.tolerance),
         .evaluations = std::min(evaluations_of_step, options.evaluations - result.evaluations)},
        external, anew, nullptr, &viscosity);
    result.evaluations += step.evaluations;
    if (!step.converged) {
      too_little = viscosity.share;
      viscosity.share *= 3.0;
      moved.setZero();
      lambda_moved.setZero();
      anew = true;
      continue;
    }
    moved = next - u;
    lambda_moved = next_lambda - lambda;
    u = next;
    lambda = next_lambda;
    const double before = result.residual;
    result.residual = unbalanced(force);
    result.sweep = step.sweep;
    result.dissipated -= 0.5 * moved.cwiseProduct(force + force_before).sum();
    double curvature = 0.0;
    if (const double size = mixed_->laplacian_of(moved); size > 0.0)
      curvature = moved.cwiseProduct(force - force_before).sum() / size;
    result.curvature = std::min(result.curvature, curvature);
    force_before = force;
    (u - start).colwise().squaredNorm().maxCoeff(&result.furthest);
    if (curvature > 0.0) too_little = 0.0;
    anew = step.evaluations < few_evaluations && 0.6 * viscosity.share > too_little;
    if (anew) viscosity.share *= 0.6;
    if (result.evaluations < options.evaluations &&
        result.residual <
            std::min({before, std::max(0.5 * tried, options.tolerance), 5.0 * options.tolerance})) {
      Nodal end = u;
      Eigen::VectorXd end_lambda = lambda;
      const Relaxed at_rest =
          (*mixed_)(end, end_lambda, f,
                    {.tolerance = options.tolerance,
                     .evaluations = std::min<std::int64_t>(2 * evaluations_of_step,
                                                           options.evaluations - result.evaluations)},
                    external, true);
      result.evaluations += at_rest.evaluations;
      if (at_rest.converged) {
        u = end;
        lambda = end_lambda;
        result.residual = at_rest.residual;
        result.sweep = at_rest.sweep;
        result.converged = true;
        return result;
      }
      tried = result.residual;
      anew = true;
    }
  }
  return result;
}

Relaxed Relaxation::swing(Nodal& u, Nodal& f, const RelaxOptions& options, const Nodal& external,
                          std::int64_t evaluations) const {
  const Index n = u.cols();
  const bool loaded = external.cols() == n;
  if (mass_.size() == 0) {
    mass_ = stiffness_row_sums(forces_.system(), model_);
    const double floor = 1e-6 * mass_.maxCoeff();  // a node that no point sees well
    mass_ = mass_.cwiseMax(floor);
  }
  const Eigen::VectorXd inverse_mass = mass_.cwiseInverse();
  Relaxed result;
  result.evaluations = evaluations;
  const auto free_force = [&](Index a) -> Eigen::Vector4d {
    return constraints_.project(
        a, loaded ? Eigen::Vector4d(f.col(a) - external.col(a)) : Eigen::Vector4d(f.col(a)));
  };
  const auto evaluate = [&] {
    stop_if_asked();
    result.sweep = forces_.internal_force(u, f);
    ++result.evaluations;
  };

  const Nodal start = u;
  double caution = 1.0;
  Nodal before = u, u_ref = u, f_ref = f;
  for (int attempt = 0;; ++attempt, caution *= 1.5) {
    const StableStep stable = stable_time_step(forces_, model_, mass_, constraints_, u);
    result.evaluations += stable.iterations + 1;
    const double dt = 0.85 * stable.dt / std::sqrt(caution);
    bool diverged = !(stable.dt > 0.0);
    double w = 0.02 * 2.0 / std::max(dt, 1e-300) / 10.0, work_before = 0.0;
    int last_ref = 0;
    bool first_estimate = true;
    before = u;
    if (!diverged) {
      evaluate();
      u_ref = u;
      f_ref = f;
    }
    for (int it = 1; !diverged && result.evaluations < options.evaluations; ++it) {
      const double K = 2.0 / (w * dt), r = (K - 1.0) / (K + 1.0), keep = r * r,
                   c = std::pow(0.5 * (1.0 + r) * dt, 2);
      for (Index a = 0; a < n; ++a) {
        if (constraints_.is_held_wholly(a)) continue;
        const Eigen::Vector4d now = u.col(a);
        u.col(a) +=
            keep * constraints_.project(a, now - before.col(a)) - (c * inverse_mass[a]) * free_force(a);
        before.col(a) = now;
      }
      evaluate();
      if (it % between_checks != 0) continue;

      double stiffness = 0.0, inertia = 0.0, unbalanced = 0.0, reactions = 0.0, work = 0.0;
      for (Index a = 0; a < n; ++a) {
        const Eigen::Vector4d free = free_force(a);
        const Eigen::Vector4d du = constraints_.project(a, u.col(a) - u_ref.col(a));
        stiffness += du.dot(f.col(a) - f_ref.col(a));
        inertia += mass_[a] * du.squaredNorm();
        unbalanced += free.squaredNorm();
        Eigen::Vector4d held = f.col(a) - free;
        if (loaded) held -= external.col(a);
        reactions += 0.5 * held.norm() + (loaded ? external.col(a).norm() : 0.0);
        work += held.dot(u.col(a)) + (loaded ? external.col(a).dot(u.col(a)) : 0.0);
      }
      result.residual = std::sqrt(unbalanced) / std::max(reactions, 1e-30);
      diverged = !(result.residual < 1e3) || !std::isfinite(work);
      const double estimate = inertia > 0.0 ? std::sqrt(std::abs(stiffness) / inertia) : 0.0;
      w = std::max(first_estimate ? estimate : 0.7 * w + 0.3 * estimate, 1e-4 / dt);
      first_estimate = false;
      if (it - last_ref >= memory) {
        u_ref = u;
        f_ref = f;
        last_ref = it;
      }
      if (result.residual < options.tolerance &&
          std::abs(work - work_before) < 0.1 * options.tolerance * std::abs(work))
        return result;
      work_before = work;
    }
    if (attempt == 5 || result.evaluations >= options.evaluations) throw no_equilibrium(result, model_);
    u = start;
  }
}

namespace {

// A first guess: the tissue follows the tool by `depth` more, less the further away from it and the nearer to
// the base.
void guess(const Model& model, double depth, Nodal& u) {
  const Eigen::VectorXd along = model.X.transpose() * model.tool.push;
  const double top = model.tool.centre.dot(model.tool.push), bottom = along.maxCoeff();
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 d = model.X.col(a) - model.tool.centre;
    const double lateral = (d - d.dot(model.tool.push) * model.tool.push).norm();
    const double away =
        std::hypot(std::max(0.0, lateral - model.tool.radius), d.dot(model.tool.push)) / model.tool.radius;
    const double held = std::clamp((bottom - along[a]) / (bottom - top), 0.0, 1.0);
    u.col(a) += padded(model.tool.push) * (depth * held / ((1.0 + away) * (1.0 + away)));
  }
}

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

void load_by_depths(const ForceSystem& system, const Model& model, const Loading& loading,
                    const SolverOptions& options, const Observer& observer, History& history,
                    const State* from) {
  const Constraints constraints = make_constraints(model, loading.contact, loading.further);
  ForceState forces(system);
  const Relaxation relax(forces, model, constraints);
  const Index n = model.node_count();
  Nodal u = Nodal::Zero(4, n), f = u;
  Eigen::VectorXd lambda = Eigen::VectorXd::Zero(model.patches.count());
  Path past(4);  // where the next equilibrium is looked for
  Guards guards(forces, model, true, options.guards, history.guards);
  const double step = loading.depth / options.frames;
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
    forces.restore_past(from->past);
  } else {
    depths = working = {0.0};
    longest = step;
    past.push(0.0, u, lambda);
    history.force.push_back({0.0, 0.0, 0.0, 0.0});
    history.energy.push_back({0.0, 0.0, 0.0, 0.0, 0.0, 0.0});
    if (observer.frame) observer.frame({0, 0.0, 0.0, u, f, forces});
  }
  // All equilibria together.
  const std::int64_t most = relax.has_mixed() ? options.evaluations + evaluations_of_frame * options.frames
                                              : options.evaluations * options.frames;
  for (int level = state.frame + 1; level <= options.frames;) {
    const double end = step * level, at = depths.back();
    // Where it was short it becomes long again by and by.
    const double last = depths.size() > 1 ? at - depths[depths.size() - 2] : step;
    const double way = std::min({halved, longest, 2.0 * last, end - at});
    const bool arrives = end - at - way < 1e-6 * step;
    const double depth = arrives ? end : at + way, t = depth / loading.rate;
    const Moment now = {t, depth};
    forces.begin_step((depth - at) / loading.rate);
    const std::size_t equilibria = depths.size();
    const bool sets_off = past.state.size() == 1;
    Relaxed relaxed;
    relaxed.converged = false;
    double force = 0.0, base = 0.0, stored = 0.0, work = 0.0;
    try {
      const auto find = [&](double tolerance) {
        const RelaxOptions how{.tolerance = tolerance,
                               .evaluations = relax.has_mixed()
                                                  ? std::min(options.evaluations, most - history.steps)
                                                  : options.evaluations};
        relaxed.converged = false;
        if (how.evaluations < 1) throw no_equilibrium(relaxed, model);
        relaxed = relax.has_mixed() ? relax.from_near(u, lambda, f, how) : relax(u, f, how, {}, &lambda);
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
      if (sets_off && model.patches.count() > 0) {
        // A touch, to a low accuracy: the direction in which the tissue sets off.
        const double a_touch = at + touch * (depth - at);
        guess(model, touch * (depth - at), u);
        constraints.prescribe(u, a_touch);
        find(std::max(1e-2, options.tolerance));
        Path touched = past;
        touched.push(a_touch, u, lambda);
        touched.extrapolate(depth, u, lambda);
        constraints.prescribe(u, depth);
      } else if (sets_off) {
        guess(model, depth - at, u);
        constraints.prescribe(u, depth);
      } else {
        past.extrapolate(depth, u, lambda);
        constraints.prescribe(u, depth);
      }
      const Nodal expected = u;
      find(options.tolerance);
      gave_way = relaxed.gave_way();

      guards.check(relaxed.sweep, now);
      guards.check(u, f, now);
      guards.check_points(relaxed.sweep, now);
      guards.check_fluctuation(u, now);
      const Eigen::Vector4d push = padded(model.tool.push);
      for (const Index a : model.indenter) force += f.col(a).dot(push);
      for (const Index a : model.base) base -= f.col(a).dot(push);
      depths.push_back(depth);
      working.push_back(constraints.working_force(f));
      work = work_of_last(depths, working, sets_off || gave_way);
      double unseen = 0.0;
      stored = forces.stored_energy(u, &unseen);
      guards.check_unseen(unseen, stored, now);
      // Before the third the curve between two is a guess.
      if (depths.size() > 3)
        guards.check(EnergySample{t, depth, 0.0, stored, external + work,
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
          {error.report.code, depth,
           text("back to ", 1e3 * at, " mm, and on in steps of ", 1e3 * 0.5 * way, " mm")});
      if (observer.retry) observer.retry(history.retries.back());
      continue;
    }
    halved = step;
    least_curvature = 1.0;
    if (gave_way) {  // the new branch has nothing to do with the old one
      past.state.clear();
      state.dissipated += relaxed.dissipated;
    }
    past.push(depth, u, lambda);
    external += work;
    largest_external = std::max(largest_external, std::abs(external));
    history.J_min = std::min(history.J_min, relaxed.sweep.J_min);
    history.inverted = std::max(history.inverted, relaxed.sweep.inverted);
    history.residual = std::max(history.residual, relaxed.residual);
    history.momentum_error = std::max(history.momentum_error, f.rowwise().sum().norm() / std::abs(force));
    history.force.push_back({t, depth, force, base});
    history.energy.push_back({t, depth, 0.0, stored, external, state.dissipated});
    if (arrives && observer.frame) observer.frame({level, t, depth, u, f, forces});
    if (observer.sample && !observer.sample(history.force.back(), history)) {
      history.interrupted = !arrives || level < options.frames;
      return;
    }
    forces.accept_step(u);  // after the frame: its stresses are those of this step
    if (arrives) state.frame = level++;
    if (observer.between_steps && level <= options.frames)
      observer.between_steps([&] {
        State copy = state;
        copy.path = past.state;
        copy.past = forces.past();
        copy.history = history;
        return copy;
      });
  }
}

}  // namespace

void load_slowly(const ForceSystem& system, const Model& model, const Loading& loading,
                 const SolverOptions& options, const Observer& observer, History& history,
                 const State* from) {
  try {
    load_by_depths(system, model, loading, options, observer, history, from);
  } catch (const Stopped&) {
    history.interrupted = true;
  }
}

}  // namespace dimple
