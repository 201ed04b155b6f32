#include "solver/equilibrium/relax.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/guards.hpp"
#include "solver/text.hpp"

// Viscous steps past a limit point, continue_past_limit_point():
// 1. Start near equilibrium, residual below 1e-2, with the viscosity v = 0.3.
// 2. Solve f(u+) + v A (u+ - u) = 0 by mixed iteration; first guess: the last motion repeated.
// 3. If that fails, triple v and repeat 2 from u; give up above 30.
// 4. Accept u+; add the work of the unbalanced forces to the dissipation; curvature du.df / du.A du.
// 5. If the step was cheap, multiply v by 0.6, unless so small a viscosity has failed.
// 6. If the residual has fallen enough, search without viscosity; if that fails too, continue with 2.
//
// Dynamic relaxation, for schemes without patches and as last resort:
// 1. Masses M: row sums of the stiffness bound. Step dt: 0.85 of the stable one.
// 2. u+ = u + r^2 (u - u-) - c M^-1 f, with r and c of the header.
// 3. Every 10 steps: w^2 = du.df / du.M du of the changes since a state at most 60 steps back, smoothed.
// 4. At rest: the residual is below the tolerance and the work of the reactions has settled.
// 5. If it diverges, start again with a step shorter by sqrt(1.5); six attempts at most.
//
// Source:   Papadrakakis 1981; Joldes, Wittek, Miller 2011 (dynamic relaxation). The viscous steps are our
//           own.

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;

constexpr double near = 1e-2;  // residual below which viscous steps follow a failed iteration
// Viscous steps: first viscosity and largest one; most evaluations of a step, and few enough to enlarge the
// next.
constexpr double first_scale = 0.3, largest_scale = 30.0;
constexpr std::int64_t evaluations_of_viscous_step = 30, few_evaluations = 12;
constexpr int between_checks = 10;
constexpr int memory = 60;  // iterations over which a change is compared for the frequency

}  // namespace

SolveError no_equilibrium(const Relaxed& found, const Model& model) {
  const bool passed_limit_point = found.passed_limit_point(),
             has_rigid_modes = model.base.empty() && !passed_limit_point;
  return SolveError(
      {.fact = text(
           passed_limit_point ? "the tissue passed a limit point, and no equilibrium was found beyond: "
                              : "no equilibrium was found: ",
           std::isfinite(found.residual) ? text("unbalanced forces are ", found.residual, " of the reactions")
                                         : std::string("the displacements are not finite"),
           " after ", found.evaluations, " evaluations"),
       .where = text("static solver",
                     found.sweep.point < 0
                         ? std::string()
                         : text("; smallest det F ", found.sweep.J_min, " at integration point ",
                                found.sweep.point, ", ", found.sweep.inverted, " inverted points"),
                     found.furthest < 0 ? std::string() : "; moving: " + place_of(model, found.furthest)),
       .why = passed_limit_point
                  ? "the path of equilibria has a limit point here: a wall has buckled, a fold has "
                    "rolled over, or tissue has slipped from under a tool"
              : has_rigid_modes
                  ? "only walls hold the body, which moves freely unless the load presses it against them; "
                    "or the load is too large for one step with these nodes"
                  : "the load is too large for one step with these nodes, or the body has lost its stiffness",
       .remedy = passed_limit_point
                     ? "use a smaller --depth, a coarser spacing at the edge of the contact patch "
                       "(--rim 0.15 or more), a place further from folds and edges (--indent-at), or "
                       "for the bonded indenter --time explicit"
                 : has_rigid_modes
                     ? "place a wall in contact with it beneath the tool, hold its base (--base-hold "
                       "fixed), or use a smaller --depth"
                     : "use shorter steps of the load (--set solver.step_radii=0.05), a coarser spacing "
                       "at the edge of the contact patch (--rim 0.15 or more), or a smaller --depth",
       .code = passed_limit_point ? "limit-point" : "no-equilibrium"});
}

Eigen::VectorXd stiffness_row_sums(const ForceSystem& system, const Model& model) {
  const Tissues& tissues = system.tissues();
  std::vector<int> node;
  Points dphi;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(model.node_count());
  const auto material = [&](Index q) -> const Material& {
    return tissues.material[static_cast<std::size_t>(tissues.of_point[q])];
  };
  const bool projected = model.scheme.pressure_patches;
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
  std::vector<int> visited;
  for (Index b = 0; b < patches.count(); ++b) {
    visited.clear();
    double bulk = 0.0;
    for (int k = members.offset[b]; k < members.offset[b + 1]; ++k) {
      const int q = members.member[k];
      bulk = material(q).kappa - pointwise_bulk_modulus(material(q));
      const double fraction = patches.psi[slot[k]] * model.volume[q] / patches.volume[b];
      system.gradients_at(q, node, dphi);
      for (std::size_t e = 0; e < node.size(); ++e) {
        const int a = node[e];
        if (g.col(a).isZero(0.0)) visited.push_back(a);
        g.col(a) += fraction * dphi.col(static_cast<Index>(e));
      }
    }
    std::sort(visited.begin(), visited.end());
    visited.erase(std::unique(visited.begin(), visited.end()), visited.end());
    double all = 0.0;
    for (const int a : visited) all += g.col(a).lpNorm<1>();
    for (const int a : visited) {
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

Relaxation::Relaxation(System& system) : system_(system) {
  if (MixedIteration::serves(system.tissue().system(), system.model()))
    mixed_ = std::make_unique<MixedIteration>(system);
}

Relaxed Relaxation::operator()(Nodal& u, Nodal& f, const RelaxOptions& options,
                               Eigen::VectorXd* lambda) const {
  std::int64_t spent = 0;
  if (mixed_) {
    Eigen::VectorXd l = lambda ? *lambda : Eigen::VectorXd::Zero(system_.model().patches.count());
    Relaxed found = from_near(u, l, f, options);
    if (found.converged) {
      if (lambda) *lambda = l;
      return found;
    }
    spent = found.evaluations;
    // Dynamic relaxation has no contact forces.
    if (!system_.contacts().empty() || spent >= options.evaluations)
      throw no_equilibrium(found, system_.model());
    system_.tissue().hold_pressures({});
  }
  Relaxed found = relax_dynamically(u, f, options, spent);
  if (lambda && mixed_) *lambda = pressures_of_volumes(system_);
  return found;
}

Relaxed Relaxation::from_near(Nodal& u, Eigen::VectorXd& lambda, Nodal& f,
                              const RelaxOptions& options) const {
  Nodal v = u;
  Eigen::VectorXd l = lambda;
  Relaxed found = (*mixed_)(v, l, f, options, true);
  RelaxOptions remaining = options;
  remaining.evaluations -= found.evaluations;
  const RigidContact* tool = system_.tool_contact();
  if (!found.converged && options.allow_separation && remaining.evaluations > 1 && tool &&
      tool->is_separated(system_.run_start().u, system_.now())) {
    v = system_.run_start().u;
    l = system_.run_start().lambda;
    const std::int64_t spent = found.evaluations;
    found = (*mixed_)(v, l, f, remaining, true);
    found.evaluations += spent;
    found.lost_contact = found.converged && (tool->forces().array() == 0.0).all();
  } else if (!found.converged && found.residual < near && remaining.evaluations > 1) {
    const std::int64_t spent = found.evaluations;
    found = continue_past_limit_point(v, l, f, remaining);
    found.evaluations += spent;
  }
  if (found.converged) {
    u = v;
    lambda = l;
  }
  return found;
}

void Relaxation::find_equilibrium(Nodal& u, Eigen::VectorXd& lambda, Nodal& f, const RelaxOptions& options,
                                  Relaxed& result) const {
  Nodal end = u;
  Eigen::VectorXd end_lambda = lambda;
  const Relaxed undeformed =
      (*mixed_)(end, end_lambda, f,
                {.tolerance = options.tolerance,
                 .evaluations = std::min<std::int64_t>(2 * evaluations_of_viscous_step,
                                                       options.evaluations - result.evaluations)},
                true);
  result.evaluations += undeformed.evaluations;
  if (!undeformed.converged) return;
  u = end;
  lambda = end_lambda;
  result.residual = undeformed.residual;
  result.sweep = undeformed.sweep;
  result.converged = true;
}

Relaxed Relaxation::continue_past_limit_point(Nodal& u, Eigen::VectorXd& lambda, Nodal& f,
                                              const RelaxOptions& options) const {
  const Index n = u.cols();
  Relaxed result;
  result.converged = false;
  const Nodal start = u;
  Nodal force = Nodal::Zero(4, n), force_before = force, moved = force;  // unbalanced
  Eigen::VectorXd lambda_moved = Eigen::VectorXd::Zero(lambda.size());
  result.sweep = system_.force_at(u, lambda, f);
  ++result.evaluations;
  result.residual = system_.balance(f, force_before).residual();
  double tried = result.residual;  // residual from which no equilibrium was reached
  double too_little = 0.0;         // viscosity that failed
  MixedIteration::Viscosity viscosity{.fraction = first_scale, .about = {}};
  for (bool reassemble = true;
       result.evaluations < options.evaluations && viscosity.fraction < largest_scale;) {
    viscosity.about = u;
    Nodal next = u + moved;
    Eigen::VectorXd next_lambda = lambda + lambda_moved;
    const Relaxed step = (*mixed_)(
        next, next_lambda, f,
        {.tolerance = std::clamp(0.2 * result.residual, 0.5 * options.tolerance, 10.0 * options.tolerance),
         .evaluations = std::min(evaluations_of_viscous_step, options.evaluations - result.evaluations)},
        reassemble, &viscosity);
    result.evaluations += step.evaluations;
    if (!step.converged) {
      too_little = viscosity.fraction;
      viscosity.fraction *= 3.0;
      moved.setZero();
      lambda_moved.setZero();
      reassemble = true;
      continue;
    }
    moved = next - u;
    lambda_moved = next_lambda - lambda;
    u = next;
    lambda = next_lambda;
    const double before = result.residual;
    result.residual = system_.balance(f, force).residual();
    result.sweep = step.sweep;
    result.dissipated -= 0.5 * moved.cwiseProduct(force + force_before).sum();
    double curvature = 0.0;
    if (const double size = mixed_->laplacian_of(moved); size > 0.0)
      curvature = moved.cwiseProduct(force - force_before).sum() / size;
    result.curvature = std::min(result.curvature, curvature);
    force_before = force;
    (u - start).colwise().squaredNorm().maxCoeff(&result.furthest);
    if (curvature > 0.0) too_little = 0.0;
    reassemble = step.evaluations < few_evaluations && 0.6 * viscosity.fraction > too_little;
    if (reassemble) viscosity.fraction *= 0.6;
    if (result.evaluations < options.evaluations &&
        result.residual <
            std::min({before, std::max(0.5 * tried, options.tolerance), 5.0 * options.tolerance})) {
      find_equilibrium(u, lambda, f, options, result);
      if (result.converged) return result;
      tried = result.residual;
      reassemble = true;
    }
  }
  return result;
}

namespace {

// [N] masses with about the same stable step at every node.
Eigen::VectorXd fictitious_masses(const System& system) {
  Eigen::VectorXd mass = stiffness_row_sums(system.tissue().system(), system.model());
  const StiffnessBound bound = system.stiffness_bound();
  mass += bound.node;
  for (const StiffnessBound::Edge& edge : bound.edge) {
    mass[edge.a] += 2.0 * edge.weight;
    mass[edge.b] += 2.0 * edge.weight;
  }
  const double floor = 1e-6 * mass.maxCoeff();  // for nodes with little support
  return mass.cwiseMax(floor);
}

// A body with fictitious masses that is damped near critically, see Relaxation.
struct DampedVibration {
  System& system;
  const Eigen::VectorXd& mass;
  const RelaxOptions& options;
  Nodal &u, &f;
  Relaxed& result;
  const Eigen::VectorXd inverse_mass = mass.cwiseInverse();
  double dt = 0.0, frequency = 0.0;
  Nodal before = {}, u_ref = {}, f_ref = {}, unbalanced = u;  // a step ago; reference of the frequency

  void evaluate() {
    stop_if_requested();
    result.sweep = system.force(u, f);
    ++result.evaluations;
  }

  void step() {
    const double K = 2.0 / (frequency * dt), r = (K - 1.0) / (K + 1.0), keep = r * r,
                 c = std::pow(0.5 * (1.0 + r) * dt, 2);
    const Constraints& held = system.held();
    for (Index a = 0; a < u.cols(); ++a) {
      if (held.is_held_wholly(a)) continue;
      const Eigen::Vector4d now = u.col(a);
      u.col(a) +=
          keep * held.project(a, now - before.col(a)) - (c * inverse_mass[a]) * held.project(a, f.col(a));
      before.col(a) = now;
    }
  }

  // The Rayleigh quotient of what has changed since u_ref.
  double lowest_frequency() const {
    double stiffness = 0.0, inertia = 0.0;
    for (Index a = 0; a < u.cols(); ++a) {
      const Eigen::Vector4d du = system.held().project(a, u.col(a) - u_ref.col(a));
      stiffness += du.dot(f.col(a) - f_ref.col(a));
      inertia += mass[a] * du.squaredNorm();
    }
    return inertia > 0.0 ? std::sqrt(std::abs(stiffness) / inertia) : 0.0;
  }

  // Work of the reactions less that of the loads: forces times displacements.
  double work_of_reactions() const {
    double work = 0.0;
    for (Index a = 0; a < u.cols(); ++a) {
      const Eigen::Vector4d held = f.col(a) - unbalanced.col(a);
      work += held.dot(u.col(a)) - system.load_times(u, a);
    }
    return work;
  }

  // True: at rest. False: it diverges, or takes too long.
  bool comes_to_equilibrium(double caution) {
    const StableStep stable = stable_time_step(system, mass, u);
    result.evaluations += stable.iterations + 1;
    dt = 0.85 * stable.dt / std::sqrt(caution);
    if (!(stable.dt > 0.0)) return false;
    frequency = 0.02 * 2.0 / std::max(dt, 1e-300) / 10.0;
    before = u;
    evaluate();
    u_ref = u;
    f_ref = f;
    double work_before = 0.0;
    int last_ref = 0;
    for (int it = 1; result.evaluations < options.evaluations; ++it) {
      step();
      evaluate();
      if (it % between_checks != 0) continue;
      const double estimate = lowest_frequency();
      frequency = std::max(it == between_checks ? estimate : 0.7 * frequency + 0.3 * estimate, 1e-4 / dt);
      if (it - last_ref >= memory) {
        u_ref = u;
        f_ref = f;
        last_ref = it;
      }
      result.residual = system.balance(f, unbalanced).residual();
      const double work = work_of_reactions();
      if (!(result.residual < 1e3) || !std::isfinite(work)) return false;
      if (result.residual < options.tolerance &&
          std::abs(work - work_before) <= 0.1 * options.tolerance * std::abs(work))  // both may be 0
        return true;
      work_before = work;
    }
    return false;
  }
};

}  // namespace

Relaxed Relaxation::relax_dynamically(Nodal& u, Nodal& f, const RelaxOptions& options,
                                      std::int64_t evaluations) const {
  constexpr int most_attempts = 6;
  if (mass_.size() == 0) mass_ = fictitious_masses(system_);
  Relaxed result;
  result.evaluations = evaluations;
  const Nodal start = u;
  DampedVibration vibration{
      .system = system_, .mass = mass_, .options = options, .u = u, .f = f, .result = result};
  double caution = 1.0;
  for (int attempt = 1; !vibration.comes_to_equilibrium(caution); ++attempt, caution *= 1.5) {
    if (attempt == most_attempts || result.evaluations >= options.evaluations)
      throw no_equilibrium(result, system_.model());
    u = start;
  }
  return result;
}

}  // namespace dimple
