#include "solver/march/steps.hpp"

#include <algorithm>
#include <cmath>

#include "solver/march/quasi_static.hpp"

namespace dimple {
namespace {

bool moves_tool(const Step& step) {
  return step.moves.empty();
}

// What is held of a set along its motion: of one that slides its own direction, of others the way itself.
void move(HeldSet& set, const Step& step) {
  if (set.hold == HeldSet::Hold::all && !step.holds()) set.direction = step.way.normalized();
  set.share = step.holds() ? 0.0 : set.direction.dot(step.way) / step.length();
}

// All sets of the scene, of which the step moves one.
Constraints held_in(const Model& model, const Loading& loading, const Step& step) {
  std::vector<HeldSet> sets = make_constraints(model, loading.contact, loading.further).sets();
  for (HeldSet& set : sets) {
    if (set.name == step.moves)  // of a step that moves the tool: tool_set
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
  constexpr double lever = 10e-3;  // m: where it turns besides, an angle of 1 is as long a way
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

// How far the scene has come, for whoever does its steps one by one.
struct Walk {
  Loading now;  // of the next step: where it begins
  double rate;  // of steps that do not say how long they last
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

// One after the other from `walk`, which then stands where they end, and so does `begun`.
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

// All sets of the scene, none of which moves.
Constraints held_still(const Model& model, const Loading& loading) {
  std::vector<HeldSet> sets = make_constraints(model, loading.contact, loading.further).sets();
  for (HeldSet& set : sets) set.share = 0.0;
  return {model.node_count(), std::move(sets)};
}

// Where each set has come after `gone` [m] of the steps.
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

// The body that has been cut, held as the steps before have left it. Where the tissue springs so far that
// nothing is found from there, it is brought there again by those steps: elastic tissue under a tool that it
// is bonded to, or that does not rub, is where it is whatever the way there.
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
