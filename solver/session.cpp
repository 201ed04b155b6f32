#include "solver/session.hpp"

#include <algorithm>
#include <cmath>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/live/session_parts.hpp"
#include "solver/march/central_differences.hpp"
#include "solver/march/quasi_static.hpp"
#include "solver/text.hpp"

namespace dimple {

Session::Parts::Parts(Model m, std::vector<Material> materials, const SessionOptions& o)
    : model(std::move(m)),
      options(o),
      tissue(model, {std::move(materials), model.tissue}, options.precision),
      system(make_system(tissue, model, options.contact, options.further, options.loads, options.tolerance,
                         options.indenter.get())),
      relax(*system),
      u(system->step_start().u),
      v(Nodal::Zero(4, model.node_count())),
      f(v),
      lambda(system->step_start().lambda),
      moves_supports(std::any_of(options.further.begin(), options.further.end(),
                                 [](const HeldSet& s) { return s.fraction != 0.0; })),
      tool(model.tool),
      unloaded_past(system->past()) {
  if (options.indenter) {
    if (!model.bonded_patch.empty())
      throw SolveError(
          {.fact = "the model has nodes of a bonded patch, which would hold the tissue under the tool",
           .where = "Session",
           .why = "a contacting tool needs a model without them",
           .remedy = "build the model with boundary.contact_radius_mm, or leave the tool out",
           .code = "no-live"});
    tool.centre = options.indenter->pose.tip;
    tool.radius = options.indenter->shape.radius;
    longest_tool = options.indenter->shape.length;
    require_curve_of_equilibria();
  }
  longest = live_constants.longest_move * tool.radius / max_displacement_ratio(options.further);
  thick = (model.X.transpose() * tool.approach).maxCoeff() - tool.centre.dot(tool.approach);
  path.push(0.0, u, lambda);
  known.apart = live_constants.kept_apart * tool.radius;
  known.add({0.0, u, lambda, 0.0, 0.0});
  nothing_left();
  reset_to_undeformed();
}

// Under a contacting tool states must serve on approach and on retraction, repeatedly.
void Session::Parts::require_curve_of_equilibria() const {
  const bool frictional = options.indenter->friction > 0.0;
  if (!frictional && !system->viscoelastic() && relax.has_mixed()) return;
  throw SolveError({.fact = frictional ? "a live tool has no friction"
                                       : "a live contacting tool cannot be used with this tissue",
                    .where = "Session",
                    .why = frictional ? "with friction its force depends on its path"
                           : system->viscoelastic()
                               ? "tissue that relaxes continues to move after the tool has left"
                               : "its contact needs pressure patches",
                    .remedy = "use a tool without friction, elastic tissue, the scheme 'converging' and a "
                              "Poisson's ratio above 0.3, or the bonded indenter",
                    .code = "no-live"});
}

// Sets the remainders to those of an equilibrium.
void Session::Parts::nothing_left() {
  left.force.setZero(4, u.cols());
  left.volume.setZero(model.patches.count());
  left.energy = left.contact = 0.0;
}

// State with the tool lifted: undeformed, or under the loads.
void Session::Parts::reset_to_undeformed() {
  u = system->step_start().u;
  lambda = system->step_start().lambda;
  v.setZero(), f.setZero();
  depth = 0.0;
  system->set({});
  if (!system->loaded()) return;
  system->force_at(u, lambda, f);
}

// Viscoelastic tissue forgets its indentation: the release of a bonded patch is not modelled.
void Session::Parts::lift() {
  if (system->viscoelastic()) system->restore_past(unloaded_past);
  waited = 0.0;
  reset_to_undeformed();
  nothing_left();
  residual = 0.0;
  pending.reset();
  progress = {};
  state = State::air;
}

void Session::Parts::begin_contact(double its_residual) {
  residual = its_residual;
  pending.reset();
  state = State::in_contact;
}

// After a cut the state is kept until an equilibrium of the cut body is found.
void Session::Parts::move_freely() {
  if (state == State::air) state = State::in_contact;
}

void Session::Parts::continue_from(const Parts& before, const Points& its,
                                   const std::vector<Index>& of_patch) {
  if (before.depth == 0.0 || (options.indenter && before.depth <= 0.0)) return;
  u.topRows<3>() = its;
  f.setZero();
  f.leftCols(before.f.cols()) = before.f;
  depth = before.depth;
  const PressurePatches &now = model.patches, &were = before.model.patches;
  for (Index b = 0; b < now.count(); ++b) {
    const Index of = of_patch[static_cast<std::size_t>(b)];
    lambda[b] = before.lambda[of] / were.volume[of] * now.volume[b];
  }
  const Index contacts = lambda.size() - now.count();
  if (contacts == before.lambda.size() - were.count()) lambda.tail(contacts) = before.lambda.tail(contacts);
  path.point.clear();
  path.push(depth, u, lambda);
  pending = {.at = depth, .residual = 0.0, .u = u, .lambda = lambda};
  residual = 1.0;  // unknown
  progress = {};
  state = State::cut;
}

double Session::Parts::resistance(const Nodal& its, const Eigen::VectorXd& l, const Nodal& force,
                                  double at) const {
  RigidContact* tool_contact = system->tool_contact();
  if (!tool_contact) return along_approach(model, model.bonded_patch, force);
  system->set({.depth = at});
  tool_contact->set_forces(l.segment(model.patches.count(), tool_contact->unknowns()));
  Nodal of_contact = Nodal::Zero(4, its.cols());
  tool_contact->add_force(its, system->now(), of_contact);
  return tool_contact->along(tool.approach);
}

// Predicts the next equilibrium on the line through the last two, if their distance allows it.
void Session::Parts::predict(double to) {
  const double distance = to - depth;
  const auto& last = path.point;
  const double before = last.size() > 1 ? last[1].at - last[0].at : 0.0;
  if (before != 0.0 && std::abs(distance / before) <= 2.0 && last[1].at == depth)
    path.extrapolate(to, u, lambda);
  else if (depth == 0.0 && !options.indenter)  // contact grows from a point
    first_guess(model, model.tool.approach, distance, u);
  system->project_to_admissible(lambda);
  system->set({.depth = to}, u);
}

std::int64_t Session::Parts::to_equilibrium(double to) {
  // Equilibrium at rest has no reaction to scale a residual.
  if ((to == 0.0 && !system->viscoelastic()) || (options.indenter && to <= 0.0)) {
    reset_to_undeformed();
    depth = to;
    // After a cut the next frame still begins with the state that continue_from() left.
    if (state == State::in_contact) state = State::air;
    path.point.clear();
    path.push(to, u, lambda);
    return 0;
  }
  predict(to);
  const RelaxOptions how{.tolerance = options.tolerance};
  const Relaxed found = relax.has_mixed() ? relax.from_near(u, lambda, f, how) : relax(u, f, how, &lambda);
  if (!found.converged) throw no_equilibrium(found, model);
  depth = to;
  path.push(depth, u, lambda);
  v.setZero();
  nothing_left();
  begin_contact(found.residual);
  return found.evaluations;
}

// Runs `move`; if it throws, the body is restored (strong exception guarantee).
template <class Move>
std::int64_t Session::Parts::with_rollback(const Move& move) {
  const Nodal u_before = u, v_before = v, f_before = f;
  const Eigen::VectorXd lambda_before = lambda;
  const Predictor path_before = path;
  const double depth_before = depth, residual_before = residual;
  const MixedIteration::Residual left_before = left;
  const std::optional<Attempt> begun_before = pending;
  const State state_before = state;
  const std::vector<double> past = system->past();
  try {
    return move();
  } catch (...) {
    u = u_before, v = v_before, f = f_before, lambda = lambda_before, path = path_before;
    depth = depth_before, residual = residual_before, left = left_before;
    pending = begun_before, state = state_before;
    system->restore_past(past);
    throw;
  }
}

std::int64_t Session::Parts::equilibrate(double to, double dt) {
  return with_rollback([&] {
    const double from = depth;
    const int directions = std::max(1, static_cast<int>(std::ceil(std::abs(to - from) / longest - 1e-9)));
    std::int64_t evaluations = 0;
    for (int k = 1; k <= directions; ++k) {
      stop_if_requested();
      system->begin_step(dt / directions);
      evaluations += to_equilibrium(k == directions ? to : from + (to - from) * k / directions);
      system->accept_step(u);
    }
    return evaluations;
  });
}

// Force at u. Throws if a point is inverted.
void Session::Parts::find_force() {
  const ForceSystem::Sweep sweep = system->force(u, f);
  if (sweep.ok() && sweep.J_min > 0.0) return;
  throw SolveError({.fact = text("det F is ", sweep.J_min, " at integration point ", sweep.point),
                    .where = text("Session::step, ", 1e3 * depth, " mm"),
                    .why = "the move is too fast or too deep for these nodes",
                    .remedy = "move less far or slower, or use more nodes",
                    .code = "time-step"});
}

// The number of steps of central differences for a move within `dt` [s].
std::int64_t Session::Parts::count_steps(double dt) {
  const double stable = live_constants.safety * stable_time_step(*system, model.mass, u).dt;
  const double needed = std::max(1.0, std::ceil(dt / stable));
  if (!(needed <= static_cast<double>(options.steps)))
    throw SolveError(
        {.fact = text("a move of ", dt, " s takes ", needed, " stable steps"),
         .where = text("Session::step, ", 1e3 * depth, " mm"),
         .why = text("at most ", options.steps,
                     " are allowed at once (SessionOptions::steps); the stable step is ", stable, " s"),
         .remedy = "move in parts, or call equilibrate(), which has no inertia",
         .code = "time-step"});
  return static_cast<std::int64_t>(needed);
}

std::int64_t Session::Parts::step(double to, double dt) {
  return with_rollback([&] {
    system->tissue().hold_pressures({});  // release those of an equilibrium
    move_freely();
    const std::int64_t steps = count_steps(dt);
    const double h = dt / static_cast<double>(steps), from = depth, rate = (to - from) / dt;
    const Eigen::VectorXd inverse_mass = model.mass.cwiseInverse();
    for (std::int64_t s = 1; s <= steps; ++s) {
      stop_if_requested();
      system->begin_step(h);
      find_force();
      system->accept_step(u);
      depth = from + (to - from) * static_cast<double>(s) / static_cast<double>(steps);
      const CentralDifferences differences{.dt = h, .kick = h, .rate = rate, .depth = depth};
      differences(0, u.cols(), system->held(), inverse_mass, f, v, u);
      system->set({.depth = depth});
    }
    find_force();
    lambda = model.scheme.pressure_patches ? pressures_of_volumes(*system) : lambda;
    path.point.clear();  // the next search starts here
    path.push(to, u, lambda);
    return steps;
  });
}

Session::Session(Model model, std::vector<Material> materials, const SessionOptions& options)
    : parts_(std::make_unique<Parts>(std::move(model), std::move(materials), options)) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&&) noexcept = default;

std::int64_t Session::equilibrate(double depth, double dt) {
  return parts_->equilibrate(depth, dt);
}

LiveFrame Session::follow(double depth, const FrameLimit& limit, double dt) {
  Parts& p = *parts_;
  if (!std::isfinite(depth) || limit.evaluations < 0 || (limit.evaluations == 0 && !(limit.seconds > 0.0)))
    throw std::invalid_argument("Session::follow: the depth must be a number, and the limit positive");
  if (!p.relax.has_mixed())
    throw SolveError(
        {.fact = "this scheme or material has no solution in bounded time",
         .where = "Session::follow",
         .why = "each of its equilibria needs hundreds of force evaluations",
         .remedy = "use the scheme 'converging' and a Poisson's ratio above 0.3, or call equilibrate()",
         .code = "no-live"});
  return p.follow(depth, limit, dt);
}

void Session::lift() {
  parts_->lift();
  parts_->path.point.clear();
  parts_->path.push(0.0, parts_->u, parts_->lambda);
}

std::int64_t Session::step(double depth, double dt) {
  Parts& p = *parts_;
  if (!(dt > 0.0)) throw std::invalid_argument("Session::step: dt must be positive");
  if (p.options.indenter)
    throw SolveError({.fact = "a contacting tool is not modelled with inertia",
                      .where = "Session::step",
                      .why = "its contact is solved in equilibrium",
                      .remedy = "call equilibrate() or follow()",
                      .code = "no-live"});
  return p.step(depth, dt);
}

void Session::continue_from(const Session& before, const Points& u, const std::vector<Index>& of_patch) {
  Parts& p = *parts_;
  const Parts& was = *before.parts_;
  if (u.cols() != p.model.node_count() || u.cols() < was.model.node_count() ||
      static_cast<Index>(of_patch.size()) != p.model.patches.count())
    throw std::invalid_argument("Session::go_on_from: the numbers of nodes or patches are others");
  if (p.system->viscoelastic())
    throw SolveError({.fact = "tissue that relaxes is not cut while a tool is moved by hand",
                      .where = "Session::go_on_from",
                      .why = "the history of each point is not carried over",
                      .remedy = "use elastic tissue",
                      .code = "no-live"});
  p.continue_from(was, u, of_patch);
}

double Session::depth() const {
  return parts_->depth;
}
double Session::force() const {
  const Parts& p = *parts_;
  return p.resistance(p.u, p.lambda, p.f, p.depth);
}
double Session::base_force() const {
  return -along_approach(parts_->model, parts_->model.base, parts_->f);
}
Wrench Session::on_tool() const {
  const Parts& p = *parts_;
  p.resistance(p.u, p.lambda, p.f, p.depth);
  p.system->set({.depth = p.depth});
  return p.system->on_tool(p.u, p.f);
}
Points Session::nodal_parameters() const {
  return parts_->u.topRows<3>();
}
Points Session::forces() const {
  return parts_->f.topRows<3>();
}
const Model& Session::model() const {
  return parts_->model;
}
ToolPlace Session::tool() const {
  return parts_->tool;
}
const RigidBody* Session::indenter() const {
  return parts_->options.indenter.get();
}

}  // namespace dimple
