#include "solver/march/steps.hpp"

#include <algorithm>
#include <cmath>

#include "solver/march/quasi_static.hpp"

// Steps of a scene, and cuts between them:
// 1. Each step marches quasi-statically from the last equilibrium; the sets that do not move are held where
//    they are.
// 2. After a cut the caller hands over a guess on the nodes of the cut body; held nodes stay
//    where the earlier steps left them.
// 3. Nothing moves: equilibrate_after_cut() searches the equilibrium; the energy that is released counts as
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
  if (set.hold == HeldSet::Hold::all && !step.holds()) set.direction = step.displacement.normalized();
  set.fraction = step.holds() ? 0.0 : set.direction.dot(step.displacement) / step.length();
}

// All sets of the scene; only that of the step moves.
Constraints held_in(const Model& model, const Loading& loading, const Step& step) {
  std::vector<HeldSet> sets = make_constraints(model, loading.contact, loading.further).sets();
  for (HeldSet& set : sets) {
    if (set.name == step.moves)  // empty for the tool, as tool_set
      move(set, step);
    else
      set.fraction = 0.0;
  }
  return {model.node_count(), std::move(sets)};
}

std::vector<RigidMotion> motions_of_walls(const System& system, const Loading& loading, std::size_t step,
                                          double gone) {
  std::vector<RigidMotion> motions;
  for (const RigidContact* wall : system.walls()) {
    const std::string& name = wall->body().name;
    const Step& now = loading.steps[step];
    RigidMotion& motion = motions.emplace_back();
    motion.initial_displacement = moved(loading.steps, name, gone);
    if (now.moves == name) motion.motion = now.displacement.normalized();
  }
  return motions;
}

}  // namespace

std::vector<int> frames_of_steps(const std::vector<Step>& steps, int frames) {
  double whole = 0.0, travelled = 0.0;
  for (const Step& step : steps) whole += step.length();
  std::vector<int> result;
  int given = 0;
  for (const Step& step : steps) {
    travelled += step.length();
    const int until = static_cast<int>(std::lround(frames * travelled / whole));
    result.push_back(std::max(1, until - given));
    given += result.back();
  }
  return result;
}

Vec3 moved(const std::vector<Step>& steps, std::string_view name, double travelled) {
  Vec3 sum = Vec3::Zero();
  for (const Step& step : steps) {
    const double length = step.length(), done = std::clamp(travelled, 0.0, length);
    if (step.moves == name) sum += done / length * step.displacement;
    travelled -= length;
  }
  return sum;
}

Vec3 moved_at(double time_s, const std::vector<Step>& steps, double rate, std::string_view name) {
  double travelled = 0.0;
  for (const Step& step : steps) {
    const double whole = step.seconds(rate);
    travelled += std::clamp(time_s, 0.0, whole) * step.rate(rate);
    time_s -= whole;
  }
  return moved(steps, name, travelled);
}

RigidMotion motion_in(const Step& step, const RigidMotion& before, const Vec3& tip) {
  RigidMotion motion = before;
  if (!moves_tool(step)) return motion;
  motion.motion = step.displacement / step.length();
  motion.turn = step.turn / step.length();
  if (step.turns() && step.about) motion.arm = *step.about - tip - before.initial_displacement;
  return motion;
}

RigidMotion after(const Step& step, const RigidMotion& before, const Vec3& tip) {
  if (!moves_tool(step)) return before;
  if (!step.turns()) return {before.initial_displacement + step.displacement, before.turned};
  const RigidMotion motion = motion_in(step, before, tip);
  return {motion.displacement_at(step.length()), motion.turned_at(step.length())};
}

Jump largest_jump(const std::vector<ForceSample>& curve) {
  constexpr double lever = 10e-3;  // m: path length of a rotation by 1 rad
  std::vector<double> slope, distance;
  std::vector<std::size_t> end;
  for (std::size_t k = 1; k < curve.size(); ++k) {
    double square = std::pow(curve[k].depth - curve[k - 1].depth, 2);
    for (std::size_t i = 0; i < 3; ++i) {
      square += std::pow(curve[k].aside[i] - curve[k - 1].aside[i], 2);
      square += std::pow(lever * (curve[k].turned[i] - curve[k - 1].turned[i]), 2);
    }
    if (!(square > 0.0)) continue;
    distance.push_back(std::sqrt(square));
    slope.push_back((curve[k].force - curve[k - 1].force) / distance.back());
    end.push_back(k);
  }
  Jump result;
  for (std::size_t k = 1; k + 1 < slope.size(); ++k)
    if (const double off =
            distance[k] * std::min(std::abs(slope[k] - slope[k - 1]), std::abs(slope[k] - slope[k + 1]));
        off > result.force)
      result = {off, end[k]};
  return result;
}

namespace {

// Progress of a scene whose steps are marched one by one.
struct StepSequence {
  Loading now;  // the next step
  double rate;  // of steps without a duration
  RigidMotion of_tool;
  double gone = 0.0;

  explicit StepSequence(const Loading& loading) : now(loading), rate(loading.rate) { now.steps.clear(); }
  Vec3 tip() const { return now.indenter ? now.indenter->pose.tip : Vec3::Zero().eval(); }
  void turn_to(const Step& step, const Model& model) {
    now.depth = step.length();
    now.rate = step.rate(rate);
    now.start.depth_per_travel =
        moves_tool(step) ? step.displacement.dot(model.tool.approach) / now.depth : 0.0;
    now.start.holds = step.holds();
    now.start.of_tool = motion_in(step, of_tool, tip());
    now.start.approach = model.tool.approach;
  }
  void pass(const Step& step, int frames, const Model& model, const SolverOptions& options) {
    of_tool = after(step, of_tool, tip());
    gone += now.depth;
    now.start = {
        .t = now.t_at(now.depth),
        .depth = now.depth_at(now.depth),
        .frame = now.start.frame + frames,
        .evaluations = now.start.evaluations + most_evaluations(steps_of_load(model, now, options), options)};
  }
};

// Marches the steps [first, end) from `sequence`; `sequence` and `equilibrium` then describe their end.
void do_steps(System& system, const Loading& loading, std::size_t first, std::size_t end,
              const SolverOptions& options, const Observer& observer, History& history,
              const MarchState* from, StepSequence& sequence, EquilibriumState& equilibrium) {
  const std::vector<int> frames = frames_of_steps(loading.steps, options.frames);
  for (std::size_t k = first; k < end; ++k) {
    const Step& step = loading.steps[k];
    sequence.turn_to(step, system.model());
    system.begin_scene_step(equilibrium, held_in(system.model(), loading, step), sequence.now.start.of_tool,
                            sequence.gone, motions_of_walls(system, loading, k, sequence.gone));
    SolverOptions own = options;
    own.frames = frames[k];
    Observer watching = observer;
    EquilibriumState ended;
    if (observer.between_steps)
      watching.between_steps = [&](const std::function<MarchState()>& state) {
        observer.between_steps([&] {
          MarchState copy = state();
          copy.step_of_scene = static_cast<int>(k);
          copy.step_start = equilibrium;
          return copy;
        });
      };
    march_quasi_statically(system, sequence.now, own, watching, history, k == first ? from : nullptr, &ended);
    if (history.interrupted) return;
    equilibrium = std::move(ended);
    sequence.pass(step, frames[k], system.model(), options);
  }
}

// All sets of the scene, held still.
Constraints held_still(const Model& model, const Loading& loading) {
  std::vector<HeldSet> sets = make_constraints(model, loading.contact, loading.further).sets();
  for (HeldSet& set : sets) set.fraction = 0.0;
  return {model.node_count(), std::move(sets)};
}

// Displacements of all sets after `gone` [m] of the steps.
Nodal places_of_sets(const Model& model, const Loading& loading, const Constraints& held, double gone) {
  Nodal places = Nodal::Zero(4, model.node_count());
  for (const HeldSet& set : held.sets()) {
    const Vec3 displacement = moved(loading.steps, set.name, gone);
    for (const Index a : set.node) places.col(a) = padded(displacement);
  }
  return places;
}

void hold_sets_still(System& system, const Loading& loading, const StepSequence& sequence,
                     const EquilibriumState& state) {
  std::vector<RigidMotion> walls;
  for (const RigidContact* wall : system.walls())
    walls.emplace_back().initial_displacement = moved(loading.steps, wall->body().name, sequence.gone);
  system.begin_scene_step(state, held_still(system.model(), loading), sequence.of_tool, sequence.gone, walls);
}

// Equilibrium of the cut body, held as the earlier steps left it. If none is found nearby, these steps are
// repeated on the cut body: elastic tissue under a bonded or frictionless tool does not depend on the path.
EquilibriumState reach_equilibrium(System& system, const Loading& loading, const SolverOptions& options,
                                   const Observer& observer, History& history, StepSequence sequence,
                                   ScenePart& part) {
  const EquilibriumState undeformed = system.step_start();
  EquilibriumState near = std::move(*part.near), ended;
  const Index given = near.lambda.size();
  near.lambda.conservativeResize(undeformed.lambda.size());
  near.lambda.tail(undeformed.lambda.size() - given).setZero();
  const Constraints held = held_still(system.model(), loading);
  held.apply_dirichlet(near.u, places_of_sets(system.model(), loading, held, sequence.gone));
  system.set_least_reactions(part.least_reactions);
  hold_sets_still(system, loading, sequence, near);
  sequence.now.depth = 0.0;
  SolverOptions own = options;
  own.frames = 1;
  const double t = sequence.now.start.t + part.later;
  const History before = history;
  try {
    part.cut = equilibrate_after_cut(system, sequence.now, t, own, observer, history, ended);
    return ended;
  } catch (const SolveError&) {
    if (part.path_matters) throw;
    history = before;
  }
  part.done_again = true;
  History aside;
  StepSequence again(loading);
  EquilibriumState undone = undeformed;
  do_steps(system, loading, 0, part.first, options, {}, aside, nullptr, again, undone);
  history.extra_evaluations += aside.evaluations + aside.extra_evaluations;
  history.interrupted = aside.interrupted;
  if (history.interrupted) return undone;
  hold_sets_still(system, loading, sequence, undone);
  part.cut = equilibrate_after_cut(system, sequence.now, t, own, observer, history, ended);
  return ended;
}

}  // namespace

void march_in_steps(System& system, const Loading& loading, const SolverOptions& options,
                    const Observer& observer, History& history, const MarchState* from, ScenePart* part) {
  const Model& model = system.model();
  const std::vector<int> frames = frames_of_steps(loading.steps, options.frames);
  const std::size_t end = part ? std::min(part->end, loading.steps.size()) : loading.steps.size();
  const std::size_t first = from ? static_cast<std::size_t>(from->step_of_scene) : part ? part->first : 0;
  StepSequence sequence(loading);
  for (std::size_t k = 0; k < first; ++k) {
    sequence.turn_to(loading.steps[k], model);
    sequence.pass(loading.steps[k], frames[k], model, options);
  }
  EquilibriumState equilibrium = system.step_start();
  if (from && first > 0) equilibrium = from->step_start;
  if (part) sequence.now.start.frame += part->cuts;
  if (part && part->near) {
    equilibrium = reach_equilibrium(system, loading, options, observer, history, sequence, *part);
    if (history.interrupted) return;
    if (part->has_joined) part->has_joined();
  }
  do_steps(system, loading, first, end, options, observer, history, from, sequence, equilibrium);
  if (!part || history.interrupted) return;
  part->least_reactions = system.least_reactions();
  part->ended = std::move(equilibrium);
}

}  // namespace dimple
