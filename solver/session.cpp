#include "solver/session.hpp"

#include <algorithm>
#include <cmath>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/path.hpp"
#include "solver/quasi_static.hpp"
#include "solver/relax.hpp"
#include "solver/stable_time_step.hpp"
#include "solver/text.hpp"

namespace dimple {

namespace {

using Nodal = ForceSystem::Nodal;

constexpr double longest_way = 0.1;  // of the tool between two equilibria, in radii of its circle
constexpr double safety = 0.8;       // of the stable step, which is that at the begin of a move

}  // namespace

struct Session::Parts {
  Parts(Model m, std::vector<Material> materials, const SessionOptions& o)
      : model(std::move(m)),
        options(o),
        system(model, {std::move(materials), model.tissue}, options.precision),
        state(system),
        constraints(make_constraints(model, options.contact, options.further)),
        relax(state, model, constraints),
        u(Nodal::Zero(4, model.node_count())),
        v(u),
        f(u),
        lambda(Eigen::VectorXd::Zero(model.patches.count())) {
    path.push(0.0, u, lambda);
  }

  Model model;
  SessionOptions options;
  ForceSystem system;
  ForceState state;
  Constraints constraints;
  Relaxation relax;
  Nodal u, v, f;
  Eigen::VectorXd lambda;
  Path path{2};  // the last equilibria
  double depth = 0.0;

  // Where the next equilibrium is looked for: on the line through the last two, if they are as far apart.
  void look_ahead(double to) {
    const double way = to - depth;
    const auto& last = path.state;
    const double before = last.size() > 1 ? last[1].at - last[0].at : 0.0;
    if (before != 0.0 && std::abs(way / before) <= 2.0 && last[1].at == depth)
      path.extrapolate(to, u, lambda);
    else if (depth == 0.0)
      first_guess(model, way, u);
    constraints.prescribe(u, to);
  }

  std::int64_t to_equilibrium(double to) {
    if (to == 0.0 && !system.viscoelastic()) {  // rest: no reaction that a residual could be measured by
      u.setZero(), v.setZero(), f.setZero(), lambda.setZero();
      depth = 0.0;
      path.state.clear();
      path.push(0.0, u, lambda);
      return 0;
    }
    look_ahead(to);
    const RelaxOptions how{.tolerance = options.tolerance};
    const Relaxed found =
        relax.has_mixed() ? relax.from_near(u, lambda, f, how) : relax(u, f, how, {}, &lambda);
    if (!found.converged) throw no_equilibrium(found, model);
    depth = to;
    path.push(depth, u, lambda);
    v.setZero();
    return found.evaluations;
  }

  // The force at u, where it is one.
  void feel() {
    const ForceSystem::Sweep sweep = state.internal_force(u, f);
    if (sweep.ok() && sweep.J_min > 0.0) return;
    throw SolveError({.fact = text("det F is ", sweep.J_min, " at integration point ", sweep.point),
                      .where = text("Session::step, ", 1e3 * depth, " mm"),
                      .why = "the move is faster or deeper than this cloud can follow",
                      .remedy = "move less far or slower, or take more nodes",
                      .code = "time-step"});
  }

  // Whatever fails leaves the body as it was.
  template <class Move>
  std::int64_t whole(const Move& move) {
    const Nodal u_before = u, v_before = v, f_before = f;
    const Eigen::VectorXd lambda_before = lambda;
    const Path path_before = path;
    const double depth_before = depth;
    const std::vector<double> past = state.past();
    try {
      return move();
    } catch (...) {
      u = u_before, v = v_before, f = f_before, lambda = lambda_before, path = path_before;
      depth = depth_before;
      state.restore_past(past);
      throw;
    }
  }

  double along_push(const std::vector<Index>& nodes) const {
    double sum = 0.0;
    for (const Index a : nodes) sum += f.col(a).head<3>().dot(model.tool.push);
    return sum;
  }
};

Session::Session(Model model, std::vector<Material> materials, const SessionOptions& options)
    : parts_(std::make_unique<Parts>(std::move(model), std::move(materials), options)) {}
Session::~Session() = default;
Session::Session(Session&&) noexcept = default;
Session& Session::operator=(Session&&) noexcept = default;

std::int64_t Session::equilibrate(double depth, double dt) {
  Parts& p = *parts_;
  return p.whole([&] {
    const double from = p.depth;
    const int ways = std::max(
        1, static_cast<int>(std::ceil(std::abs(depth - from) / (longest_way * p.model.tool.radius) - 1e-9)));
    std::int64_t evaluations = 0;
    for (int k = 1; k <= ways; ++k) {
      stop_if_asked();
      p.state.begin_step(dt / ways);
      evaluations += p.to_equilibrium(k == ways ? depth : from + (depth - from) * k / ways);
      p.state.accept_step(p.u);
    }
    return evaluations;
  });
}

std::int64_t Session::step(double depth, double dt) {
  Parts& p = *parts_;
  if (!(dt > 0.0)) throw std::invalid_argument("Session::step: dt must be positive");
  return p.whole([&] {
    const double stable = safety * stable_time_step(p.state, p.model, p.model.mass, p.constraints, p.u).dt;
    const double needed = std::max(1.0, std::ceil(dt / stable));
    if (!(needed <= static_cast<double>(p.options.steps)))
      throw SolveError({.fact = text("a move of ", dt, " s takes ", needed, " stable steps"),
                        .where = text("Session::step, ", 1e3 * p.depth, " mm"),
                        .why = text("at most ", p.options.steps,
                                    " are taken at once (SessionOptions::steps); the "
                                    "stable step is ",
                                    stable, " s"),
                        .remedy = "move in parts, or call equilibrate(), which does not follow waves",
                        .code = "time-step"});
    const auto steps = static_cast<std::int64_t>(needed);
    const double h = dt / static_cast<double>(steps), from = p.depth, rate = (depth - from) / dt;
    const Eigen::VectorXd inverse_mass = p.model.mass.cwiseInverse();
    for (std::int64_t s = 1; s <= steps; ++s) {
      stop_if_asked();
      p.state.begin_step(h);
      p.feel();
      p.state.accept_step(p.u);
      const double now = from + (depth - from) * static_cast<double>(s) / static_cast<double>(steps);
      for (Index a = 0; a < p.u.cols(); ++a) {
        if (!p.constraints.is_held_wholly(a)) {
          p.v.col(a) -= p.f.col(a) * (h * inverse_mass[a]);
          p.u.col(a) += p.v.col(a) * h;
        }
        p.constraints.speed(a, p.v.col(a), rate);
        p.constraints.place(a, p.u.col(a), now);
      }
      p.depth = now;
    }
    p.feel();
    p.lambda = p.model.scheme.pressure_patches ? pressures_of_volumes(p.state, p.model) : p.lambda;
    p.path.state.clear();  // an equilibrium is looked for from here on
    p.path.push(depth, p.u, p.lambda);
    return steps;
  });
}

double Session::depth() const {
  return parts_->depth;
}
double Session::force() const {
  return parts_->along_push(parts_->model.indenter);
}
double Session::base_force() const {
  return -parts_->along_push(parts_->model.base);
}
Points Session::displacement() const {
  return parts_->u.topRows<3>();
}
Points Session::positions() const {
  return parts_->model.X + parts_->u.topRows<3>();
}
Points Session::forces() const {
  return parts_->f.topRows<3>();
}
const Model& Session::model() const {
  return parts_->model;
}

}  // namespace dimple
