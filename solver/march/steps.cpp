#include "solver/march/steps.hpp"

#include <algorithm>
#include <cmath>

#include "solver/march/quasi_static.hpp"

// Steps of a scene, and cuts between them:
// 1. Each step marches quasi-statically from the last equilibrium; the sets that do not move are held where
//    they are.
// 2. After a cut the caller hands over a guess on the nodes of the cut body; held nodes stay
//    where the earlier steps left them.
// 3. Nothing moves: settle_after_cut() searches the equilibrium; the energy that is released counts as
//    dissipated.
// 4. If none is found, all earlier steps are repeated on the cut body, unless `path_matters`; then 3 again.
// 5. The remaining steps continue on the cut body.
//
// Source:   none. A cut changes the model only (cut_by_sheet()); this file finds the equilibrium after it.

namespace dimple {
namespace {

bool moves_tool(const Step& step) {
  return step.moves.empty();
}

// Prescribes the motion of a set in this step: a sliding set keeps its direction, others take that of the
// step.
void move(HeldSet& set, const Step& step) {
  if (set.hold == HeldSet::Hold::all && !step.holds()) set.direction = step.way.normalized();
  set.share = step.holds() ? 0.0 : set.direction.dot(step.way) / step.length();
}

// All sets of the scene; only that of the step moves.
Constraints held_in(const Model& model, const Loading& loading, const Step& step) {
  std::vector<HeldSet> sets = make_constraints(model, loading.contact, loading.further).sets();
  for (HeldSet& set : sets) {
    if (set.name == step.moves)  // empty for the tool, as tool_set
      move(set, step);
    else
      set.share = 0.0;
  }
  return {model.node_count(), std::move(sets)};
}

std::vector<RigidWay> ways_of_walls(const System& system, const Loading& loading, std::size_t step,
                                    double gone) {
  std::vector<RigidWay> ways;
  for (const TouchingTool* wall : system.walls()) {
    const std::string& name = wall->touch().name;
    const Step& now = loading.steps[step];
    RigidWay& way = ways.emplace_back();
    way.come = moved(loading.steps, name, gone);
    if (now.moves == name) way.motion = now.way.normalized();
  }
  return ways;
}

}  // namespace

std::vector<int> frames_of_steps(const std::vector<Step>& steps, int frames) {
  double whole = 0.0, come = 0.0;
  for (const Step& step : steps) whole += step.length();
  std::vector<int> result;
  int given = 0;
  for (const Step& step : steps) {
    come += step.length();
    const int until = static_cast<int>(std::lround(frames * come / whole));
    result.push_back(std::max(1, until - given));
    given += result.back();
  }
  return result;
}

Vec3 moved(const std::vector<Step>& steps, std::string_view name, double come) {
  Vec3 sum = Vec3::Zero();
  for (const Step& step : steps) {
    const double way = step.length(), done = std::clamp(come, 0.0, way);
    if (step.moves == name) sum += done / way * step.way;
    come -= way;
  }
  return sum;
}

Vec3 moved_at(double time_s, const std::vector<Step>& steps, double rate, std::string_view name) {
  double come = 0.0;
  for (const Step& step : steps) {
    const double whole = step.seconds(rate);
    come += std::clamp(time_s, 0.0, whole) * step.rate(rate);
    time_s -= whole;
  }
  return moved(steps, name, come);
}

RigidWay way_in(const Step& step, const RigidWay& before, const Vec3& tip) {
  RigidWay way = before;
  if (!moves_tool(step)) return way;
  way.motion = step.way / step.length();
  way.turn = step.turn / step.length();
  if (step.turns() && step.about) way.arm = *step.about - tip - before.come;
  return way;
}

RigidWay after(const Step& step, const RigidWay& before, const Vec3& tip) {
  if (!moves_tool(step)) return before;
  if (!step.turns()) return {before.come + step.way, before.turned};
  const RigidWay way = way_in(step, before, tip);
  return {way.come_at(step.length()), way.turned_at(step.length())};
}

Jump largest_jump(const std::vector<ForceSample>& curve) {
  constexpr double lever = 10e-3;  // m: path length of a rotation by 1 rad
  std::vector<double> slope, way;
  std::vector<std::size_t> end;
  for (std::size_t k = 1; k < curve.size(); ++k) {
    double square = std::pow(curve[k].depth - curve[k - 1].depth, 2);
    for (std::size_t i = 0; i < 3; ++i) {
      square += std::pow(curve[k].aside[i] - curve[k - 1].aside[i], 2);
      square += std::pow(lever * (curve[k].turned[i] - curve[k - 1].turned[i]), 2);
    }
    if (!(square > 0.0)) continue;
    way.push_back(std::sqrt(square));
    slope.push_back((curve[k].force - curve[k - 1].force) / way.back());
    end.push_back(k);
  }
  Jump result;
  for (std::size_t k = 1; k + 1 < slope.size(); ++k)
    if (const double off =
            way[k] * std::min(std::abs(slope[k] - slope[k - 1]), std::abs(slope[k] - slope[k + 1]));
        off > result.force)
      result = {off, end[k]};
  return result;
}

namespace {

// Progress of a scene whose steps are marched one by one.
struct Walk {
  Loading now;  // the next step
  double rate;  // of steps without a duration
  RigidWay of_tool;
  double gone = 0.0;

  explicit Walk(const Loading& loading) : now(loading), rate(loading.rate) { now.steps.clear(); }
  Vec3 tip() const { return now.touch ? now.touch->pose.tip : Vec3::Zero().eval(); }
  void turn_to(const Step& step, const Model& model) {
    now.depth = step.length();
    now.rate = step.rate(rate);
    now.begun.sinks = moves_tool(step) ? step.way.dot(model.tool.push) / now.depth : 0.0;
    now.begun.holds = step.holds();
    now.begun.of_tool = way_in(step, of_tool, tip());
    now.begun.push = model.tool.push;
  }
  void pass(const Step& step, int frames, const Model& model, const SolverOptions& options) {
    of_tool = after(step, of_tool, tip());
    gone += now.depth;
    now.begun = {
        .t = now.t_at(now.depth),
        .depth = now.depth_at(now.depth),
        .frame = now.begun.frame + frames,
        .evaluations = now.begun.evaluations + most_evaluations(steps_of_load(model, now, options), options)};
  }
};

// Marches the steps [first, end) from `walk`; `walk` and `begun` then describe their end.
void do_steps(System& system, const Loading& loading, std::size_t first, std::size_t end,
              const SolverOptions& options, const Observer& observer, History& history,
              const MarchState* from, Walk& walk, Rest& begun) {
  const std::vector<int> frames = frames_of_steps(loading.steps, options.frames);
  for (std::size_t k = first; k < end; ++k) {
    const Step& step = loading.steps[k];
    walk.turn_to(step, system.model());
    system.go_on(begun, held_in(system.model(), loading, step), walk.now.begun.of_tool, walk.gone,
                 ways_of_walls(system, loading, k, walk.gone));
    SolverOptions own = options;
    own.frames = frames[k];
    Observer watching = observer;
    Rest ended;
    if (observer.between_steps)
      watching.between_steps = [&](const std::function<MarchState()>& state) {
        observer.between_steps([&] {
          MarchState copy = state();
          copy.step_of_scene = static_cast<int>(k);
          copy.begun = begun;
          return copy;
        });
      };
    march_quasi_statically(system, walk.now, own, watching, history, k == first ? from : nullptr, &ended);
    if (history.interrupted) return;
    begun = std::move(ended);
    walk.pass(step, frames[k], system.model(), options);
  }
}

// All sets of the scene, held still.
Constraints held_still(const Model& model, const Loading& loading) {
  std::vector<HeldSet> sets = make_constraints(model, loading.contact, loading.further).sets();
  for (HeldSet& set : sets) set.share = 0.0;
  return {model.node_count(), std::move(sets)};
}

// Displacements of all sets after `gone` [m] of the steps.
Nodal places_of_sets(const Model& model, const Loading& loading, const Constraints& held, double gone) {
  Nodal places = Nodal::Zero(4, model.node_count());
  for (const HeldSet& set : held.sets()) {
    const Vec3 way = moved(loading.steps, set.name, gone);
    for (const Index a : set.node) places.col(a) = padded(way);
  }
  return places;
}

void stand(System& system, const Loading& loading, const Walk& walk, const Rest& rest) {
  std::vector<RigidWay> walls;
  for (const TouchingTool* wall : system.walls())
    walls.emplace_back().come = moved(loading.steps, wall->touch().name, walk.gone);
  system.go_on(rest, held_still(system.model(), loading), walk.of_tool, walk.gone, walls);
}

// Equilibrium of the cut body, held as the earlier steps left it. If none is found nearby, these steps are
// repeated on the cut body: elastic tissue under a bonded or frictionless tool does not depend on the path.
Rest settle(System& system, const Loading& loading, const SolverOptions& options, const Observer& observer,
            History& history, Walk walk, ScenePart& part) {
  const Rest at_rest = system.step_start();
  Rest near = std::move(*part.near), ended;
  const Index given = near.lambda.size();
  near.lambda.conservativeResize(at_rest.lambda.size());
  near.lambda.tail(at_rest.lambda.size() - given).setZero();
  const Constraints held = held_still(system.model(), loading);
  held.take_held(near.u, places_of_sets(system.model(), loading, held, walk.gone));
  system.set_least_reactions(part.least_reactions);
  stand(system, loading, walk, near);
  walk.now.depth = 0.0;
  SolverOptions own = options;
  own.frames = 1;
  const double t = walk.now.begun.t + part.later;
  const History before = history;
  try {
    part.cut = settle_after_cut(system, walk.now, t, own, observer, history, ended);
    return ended;
  } catch (const SolveError&) {
    if (part.path_matters) throw;
    history = before;
  }
  part.done_again = true;
  History aside;
  Walk again(loading);
  Rest rest = at_rest;
  do_steps(system, loading, 0, part.first, options, {}, aside, nullptr, again, rest);
  history.extra_evaluations += aside.evaluations + aside.extra_evaluations;
  history.interrupted = aside.interrupted;
  if (history.interrupted) return rest;
  stand(system, loading, walk, rest);
  part.cut = settle_after_cut(system, walk.now, t, own, observer, history, ended);
  return ended;
}

}  // namespace

void march_in_steps(System& system, const Loading& loading, const SolverOptions& options,
                    const Observer& observer, History& history, const MarchState* from, ScenePart* part) {
  const Model& model = system.model();
  const std::vector<int> frames = frames_of_steps(loading.steps, options.frames);
  const std::size_t end = part ? std::min(part->end, loading.steps.size()) : loading.steps.size();
  const std::size_t first = from ? static_cast<std::size_t>(from->step_of_scene) : part ? part->first : 0;
  Walk walk(loading);
  for (std::size_t k = 0; k < first; ++k) {
    walk.turn_to(loading.steps[k], model);
    walk.pass(loading.steps[k], frames[k], model, options);
  }
  Rest begun = system.step_start();
  if (from && first > 0) begun = from->begun;
  if (part) walk.now.begun.frame += part->cuts;
  if (part && part->near) {
    begun = settle(system, loading, options, observer, history, walk, *part);
    if (history.interrupted) return;
    if (part->has_settled) part->has_settled();
  }
  do_steps(system, loading, first, end, options, observer, history, from, walk, begun);
  if (!part || history.interrupted) return;
  part->least_reactions = system.least_reactions();
  part->ended = std::move(begun);
}

}  // namespace dimple
