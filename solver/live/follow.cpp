#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "solver/live/session_parts.hpp"
#include "solver/march/quasi_static.hpp"

// Advance of the tool within one frame, follow():
// 1. First contact: if no state in contact is known, search at increasing depths, with up to 240 further
//    evaluations.
// 2. Next depth: at most `caution` times the longest move beyond the deepest known state.
// 3. First guess: polynomial through known states, or what the last frame came to.
// 4. Search within the limit of the frame; on the path to the requested depth with a larger tolerance.
// 5. A good state is shown and kept, and 2 follows; otherwise the move is halved, the search is left to the
//    next frame, or a known state is shown.
// 6. Force: that of the state, plus the dual correction for unbalanced forces; its error estimate
//    (live_frame.cpp).
//
// Source:   Becker and Rannacher 2001 (step 6; see Session::follow()). The rest is our own.

namespace dimple {

// Predicts the equilibrium at a depth.
void Session::Parts::guess(double to, Nodal& next, Eigen::VectorXd& l) const {
  if (known.state.size() < 2) {
    next = system->step_start().u;
    l = system->step_start().lambda;
    if (!options.indenter) first_guess(model, model.tool.approach, to, next);
  } else if (system->viscoelastic() || (depth > known.deepest() && to > depth)) {
    // Viscoelastic tissue has no curve of states; beyond the deepest state, extrapolation from the present
    // one is safer.
    const KnownStates::Slope slope = known.slope(depth);
    next = u + (to - depth) * slope.u;
    l = lambda + (to - depth) * slope.lambda;
    system->project_to_admissible(l);
  } else {
    known.guess(to, next, l);
    system->project_to_admissible(l);
  }
  system->set({.depth = to}, next);
}

// Next depth to search at: as close to known states as can be trusted.
double Session::Parts::towards(double requested) const {
  if (known.state.size() < 2) return known.apart;
  const double distance = caution * longest;
  if (system->viscoelastic()) return std::clamp(requested, depth - distance, depth + distance);
  return std::min(requested, std::max(known.deepest(), depth) + distance);
}

// Elastic tissue under a bonded tool resists: a state that does not is on another branch.
bool Session::Parts::resists(const Attempt& now, const Nodal& force,
                             const MixedIteration::Residual& its) const {
  const double at = now.at;
  if (system->viscoelastic() || at <= 0.0 || moves_supports) return true;
  const double raw = resistance(now.u, now.lambda, force, at);
  return raw > 0.0 && (known.state.size() < 2 || raw + correction_at(at, its) > 0.0);
}

bool Session::Parts::good(const Relaxed& found, const Nodal& its, double at) const {
  const double reach = system->viscoelastic() ? std::max({at, depth, known.deepest()}) : at;
  return std::isfinite(found.residual) && found.residual < live_constants.shown && found.sweep.ok() &&
         static_cast<double>(found.sweep.inverted) <=
             live_constants.folded * static_cast<double>(model.point_count()) &&
         (its - system->step_start().u).colwise().norm().maxCoeff() <
             live_constants.widest * max_displacement_ratio(options.further) * reach;
}

// True if the contact of a contacting tool is good enough to show, by the criteria of the guards; call
// resistance() before.
bool Session::Parts::contact_is_good(const Attempt& now, const MixedIteration::Residual& its) const {
  if (!options.indenter) return true;
  if (its.contact > live_constants.open_contact) return false;
  const RigidContact::Audit audit = system->tool_contact()->audit(now.u, system->now());
  return audit.penetration <= live_constants.deepest_in_tool * tool.radius &&
         audit.beyond <= live_constants.beyond_samples * tool.radius;
}

bool Session::Parts::is_good(const Attempt& now, const Relaxed& found, const Nodal& force,
                             const MixedIteration::Residual& its) const {
  return good(found, now.u, now.at) && resists(now, force, its) && contact_is_good(now, its);
}

// One call of follow(): searches for equilibria along the path to the requested depth.
struct Session::Parts::Call {
  // Purpose of the next search. One function per transition:
  //
  //     ahead -> ahead     take(), before the end of the path; shorten()
  //     ahead -> back      restore()
  //     ahead -> done      take(); refine_later(); shorten(), when the time is up
  //     ahead -> stopped   shorten()
  //     back -> done       take(), or nothing is found
  enum class Search {
    ahead,   // the next equilibrium on the path
    back,    // the nearest known state, as none between was found
    done,    // none: the frame shows the present state
    stopped  // none: no equilibrium is found any deeper
  };

  Call(double requested_, double most, const FrameLimit& limit, double tolerance, Clock::duration overhead)
      : requested(requested_),
        to(std::clamp(requested_, 0.0, most)),
        timed(limit.evaluations == 0),
        begin(timed ? Clock::now() : Clock::time_point()),
        how{.tolerance = tolerance, .evaluations = timed ? 100000 : limit.evaluations},
        all(how.evaluations) {
    if (timed)
      how.until = begin +
                  std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(limit.seconds)) -
                  overhead - overhead / 2;
  }
  Search next = Search::ahead;
  double requested, to;  // requested depth, and that depth in the body
  bool timed;
  Clock::time_point begin;
  RelaxOptions how;  // for the rest of the call
  std::int64_t all;
  Clock::duration iterating{};
  bool time_is_up = false, moved = false;
  Attempt now;  // current attempt
  Nodal force;
  MixedIteration::Residual left;
  bool searches() const { return next == Search::ahead || next == Search::back; }
  bool arrives() const { return now.at == to; }
};

LiveFrame Session::Parts::follow(double requested, const FrameLimit& limit, double dt) {
  Call call(requested, longest_tool, limit, options.tolerance, overhead);
  const double from = depth;
  const bool was_cut = state == State::cut;
  call.force.resize(4, u.cols());
  system->begin_step(waited += dt);
  v.setZero();
  const std::int64_t at_first = lacks_first_contact(call) ? find_first_contact() : 0;
  if (call.to > 0.0 || (system->viscoelastic() && requested == 0.0 && state != State::air))
    while (call.searches()) advance(call);
  else
    lift();
  if (call.moved) {
    if (system->viscoelastic()) system->accept_step(u);
    waited = 0.0;
  }
  path.point.clear();
  path.push(depth, u, lambda);
  LiveFrame frame = frame_at_depth(requested, at_first + call.all - call.how.evaluations);
  const bool is_cut = state == State::cut, arrived = depth == call.to && !is_cut;
  if (arrived || depth != from || is_cut != was_cut)
    progress.advance();
  else
    progress.stall(frame.evaluations);
  if (!arrived && call.next == Call::Search::stopped) progress.stop();
  report_arrival(frame, call, arrived);
  if (call.timed) overhead += (Clock::now() - call.begin - call.iterating - overhead) / 5;
  return frame;
}

// Sets its status, and its error for the requested pose.
void Session::Parts::report_arrival(LiveFrame& frame, const Call& call, bool arrived) const {
  using Tool = LiveFrame::Tool;
  const bool has_stopped = progress.state == Progress::State::stopped;
  frame.tool = arrived ? Tool::there : has_stopped ? Tool::stopped : Tool::lags;
  if (call.to > thick || call.requested > longest_tool) frame.tool = Tool::beyond;
  const bool unknown = frame.tool == Tool::stopped || frame.tool == Tool::beyond;
  frame.error = unknown ? std::numeric_limits<double>::infinity()
                        : frame.error_at_depth + force_apart(frame, call.to - depth);
}

bool Session::Parts::lacks_first_contact(const Call& call) const {
  const bool has_begun = state == State::cut && pending;
  return options.indenter && call.to > 0.0 && known.state.size() < 2 && !has_begun;
}

// First contact has no first guess, and few evaluations do not find it: once, more are used. A contact too
// small for the nodes may not be found; then a deeper one is tried.
std::int64_t Session::Parts::find_first_contact() {
  std::int64_t evaluations = 0;
  const double deepest = live_constants.deepest_first * tool.radius;
  const RelaxOptions how{.tolerance = options.tolerance, .evaluations = live_constants.for_first};
  for (double at = known.apart; at <= deepest && known.state.size() < 2; at *= 2.0) {
    Attempt now{.at = at, .residual = 0.0, .u = u, .lambda = lambda};
    Nodal force(4, u.cols());
    MixedIteration::Residual its;
    guess(at, now.u, now.lambda);
    const Relaxed found = relax.mixed().within(now.u, now.lambda, force, how, true, its);
    evaluations += found.evaluations;
    if (!is_good(now, found, force, its)) continue;
    known.add({at, now.u, now.lambda, found.residual, resistance(now.u, now.lambda, force, at)});
  }
  gradient_at = -1.0;
  return evaluations;
}

// Searches from the current attempt. True: the result is good enough to be shown.
bool Session::Parts::search(Call& call, bool reassemble, Relaxed& found) {
  system->set({.depth = call.now.at});
  found = relax.mixed().within(call.now.u, call.now.lambda, call.force, call.how, reassemble, call.left);
  call.how.evaluations -= found.evaluations;
  call.time_is_up = call.how.evaluations < 1 || call.left.late;
  return is_good(call.now, found, call.force, call.left);
}

// One search for an equilibrium.
void Session::Parts::advance(Call& call) {
  const Clock::time_point lap = call.timed ? Clock::now() : Clock::time_point();
  look_for_place(call);
  const Attempt& now = call.now;
  call.how.tolerance =
      call.arrives() ? options.tolerance : std::max(options.tolerance, live_constants.passed);
  const bool reassemble =
      gradient_at < 0.0 || std::abs(now.at - gradient_at) > live_constants.gradient_good * tool.radius;
  if (reassemble) gradient_at = now.at;
  Relaxed found;
  bool is_well = search(call, reassemble, found);
  // On the path the tolerance is large: a state that is not good there may be at the final one.
  if (!is_well && !call.time_is_up && call.how.tolerance > options.tolerance &&
      found.residual < call.how.tolerance) {
    call.how.tolerance = options.tolerance;
    is_well = search(call, false, found);
  }
  if (call.timed) call.iterating += Clock::now() - lap;
  if (is_well)
    take(call, found.residual);
  else
    miss(call, found.residual);
}

// Chooses the depth and the first guess of the next search.
void Session::Parts::look_for_place(Call& call) {
  Attempt& now = call.now;
  if (call.next == Call::Search::back) {
    const KnownStates::State& near = known.nearest(call.to);
    now = {.at = near.at, .residual = 0.0, .u = near.u, .lambda = near.lambda};
  } else if (pending && (pending->at <= call.to || known.state.size() < 2)) {
    now = std::move(*pending);
  } else if (now.at = towards(call.to), now.residual = 0.0; now.at == depth && depth > 0.0) {
    now.u = u;
    now.lambda = lambda;
  } else {
    guess(now.at, now.u, now.lambda);
  }
  pending.reset();
}

// Shows the state that was found.
void Session::Parts::take(Call& call, double its_residual) {
  u.swap(call.now.u), lambda.swap(call.now.lambda), f.swap(call.force);
  std::swap(left, call.left);
  depth = call.now.at;
  begin_contact(its_residual);
  call.moved = true;
  caution = std::min(1.0, 1.3 * caution);
  const LiveFrame here = frame_at_depth(call.requested, 0);
  known.add({depth, u, lambda, system->viscoelastic() ? 0.0 : residual, here.force, here.per_force});
  const bool continues = call.next == Call::Search::ahead && !call.arrives() && !call.time_is_up;
  call.next = continues ? Call::Search::ahead : Call::Search::done;
}

// Chooses the next search, after one without a state to show.
void Session::Parts::miss(Call& call, double its_residual) {
  const Attempt& now = call.now;
  const bool nears = std::isfinite(its_residual) &&
                     (now.residual == 0.0 || its_residual < live_constants.nears * now.residual);
  if (call.next == Call::Search::back)
    call.next = Call::Search::done;
  else if (now.at < depth && !system->viscoelastic())
    restore(call);
  else if (call.time_is_up && nears)
    refine_later(call, its_residual);
  else
    shorten(call);
}

// Retraction must succeed: by the nearest known state, if nothing between is found.
void Session::Parts::restore(Call& call) {
  gradient_at = -1.0;
  call.how.evaluations = std::max<std::int64_t>(call.how.evaluations, 1);
  call.next = Call::Search::back;
}

// Leaves the attempt to the next frame.
void Session::Parts::refine_later(Call& call, double its_residual) {
  call.now.residual = its_residual;
  pending = std::move(call.now);
  call.next = Call::Search::done;
}

// Halves the next move, unless it is too short already.
void Session::Parts::shorten(Call& call) {
  using Search = Call::Search;
  caution *= 0.5;
  gradient_at = -1.0;
  if (caution >= live_constants.slowest) {
    call.next = call.time_is_up ? Search::done : Search::ahead;
  } else {
    caution = 2.0 * live_constants.slowest;
    call.next = Search::stopped;
  }
}

}  // namespace dimple
