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
void move(HeldSet& set, const Vec3& way) {
  if (set.hold == HeldSet::Hold::all) set.direction = way.normalized();
  set.share = set.direction.dot(way) / way.norm();
}

// All sets of the scene, of which the step moves one.
Constraints held_in(const Model& model, const Loading& loading, const Step& step) {
  std::vector<HeldSet> sets = make_constraints(model, loading.contact, loading.further).sets();
  for (HeldSet& set : sets) {
    if (set.name == (moves_tool(step) ? tool_set : step.moves))
      move(set, step.way);
    else
      set.share = 0.0;
  }
  return {model.node_count(), std::move(sets)};
}

std::vector<System::RigidWay> ways_of_walls(const System& system, const Loading& loading, std::size_t step,
                                            double gone) {
  std::vector<System::RigidWay> ways;
  for (const TouchingTool* wall : system.walls()) {
    const std::string& name = wall->touch().name;
    const Step& now = loading.steps[step];
    ways.push_back(
        {moved(loading.steps, name, gone), now.moves == name ? now.way.normalized() : Vec3::Zero().eval()});
  }
  return ways;
}

}  // namespace

std::vector<int> frames_of_steps(const std::vector<Step>& steps, int frames) {
  double whole = 0.0, come = 0.0;
  for (const Step& step : steps) whole += step.way.norm();
  std::vector<int> result;
  int given = 0;
  for (const Step& step : steps) {
    come += step.way.norm();
    const int until = static_cast<int>(std::lround(frames * come / whole));
    result.push_back(std::max(1, until - given));
    given += result.back();
  }
  return result;
}

Vec3 moved(const std::vector<Step>& steps, std::string_view name, double come) {
  Vec3 sum = Vec3::Zero();
  for (const Step& step : steps) {
    const double way = step.way.norm(), done = std::clamp(come, 0.0, way);
    if (step.moves == name) sum += done / way * step.way;
    come -= way;
  }
  return sum;
}

Jump largest_jump(const std::vector<ForceSample>& curve) {
  std::vector<double> slope, way;
  std::vector<std::size_t> end;
  for (std::size_t k = 1; k < curve.size(); ++k) {
    double square = std::pow(curve[k].depth - curve[k - 1].depth, 2);
    for (std::size_t i = 0; i < 3; ++i) square += std::pow(curve[k].aside[i] - curve[k - 1].aside[i], 2);
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

void march_in_steps(System& system, const Loading& loading, const SolverOptions& options,
                    const Observer& observer, History& history, const MarchState* from) {
  const Model& model = system.model();
  const std::vector<int> frames = frames_of_steps(loading.steps, options.frames);
  Rest begun = system.at_rest();
  Vec3 way_before = Vec3::Zero();
  double gone = 0.0;
  Loading now = loading;
  now.steps.clear();
  const std::size_t first = from ? static_cast<std::size_t>(from->step_of_scene) : 0;
  for (std::size_t k = 0; k < loading.steps.size(); ++k) {
    const Step& step = loading.steps[k];
    now.depth = step.way.norm();
    now.begun.sinks = moves_tool(step) ? step.way.dot(model.tool.push) / now.depth : 0.0;
    if (k == first && from && k > 0) {
      begun = from->begun;
      way_before = from->way_before;
    }
    if (k >= first) {
      system.go_on(begun, held_in(model, loading, step), way_before, gone,
                   ways_of_walls(system, loading, k, gone));
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
            copy.way_before = way_before;
            return copy;
          });
        };
      march_quasi_statically(system, now, own, watching, history, k == first ? from : nullptr, &ended);
      if (history.interrupted) return;
      begun = std::move(ended);
      if (moves_tool(step)) way_before += step.way;
    }
    gone += now.depth;
    now.begun = {now.t_at(now.depth), now.depth_at(now.depth), 1.0, now.begun.frame + frames[k],
                 now.begun.evaluations + most_evaluations(steps_of_load(model, now, options), options)};
  }
}

}  // namespace dimple
