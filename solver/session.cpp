#include "solver/session.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/equilibrium/relax.hpp"
#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/live/known_states.hpp"
#include "solver/march/central_differences.hpp"
#include "solver/march/predictor.hpp"
#include "solver/march/quasi_static.hpp"
#include "solver/text.hpp"

namespace dimple {

namespace {

using Nodal = ForceSystem::Nodal;

constexpr double longest_way = 0.1;  // of whatever moves between two equilibria, in radii of the circle
constexpr double safety = 0.8;       // of the stable step, which is that at the begin of a move

// Of a tool that is followed. In radii: between two states that are kept.
constexpr double kept_apart = 0.04;
constexpr double shown = 0.05;          // residual of a state that is shown
constexpr double passed = 0.01;         // and of one on the way to where the tool is to be
constexpr double slowest = 1.0 / 32.0;  // of longest_way, where the tool stops
constexpr double folded = 0.01;         // share of inverted points
constexpr double widest = 2.5;          // displacement, in depths of the tool
// Of a tool that touches, of its depth and of its radius.
constexpr double deepest_first = 0.35;  // radii, see find_first_contact()
constexpr std::int64_t for_first = 60;
constexpr double open_contact = 0.02, deepest_in_tool = 0.05, beyond_samples = 1e-3;
constexpr double gradient_good = 0.1;  // radii, for which dJ/du serves
// Of the error: shares of the correction, of the mean of the energies left and of the tool, and of the force.
// Chosen before the study that counts how often it holds (tests/bench/README.md).
constexpr double of_correction = 0.5, of_energy = 0.1, of_force = 1e-3;
// Of a tool that touches, whose contact has no edge yet where few evaluations have looked for it. Chosen on a
// sphere that comes straight down on a cylinder, where with 3 evaluations a frame 0.1 did not hold.
constexpr double of_energy_in_contact = 0.3;
// Without coming nearer, after which a tool has stopped: several times what the slowest steps took.
constexpr std::int64_t fruitless_evaluations = 300, fruitless_frames = 100;

}  // namespace

double force_apart(const LiveFrame& frame, double apart) {
  if (apart == 0.0) return 0.0;
  const double force = std::abs(frame.force) + frame.error_at_depth;
  if (apart < 0.0) return frame.depth > 0.0 ? force * std::min(1.0, -2.0 * apart / frame.depth) : force;
  if (!(apart <= frame.depth)) return std::numeric_limits<double>::infinity();
  const double grown = 1.0 + apart / frame.depth;
  return force * (grown * grown - 1.0);
}

struct Session::Parts {
  Parts(Model m, std::vector<Material> materials, const SessionOptions& o)
      : model(std::move(m)),
        options(o),
        tissue(model, {std::move(materials), model.tissue}, options.precision),
        system(make_system(tissue, model, options.contact, options.further, options.loads, options.tolerance,
                           options.touch.get())),
        relax(*system),
        u(system->step_start().u),
        v(Nodal::Zero(4, model.node_count())),
        f(v),
        lambda(system->step_start().lambda),
        tool(model.tool) {
    if (options.touch) {
      if (!model.circle.empty())
        throw SolveError(
            {.fact = "the model has nodes of a circle, which would hold the tissue under the tool",
             .where = "Session",
             .why = "a tool that touches presses on the surface of a model without them",
             .remedy = "build the model with boundary.contact_radius_mm, or leave the tool out",
             .code = "no-live"});
      tool.centre = options.touch->pose.tip;
      tool.radius = options.touch->shape.radius;
      longest_tool = options.touch->shape.length;
      require_curve_of_equilibria();
    }
    longest = longest_way * tool.radius / longest_share(options.further);
    thick = (model.X.transpose() * tool.push).maxCoeff() - tool.centre.dot(tool.push);
    path.push(0.0, u, lambda);
    known.apart = kept_apart * tool.radius;
    known.add({0.0, u, lambda, 0.0, 0.0});
    nothing_left();
    lie_at_rest();
  }

  // Under a tool that touches: what was found on the way in must serve on the way out, and again.
  void require_curve_of_equilibria() const {
    const bool rubs = options.touch->friction > 0.0;
    if (!rubs && !system->viscoelastic() && relax.has_mixed()) return;
    throw SolveError({.fact = rubs ? "a tool that rubs cannot be followed"
                                   : "this tissue cannot be followed under a tool that touches",
                      .where = "Session",
                      .why = rubs ? "with friction its force depends on the way that it took"
                             : system->viscoelastic()
                                 ? "tissue that relaxes goes on moving where the tool has left it"
                                 : "its contact is found with patches that hold the volume",
                      .remedy = "take a tool without friction, elastic tissue, the scheme 'converging' and a "
                                "Poisson's ratio above "
                                "0.3, or the circle",
                      .code = "no-live"});
  }

  // Of an equilibrium.
  void nothing_left() {
    left.force.setZero(4, u.cols());
    left.volume.setZero(model.patches.count());
    left.energy = left.contact = 0.0;
  }

  Model model;
  SessionOptions options;
  ForceSystem tissue;
  std::unique_ptr<System> system;
  Relaxation relax;
  Nodal u, v, f;
  Eigen::VectorXd lambda;
  // Which may draw the tissue away from the tool.
  bool moves_supports = std::any_of(options.further.begin(), options.further.end(),
                                    [](const HeldSet& s) { return s.share != 0.0; });
  ToolPlace tool;  // see Session::tool()
  double longest;  // way of the tool, likewise [m]
  double thick;    // of the body along the push, from where the tool touches it [m]
  double longest_tool = std::numeric_limits<double>::infinity();  // [m]
  Predictor path{2};                                              // the last equilibria
  double depth = 0.0;

  // Of follow().
  using Clock = std::chrono::steady_clock;
  KnownStates known;
  MixedIteration::Left left;  // at u
  double residual = 0.0;      // there
  double caution = 1.0;       // how much of longest_way is tried
  double gradient_at = -1.0;  // depth, of dJ/du
  Clock::duration beside{};   // what a frame takes beside the iteration, mean of the last few
  struct Begun {              // an equilibrium that is not good enough yet
    double at = 0.0, residual = 0.0;
    Nodal u;
    Eigen::VectorXd lambda;
  };
  std::optional<Begun> begun;
  bool unsettled = false;  // what is shown is a state of the body before it was cut
  // Of tissue that relaxes: what it remembers where it was never touched, whether that is so, and the time
  // [s] that it has not been followed through.
  std::vector<double> untouched = system->past();
  bool resting = true;
  double waited = 0.0;
  std::int64_t fruitless = 0, fruitless_calls = 0;  // evaluations and frames since the tool came nearer

  // Where the next equilibrium is looked for: on the line through the last two, if they are as far apart.
  void look_ahead(double to) {
    const double way = to - depth;
    const auto& last = path.point;
    const double before = last.size() > 1 ? last[1].at - last[0].at : 0.0;
    if (before != 0.0 && std::abs(way / before) <= 2.0 && last[1].at == depth)
      path.extrapolate(to, u, lambda);
    else if (depth == 0.0 && !options.touch)  // contact grows from a point
      first_guess(model, model.tool.push, way, u);
    system->bring_back(lambda);
    system->set({.depth = to}, u);
  }

  // The force on the tool along its push at a state [N]; the contact is of there from now on.
  double resistance(const Nodal& its, const Eigen::VectorXd& l, const Nodal& force, double at) const {
    TouchingTool* touching = system->touching();
    if (!touching) return along_push(model, model.circle, force);
    system->set({.depth = at});
    touching->set_forces(l.segment(model.patches.count(), touching->unknowns()));
    Nodal of_contact = Nodal::Zero(4, its.cols());
    touching->add_force(its, system->now(), of_contact);
    return touching->along(tool.push);
  }

  // With the tool lifted: undeformed, or as the loads have it.
  void lie_at_rest() {
    u = system->step_start().u;
    lambda = system->step_start().lambda;
    v.setZero(), f.setZero();
    depth = 0.0;
    system->set({});
    if (!system->loaded()) return;
    system->force_at(u, lambda, f);
  }

  std::int64_t to_equilibrium(double to) {
    // Rest: no reaction that a residual could be measured by.
    if ((to == 0.0 && !system->viscoelastic()) || (options.touch && to <= 0.0)) {
      lie_at_rest();
      depth = to;
      path.point.clear();
      path.push(to, u, lambda);
      return 0;
    }
    look_ahead(to);
    const RelaxOptions how{.tolerance = options.tolerance};
    const Relaxed found = relax.has_mixed() ? relax.from_near(u, lambda, f, how) : relax(u, f, how, &lambda);
    if (!found.converged) throw no_equilibrium(found, model);
    depth = to;
    path.push(depth, u, lambda);
    v.setZero();
    begun.reset();
    nothing_left();
    unsettled = resting = false;
    residual = found.residual;
    return found.evaluations;
  }

  // Where to look for the equilibrium at a depth.
  void guess(double to, Nodal& next, Eigen::VectorXd& l) const {
    if (known.state.size() < 2) {
      next = system->step_start().u;
      l = system->step_start().lambda;
      if (!options.touch) first_guess(model, model.tool.push, to, next);
    } else if (system->viscoelastic() || (depth > known.deepest() && to > depth)) {
      // What relaxes has no curve of states; and where the tool is may be known less well than close by.
      const KnownStates::Slope slope = known.slope(depth);
      next = u + (to - depth) * slope.u;
      l = lambda + (to - depth) * slope.lambda;
      system->bring_back(l);
    } else {
      known.guess(to, next, l);
      system->bring_back(l);
    }
    system->set({.depth = to}, next);
  }

  // The next place on the way: as near to what is known as can be trusted.
  double towards(double asked) const {
    if (known.state.size() < 2) return known.apart;
    const double way = caution * longest;
    if (system->viscoelastic()) return std::clamp(asked, depth - way, depth + way);
    return std::min(asked, std::max(known.deepest(), depth) + way);
  }

  // What the forces and volumes left unbalanced at a depth are to the force on the tool; see
  // Session::follow().
  double correction_at(double at, const MixedIteration::Left& its) const {
    const KnownStates::Slope slope = known.slope(at);
    return slope.u.cwiseProduct(its.force).sum() + slope.lambda.head(its.volume.size()).dot(its.volume);
  }

  // Elastic tissue under a bonded tool pushes back: a state in which it does not lies on another branch.
  bool pushes_back(const Begun& now, const Nodal& force, const MixedIteration::Left& its) const {
    const double at = now.at;
    if (system->viscoelastic() || at <= 0.0 || moves_supports) return true;
    const double raw = resistance(now.u, now.lambda, force, at);
    return raw > 0.0 && (known.state.size() < 2 || raw + correction_at(at, its) > 0.0);
  }

  bool good(const Relaxed& found, const Nodal& its, double at) const {
    const double reach = system->viscoelastic() ? std::max({at, depth, known.deepest()}) : at;
    return std::isfinite(found.residual) && found.residual < shown && found.sweep.ok() &&
           static_cast<double>(found.sweep.inverted) <= folded * static_cast<double>(model.point_count()) &&
           (its - system->step_start().u).colwise().norm().maxCoeff() <
               widest * longest_share(options.further) * reach;
  }

  // Of a tool that touches, after resistance(): as a run's guards ask, it stays out of the body.
  bool touches_well(const Begun& now, const MixedIteration::Left& its) const {
    if (!options.touch) return true;
    if (its.contact > open_contact) return false;
    const TouchingTool::Audit audit = system->touching()->audit(now.u, system->now());
    return audit.penetration <= deepest_in_tool * tool.radius && audit.beyond <= beyond_samples * tool.radius;
  }

  LiveFrame frame_at_depth(double asked, std::int64_t evaluations) const {
    LiveFrame frame{.asked = asked, .depth = depth, .residual = residual, .evaluations = evaluations};
    frame.force = resistance(u, lambda, f, depth);
    system->set({.depth = depth});
    frame.on_tool = system->on_tool(u, f);
    frame.per_force = per_force(frame);
    if (options.touch && depth > 0.0)
      frame.penetration = system->touching()->audit(u, system->now()).penetration;
    if (unsettled) {
      frame.error_at_depth = std::abs(frame.force);
      return frame;
    }
    if (known.state.size() < 2) return frame;
    const double correction = correction_at(depth, left), stiffness = known.slope(depth).force;
    frame.stiffness = stiffness;
    frame.force += correction;
    frame.on_tool.head<3>() -= correction * model.tool.push;
    frame.per_force = per_force(frame);
    frame.error_at_depth = of_correction * std::abs(correction) +
                           (options.touch ? of_energy_in_contact : of_energy) *
                               std::sqrt(left.energy * std::max(0.0, stiffness)) +
                           of_force * std::abs(frame.force);
    return frame;
  }

  Wrench per_force(const LiveFrame& frame) const {
    constexpr double steepest = 10.0;  // of the whole force to its component along the push
    if (frame.on_tool.head<3>().norm() < steepest * frame.force) return frame.on_tool / frame.force;
    for (const KnownStates::State& one : known.state)
      if (!one.per_force.isZero(0.0)) return one.per_force;
    return Wrench::Zero();
  }

  // Of tissue that relaxes the dent is forgotten: whose nodes a circle has let go is not modelled.
  void lift() {
    if (system->viscoelastic()) system->restore_past(untouched);
    resting = true;
    waited = 0.0;
    lie_at_rest();
    nothing_left();
    residual = 0.0;
    begun.reset();
    unsettled = false;
    fruitless = fruitless_calls = 0;
  }

  // See Session::go_on_from().
  void go_on_from(const Parts& before, const Points& its, const std::vector<Index>& of_patch) {
    if (before.depth == 0.0 || (options.touch && before.depth <= 0.0)) return;
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
    begun = {.at = depth, .residual = 0.0, .u = u, .lambda = lambda};
    residual = 1.0;  // unknown
    unsettled = true;
    fruitless = fruitless_calls = 0;
  }

  // One call of follow().
  struct Call {
    Call(double asked_, double most, const FrameLimit& limit, double tolerance, Clock::duration beside)
        : asked(asked_),
          to(std::clamp(asked_, 0.0, most)),
          timed(limit.evaluations == 0),
          begin(timed ? Clock::now() : Clock::time_point()),
          how{.tolerance = tolerance, .evaluations = timed ? 100000 : limit.evaluations},
          all(how.evaluations) {
      if (timed)
        how.until =
            begin +
            std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(limit.seconds)) -
            beside - beside / 2;
    }
    double asked, to;  // where the tool is to be, and where that is in the body
    bool timed;
    Clock::time_point begin;
    RelaxOptions how;  // for the rest of the call
    std::int64_t all;
    Clock::duration iterating{};
    bool time_is_up = false, moved = false;
    bool back = false;  // to what is known, as nothing between was found
    LiveFrame::Tool tool = LiveFrame::Tool::there;
    Begun now;  // what is tried
    Nodal force;
    MixedIteration::Left left;
    bool arrives() const { return now.at == to; }
  };

  LiveFrame follow(double asked, const FrameLimit& limit, double dt) {
    Call call(asked, longest_tool, limit, options.tolerance, beside);
    const double from = depth;
    const bool was_unsettled = unsettled;
    call.force.resize(4, u.cols());
    system->begin_step(waited += dt);
    v.setZero();
    const std::int64_t at_first =
        options.touch && call.to > 0.0 && known.state.size() < 2 && !(unsettled && begun)
            ? find_first_contact()
            : 0;
    if (call.to > 0.0 || (system->viscoelastic() && asked == 0.0 && !resting))
      while (comes_nearer(call)) {
      }
    else
      lift();
    if (call.moved) {
      if (system->viscoelastic()) system->accept_step(u);
      waited = 0.0;
    }
    path.point.clear();
    path.push(depth, u, lambda);
    LiveFrame frame = frame_at_depth(asked, at_first + call.all - call.how.evaluations);
    const bool arrived = depth == call.to && !unsettled;
    const bool nearer = depth != from || unsettled != was_unsettled;
    fruitless = arrived || nearer ? 0 : fruitless + frame.evaluations;
    fruitless_calls = arrived || nearer ? 0 : fruitless_calls + 1;
    tell_whether_there(frame, call, arrived);
    if (call.timed) beside += (Clock::now() - call.begin - call.iterating - beside) / 5;
    return frame;
  }

  // Its status, and the error of the pose that was asked for.
  void tell_whether_there(LiveFrame& frame, const Call& call, bool arrived) {
    using Tool = LiveFrame::Tool;
    if (!arrived && call.tool == Tool::stopped) fruitless = fruitless_evaluations;  // until it comes nearer
    const bool stuck = fruitless >= fruitless_evaluations || fruitless_calls >= fruitless_frames;
    frame.tool = arrived ? Tool::there : stuck ? Tool::stopped : Tool::lags;
    if (call.to > thick || call.asked > longest_tool) frame.tool = Tool::beyond;
    const bool unknown = frame.tool == Tool::stopped || frame.tool == Tool::beyond;
    frame.error = unknown ? std::numeric_limits<double>::infinity()
                          : frame.error_at_depth + force_apart(frame, call.to - depth);
  }

  // From rest there is nothing to begin with, and few evaluations get nowhere: once, it takes more. A contact
  // that is too small for the nodes may not be found; then a deeper one is tried.
  std::int64_t find_first_contact() {
    std::int64_t evaluations = 0;
    for (double at = known.apart; at <= deepest_first * tool.radius && known.state.size() < 2; at *= 2.0) {
      Begun now{.at = at, .residual = 0.0, .u = u, .lambda = lambda};
      Nodal force(4, u.cols());
      MixedIteration::Left its;
      guess(at, now.u, now.lambda);
      const Relaxed found = relax.mixed().within(
          now.u, now.lambda, force, {.tolerance = options.tolerance, .evaluations = for_first}, true, its);
      evaluations += found.evaluations;
      if (!good(found, now.u, at) || !pushes_back(now, force, its) || !touches_well(now, its)) continue;
      known.add({at, now.u, now.lambda, found.residual, resistance(now.u, now.lambda, force, at)});
    }
    gradient_at = -1.0;
    return evaluations;
  }

  // From the state that is tried, whichever that is.
  Relaxed search(Call& call, bool anew) {
    system->set({.depth = call.now.at});
    const Relaxed found =
        relax.mixed().within(call.now.u, call.now.lambda, call.force, call.how, anew, call.left);
    call.how.evaluations -= found.evaluations;
    call.time_is_up = call.how.evaluations < 1 || call.left.late;
    return found;
  }
  bool is_good(const Call& call, const Relaxed& found) const {
    return good(found, call.now.u, call.now.at) && pushes_back(call.now, call.force, call.left) &&
           touches_well(call.now, call.left);
  }

  // One search for an equilibrium. False: no further one follows it.
  bool comes_nearer(Call& call) {
    const Clock::time_point lap = call.timed ? Clock::now() : Clock::time_point();
    look_for_place(call);
    Begun& now = call.now;
    call.how.tolerance = call.arrives() ? options.tolerance : std::max(options.tolerance, passed);
    const bool anew = gradient_at < 0.0 || std::abs(now.at - gradient_at) > gradient_good * tool.radius;
    if (anew) gradient_at = now.at;
    Relaxed found = search(call, anew);
    bool is_well = is_good(call, found);
    // On the way little is asked of a state: what is not good then may be where more is asked.
    if (!is_well && !call.time_is_up && call.how.tolerance > options.tolerance &&
        found.residual < call.how.tolerance) {
      call.how.tolerance = options.tolerance;
      found = search(call, false);
      is_well = is_good(call, found);
    }
    if (call.timed) call.iterating += Clock::now() - lap;
    if (is_well) {
      take(call, found.residual);
      return !call.arrives() && !call.back && !call.time_is_up;
    }
    return !call.back && tries_again(call, found.residual);
  }

  // Where the next equilibrium is looked for, and from which state.
  void look_for_place(Call& call) {
    Begun& now = call.now;
    if (call.back) {
      const KnownStates::State& near = known.nearest(call.to);
      now = {.at = near.at, .residual = 0.0, .u = near.u, .lambda = near.lambda};
    } else if (begun && (begun->at <= call.to || known.state.size() < 2)) {
      now = std::move(*begun);
    } else if (now.at = towards(call.to), now.residual = 0.0; now.at == depth && depth > 0.0) {
      now.u = u;
      now.lambda = lambda;
    } else {
      guess(now.at, now.u, now.lambda);
    }
    begun.reset();
  }

  // The state that was found is shown from now on.
  void take(Call& call, double its_residual) {
    u.swap(call.now.u), lambda.swap(call.now.lambda), f.swap(call.force);
    std::swap(left, call.left);
    residual = its_residual;
    depth = call.now.at;
    unsettled = resting = false;
    call.moved = true;
    caution = std::min(1.0, 1.3 * caution);
    const LiveFrame here = frame_at_depth(call.asked, 0);
    known.add({depth, u, lambda, system->viscoelastic() ? 0.0 : residual, here.force, here.per_force});
  }

  // After a search without a state to be shown: what the next one tries. False: none follows.
  bool tries_again(Call& call, double its_residual) {
    Begun& now = call.now;
    // A tool that is lifted again must follow, by what is known if not by what lies between.
    call.back = now.at < depth && !system->viscoelastic();
    if (call.back) {
      gradient_at = -1.0;
      call.how.evaluations = std::max<std::int64_t>(call.how.evaluations, 1);
      return true;
    }
    const bool nears =
        std::isfinite(its_residual) && (now.residual == 0.0 || its_residual < 0.7 * now.residual);
    if (call.time_is_up && nears) {
      now.residual = its_residual;
      begun = std::move(now);
      return false;
    }
    caution *= 0.5;
    gradient_at = -1.0;
    if (caution >= slowest) return !call.time_is_up;
    caution = 2.0 * slowest;
    call.tool = LiveFrame::Tool::stopped;
    return false;
  }

  // The force at u, where it is one.
  void find_force() {
    const ForceSystem::Sweep sweep = system->force(u, f);
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
    const Predictor path_before = path;
    const double depth_before = depth, residual_before = residual;
    const MixedIteration::Left left_before = left;
    const std::optional<Begun> begun_before = begun;
    const bool unsettled_before = unsettled, resting_before = resting;
    const std::vector<double> past = system->past();
    try {
      return move();
    } catch (...) {
      u = u_before, v = v_before, f = f_before, lambda = lambda_before, path = path_before;
      depth = depth_before, residual = residual_before, left = left_before;
      begun = begun_before, unsettled = unsettled_before, resting = resting_before;
      system->restore_past(past);
      throw;
    }
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
    const int ways = std::max(1, static_cast<int>(std::ceil(std::abs(depth - from) / p.longest - 1e-9)));
    std::int64_t evaluations = 0;
    for (int k = 1; k <= ways; ++k) {
      stop_if_asked();
      p.system->begin_step(dt / ways);
      evaluations += p.to_equilibrium(k == ways ? depth : from + (depth - from) * k / ways);
      p.system->accept_step(p.u);
    }
    return evaluations;
  });
}

LiveFrame Session::follow(double depth, const FrameLimit& limit, double dt) {
  Parts& p = *parts_;
  if (!std::isfinite(depth) || limit.evaluations < 0 || (limit.evaluations == 0 && !(limit.seconds > 0.0)))
    throw std::invalid_argument("Session::follow: the depth must be a number, and the limit positive");
  if (!p.relax.has_mixed())
    throw SolveError(
        {.fact = "this scheme or material cannot be followed in bounded time",
         .where = "Session::follow",
         .why = "its equilibria are found by hundreds of evaluations of the force",
         .remedy = "take the scheme 'converging' and a Poisson's ratio above 0.3, or call equilibrate()",
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
  if (p.options.touch)
    throw SolveError({.fact = "a tool that touches is not followed with inertia",
                      .where = "Session::step",
                      .why = "its contact is solved for in equilibrium",
                      .remedy = "call equilibrate() or follow()",
                      .code = "no-live"});
  return p.whole([&] {
    p.system->tissue().hold_pressures({});  // an equilibrium has left its own
    p.resting = false;
    const double stable = safety * stable_time_step(*p.system, p.model.mass, p.u).dt;
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
      p.system->begin_step(h);
      p.find_force();
      p.system->accept_step(p.u);
      p.depth = from + (depth - from) * static_cast<double>(s) / static_cast<double>(steps);
      const CentralDifferences differences{.dt = h, .kick = h, .rate = rate, .depth = p.depth};
      differences(0, p.u.cols(), p.system->held(), inverse_mass, p.f, p.v, p.u);
      p.system->set({.depth = p.depth});
    }
    p.find_force();
    p.lambda = p.model.scheme.pressure_patches ? pressures_of_volumes(*p.system) : p.lambda;
    p.path.point.clear();  // an equilibrium is looked for from here on
    p.path.push(depth, p.u, p.lambda);
    return steps;
  });
}

void Session::go_on_from(const Session& before, const Points& u, const std::vector<Index>& of_patch) {
  Parts& p = *parts_;
  const Parts& was = *before.parts_;
  if (u.cols() != p.model.node_count() || u.cols() < was.model.node_count() ||
      static_cast<Index>(of_patch.size()) != p.model.patches.count())
    throw std::invalid_argument("Session::go_on_from: the numbers of nodes or patches are others");
  if (p.system->viscoelastic())
    throw SolveError({.fact = "tissue that relaxes is not cut while a tool is moved by hand",
                      .where = "Session::go_on_from",
                      .why = "what each point remembers is not carried over",
                      .remedy = "take elastic tissue",
                      .code = "no-live"});
  p.go_on_from(was, u, of_patch);
}

double Session::depth() const {
  return parts_->depth;
}
double Session::force() const {
  const Parts& p = *parts_;
  return p.resistance(p.u, p.lambda, p.f, p.depth);
}
double Session::base_force() const {
  return -along_push(parts_->model, parts_->model.base, parts_->f);
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
const Touch* Session::touch() const {
  return parts_->options.touch.get();
}

}  // namespace dimple
