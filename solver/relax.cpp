#include "solver/relax.hpp"

#include <algorithm>
#include <cmath>

#include "io/error.hpp"
#include "solver/path.hpp"
#include "solver/text.hpp"

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;
using Kind = Constraints::Kind;

constexpr double worth_keeping = 1e-2;  // residual at which an iteration that did not end is gone on from
constexpr int between_checks = 10;
constexpr double touch = 0.02;  // of the first depth
constexpr int memory = 60;      // iterations over which a change is compared for the frequency

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

Relaxation::Relaxation(const ForceSystem& system, const Model& model, const Constraints& constraints)
    : system_(system), model_(model), constraints_(constraints) {
  if (MixedIteration::serves(system, model))
    mixed_ = std::make_unique<MixedIteration>(system, model, constraints);
}

Relaxed Relaxation::operator()(Nodal& u, Nodal& f, const RelaxOptions& options, const Nodal& external,
                               Eigen::VectorXd* lambda) const {
  std::int64_t spent = 0;
  if (mixed_) {
    Nodal v = u;
    Eigen::VectorXd l = lambda ? *lambda : Eigen::VectorXd::Zero(model_.patches.count());
    Relaxed found = (*mixed_)(v, l, f, options, external, true);
    if (found.converged) {
      u = v;
      if (lambda) *lambda = l;
      return found;
    }
    spent = found.evaluations;
    system_.release_pressures();
    if (found.residual < worth_keeping) u = v;
  }
  Relaxed found = swing(u, f, options, external, spent);
  if (lambda && mixed_) *lambda = pressures_of_volumes(system_, model_);
  return found;
}

Relaxed Relaxation::swing(Nodal& u, Nodal& f, const RelaxOptions& options, const Nodal& external,
                          std::int64_t evaluations) const {
  const Index n = u.cols();
  const bool loaded = external.cols() == n;
  if (mass_.size() == 0) {
    mass_ = stiffness_row_sums(system_, model_);
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
    result.sweep = system_.internal_force(u, f);
    ++result.evaluations;
  };

  const Nodal start = u;
  double caution = 1.0;
  Nodal before = u, u_ref = u, f_ref = f;
  for (int attempt = 0;; ++attempt, caution *= 1.5) {
    const StableStep stable = stable_time_step(system_, model_, mass_, constraints_, u);
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
        if (constraints_.kind[static_cast<std::size_t>(a)] == Kind::fixed ||
            constraints_.kind[static_cast<std::size_t>(a)] == Kind::driven)
          continue;
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
    if (attempt == 5 || result.evaluations >= options.evaluations)
      throw SolveError(
          {.fact = text("no equilibrium was found: unbalanced forces are ", result.residual,
                        " of the reactions after ", result.evaluations, " evaluations"),
           .where = text("static solver; smallest det F ", result.sweep.J_min, " at integration point ",
                         result.sweep.point, ", ", result.sweep.inverted, " points inside out"),
           .why =
               "the load is more than this cloud can follow in one step, or the body has lost its stiffness",
           .remedy = "use more frames (--frames), more nodes (--nodes), or a smaller --depth",
           .code = "no-equilibrium"});
    u = start;
  }
}

namespace {

// A first guess: the tissue follows the tool, less the further away from it and the nearer to the base.
void guess(const Model& model, const Constraints& constraints, double depth, Nodal& u) {
  const Eigen::VectorXd along = model.X.transpose() * model.tool.push;
  const double top = model.tool.centre.dot(model.tool.push), bottom = along.maxCoeff();
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 d = model.X.col(a) - model.tool.centre;
    const double lateral = (d - d.dot(model.tool.push) * model.tool.push).norm();
    const double away =
        std::hypot(std::max(0.0, lateral - model.tool.radius), d.dot(model.tool.push)) / model.tool.radius;
    const double held = std::clamp((bottom - along[a]) / (bottom - top), 0.0, 1.0);
    u.col(a) = constraints.push * (depth * held / ((1.0 + away) * (1.0 + away)));
  }
}

// Of the force over the last piece of the way: the parabola through the last three places, or a line.
double work_of_last(const std::vector<double>& depth, const std::vector<double>& force) {
  const std::size_t k = depth.size() - 1;
  const double h = depth[k] - depth[k - 1], slope = (force[k] - force[k - 1]) / h;
  const double line = 0.5 * h * (force[k] + force[k - 1]);
  if (k == 1) return line;
  const double slope_before = (force[k - 1] - force[k - 2]) / (depth[k - 1] - depth[k - 2]);
  return line - h * h * h / 6.0 * (slope - slope_before) / (depth[k] - depth[k - 2]);
}

}  // namespace

void load_slowly(const ForceSystem& system, const Model& model, const Loading& loading,
                 const SolverOptions& options, const Observer& observer, History& history,
                 const State* from) {
  const Constraints constraints = make_constraints(model, loading.contact);
  const Relaxation relax(system, model, constraints);
  const Index n = model.node_count();
  const RelaxOptions exactly{.tolerance = options.tolerance, .evaluations = options.evaluations};
  Nodal u = Nodal::Zero(4, n), f = u;
  Eigen::VectorXd lambda = Eigen::VectorXd::Zero(model.patches.count());
  Path past(4);  // where the next equilibrium is looked for
  Guards guards(system, model, true, options.guards, history.guards);
  const double step = loading.depth / options.frames;
  State state;
  std::vector<double>&depths = state.depths, &forces = state.forces;
  double &external = state.external, &largest_external = state.largest_external, &longest = state.longest;
  if (from) {
    state = *from;
    history = from->history;
    past.state = from->path;
    system.restore_past(from->past);
  } else {
    depths = forces = {0.0};
    longest = step;
    past.push(0.0, u, lambda);
    history.force.push_back({0.0, 0.0, 0.0, 0.0});
    history.energy.push_back({0.0, 0.0, 0.0, 0.0, 0.0, 0.0});
    if (observer.frame) observer.frame({0, 0.0, 0.0, u, f});
  }
  for (int level = state.frame + 1; level <= options.frames;) {
    const double end = step * level, at = depths.back(), way = std::min(longest, end - at);
    const bool arrives = end - at - way < 1e-6 * step;
    const double depth = arrives ? end : at + way, t = depth / loading.rate;
    const Moment now = {t, depth};
    system.begin_step((depth - at) / loading.rate);
    const std::size_t equilibria = depths.size();
    const bool first = equilibria == 1;
    Relaxed relaxed;
    double force = 0.0, base = 0.0, stored = 0.0, work = 0.0;
    try {
      if (first && model.patches.count() > 0) {
        // A touch, to a low accuracy: the direction in which the tissue sets off.
        guess(model, constraints, touch * depth, u);
        constraints.prescribe(u, touch * depth);
        RelaxOptions roughly = exactly;
        roughly.tolerance = std::max(1e-2, options.tolerance);
        lambda.setZero();
        history.steps += relax(u, f, roughly, {}, &lambda).evaluations;
        Path touched = past;
        touched.push(touch * depth, u, lambda);
        touched.extrapolate(depth, u, lambda);
        constraints.prescribe(u, depth);
      } else if (first) {
        guess(model, constraints, depth, u);
        constraints.prescribe(u, depth);
      } else {
        past.extrapolate(depth, u, lambda);
        constraints.prescribe(u, depth);
      }
      relaxed = relax(u, f, exactly, {}, &lambda);
      history.steps += relaxed.evaluations;

      guards.check(relaxed.sweep, now);
      guards.check(u, f, now);
      guards.check_points(relaxed.sweep, now);
      guards.check_fluctuation(u, now);
      for (const Index a : model.indenter) force += f.col(a).dot(constraints.push);
      for (const Index a : model.base) base -= f.col(a).dot(constraints.push);
      depths.push_back(depth);
      forces.push_back(force);
      work = work_of_last(depths, forces);
      double unseen = 0.0;
      stored = system.stored_energy(u, &unseen);
      guards.check_unseen(unseen, stored, now);
      // Before the third the curve between two is a guess.
      if (depths.size() > 3)
        guards.check(EnergySample{t, depth, 0.0, stored, external + work, 0.0},
                     std::max(largest_external, std::abs(external + work)), t, false, now);
    } catch (const SolveError& error) {
      if (!options.guards || error.report.code == "hourglass") throw;  // which no shorter way mends
      if (history.retries.size() == most_retries)
        throw after_retries(error, text("steps of the load down to ", 1e3 * way, " mm"));
      depths.resize(equilibria);
      forces.resize(equilibria);
      longest = 0.5 * way;
      history.retries.push_back(
          {error.report.code, depth,
           text("back to ", 1e3 * at, " mm, and on in steps of ", 1e3 * longest, " mm")});
      if (observer.retry) observer.retry(history.retries.back());
      continue;
    }
    past.push(depth, u, lambda);
    external += work;
    largest_external = std::max(largest_external, std::abs(external));
    history.J_min = std::min(history.J_min, relaxed.sweep.J_min);
    history.inverted = std::max(history.inverted, relaxed.sweep.inverted);
    history.residual = std::max(history.residual, relaxed.residual);
    history.momentum_error = std::max(history.momentum_error, f.rowwise().sum().norm() / std::abs(force));
    history.force.push_back({t, depth, force, base});
    history.energy.push_back({t, depth, 0.0, stored, external, 0.0});
    if (arrives && observer.frame) observer.frame({level, t, depth, u, f});
    if (observer.sample && !observer.sample(history.force.back(), history)) {
      history.interrupted = !arrives || level < options.frames;
      return;
    }
    system.accept_step(u);  // after the frame: its stresses are those of this step
    if (arrives) state.frame = level++;
    if (observer.between_steps && level <= options.frames)
      observer.between_steps([&] {
        State copy = state;
        copy.path = past.state;
        copy.past = system.past();
        copy.history = history;
        return copy;
      });
  }
}

}  // namespace dimple
