#include "apps/run/steps.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "apps/run/tool.hpp"
#include "apps/run/words.hpp"
#include "io/error.hpp"
#include "solver/constraints.hpp"
#include "solver/march/steps.hpp"

namespace dimple {
namespace {

// Angle between checked poses of a turning tool. Its axis is checked up to a radius above its first contact,
// but at most this many times that height where it is nearly flat.
constexpr double looked_at_deg = 5.0, most_of_axis = 4.0;
constexpr double furthest = 20.0;  // largest step, of the body's size

bool is_of_tool(const Scene::Step& step) {
  return step.moves == tool_word;
}

Vec3 three(const std::vector<double>& numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}

}  // namespace

Vec3 displacement_of(const std::vector<double>& move, const Vec3& approach) {
  return move.size() == 1 ? Vec3(move[0] * approach) : Vec3(move[0], move[1], move[2]);
}

std::vector<Step> steps_of(const Scene& scene, const ToolPlace& tool,
                           const std::map<std::string, Vec3>& approach_of_others) {
  const bool relaxing = relaxes(materials_of(scene));
  std::vector<Step> steps;
  RigidMotion of_tool;
  for (const Scene::Step& step : moving_steps(scene)) {
    const auto other = approach_of_others.find(step.moves);
    Step& made = steps.emplace_back();
    made.name = step.name;
    made.moves = is_of_tool(step) ? "" : step.moves;
    made.duration = step.time_s;
    if (!step.move_mm.empty())
      made.displacement =
          1e-3 *
          displacement_of(step.move_mm, other == approach_of_others.end() ? tool.approach : other->second);
    if (!step.turn_deg.empty()) {
      made.turn = std::numbers::pi / 180.0 * three(step.turn_deg);
      made.lever = std::max(scene.tool->radius, 1e-3 * scene.depth_mm);
    }
    if (made.holds()) made.lever = (relaxing ? 1.0 : 0.1) * tool.radius;  // of ten equilibria, or one
    if (!step.about_mm.empty()) {
      made.about = 1e-3 * three(step.about_mm);
      made.lever = std::max(made.lever, (*made.about - tool.centre - of_tool.initial_displacement).norm());
    }
    of_tool = after(made, of_tool, tool.centre);
  }
  return steps;
}

void require_near(const std::vector<Step>& steps, const Points& body) {
  const double size = (body.rowwise().maxCoeff() - body.rowwise().minCoeff()).norm();
  for (const Step& step : steps)
    if (!step.holds() && step.length() > furthest * size)
      throw UsageError(
          {.fact =
               fmt::format("the step '{}' moves by {}, more than {:g} times the body's size of {}", step.name,
                           length_in_words(1e3 * step.length()), furthest, length_in_words(1e3 * size)),
           .where = fmt::format("step.{}.{}", step.name, step.turns() ? "about_mm" : "move_mm"),
           .why = step.turns() ? "a rotation about a distant centre is a long path"
                               : "nothing of the body is there",
           .remedy = "give lengths and places in mm, LPS, near the body"});
}

std::vector<Vec3> path_of_tool(const Scene& scene, const Vec3& approach) {
  std::vector<Vec3> path;
  Vec3 come = Vec3::Zero();
  for (const Step& step : steps_of(scene, {.approach = approach}))
    if (step.moves.empty()) path.push_back(come += step.displacement);
  return path;
}

namespace {

// Calls `look` for the poses of a turning tool: at the end of each step, and at small angles within a turn.
// The last argument: it has turned, then or before.
template <class Look>
void look_along(const Scene& scene, const ToolPlace& tool, const Look& look) {
  RigidMotion before;
  for (const Step& step : steps_of(scene, tool)) {
    if (!step.moves.empty()) continue;
    const RigidMotion motion = motion_in(step, before, tool.centre);
    const double angle = 180.0 / std::numbers::pi * step.turn.norm();
    const int looks = std::max(1, static_cast<int>(std::ceil(angle / looked_at_deg - 1e-9)));
    for (int k = 1; k < looks; ++k) {
      const double s = step.length() * k / looks;
      look(motion.displacement_at(s), motion.turned_at(s), motion.has_turned());
    }
    before = after(step, before, tool.centre);
    look(before.initial_displacement, before.turned, motion.has_turned());
  }
}

// Length of the tool's axis from the tip to the height of its first contact, or `above` that [m].
double axis_below(const Vec3& come, const Mat3& turned, const Vec3& approach, double above) {
  const double high = std::max(0.0, come.dot(approach) + above), upright = approach.dot(turned * approach);
  return high / std::max(upright, 1.0 / most_of_axis);
}

}  // namespace

std::vector<Vec3> swept(const Scene& scene, const ToolPlace& tool) {
  const ToolShape& shape = scene.tool.value();
  std::vector<Vec3> path;
  look_along(scene, tool, [&](const Vec3& come, const Mat3& turned, bool has_turned) {
    path.push_back(come);
    if (!has_turned) return;
    const double up = std::min(axis_below(come, turned, tool.approach, shape.radius), shape.length);
    path.push_back(come - up * (turned * tool.approach));
  });
  return path;
}

double deepest(const Scene& scene, const ToolPlace& tool) {
  if (scene.steps.empty()) return 1e-3 * scene.depth_mm;
  double most = 0.0;
  if (turns(scene)) {
    look_along(scene, tool,
               [&](const Vec3& come, const Mat3&, bool) { most = std::max(most, come.dot(tool.approach)); });
    return most;
  }
  double depth = 0.0;
  for (const Step& step : steps_of(scene, tool))
    if (step.moves.empty()) most = std::max(most, depth += step.displacement.dot(tool.approach));
  return most;
}

double most_of_tool_below(const Scene& scene, const ToolPlace& tool) {
  if (!turns(scene)) return deepest(scene, tool);
  double most = 0.0;
  look_along(scene, tool, [&](const Vec3& come, const Mat3& turned, bool) {
    most = std::max(most, axis_below(come, turned, tool.approach, 0.0));
  });
  return most;
}

std::string in_words(const Step& step) {
  const Vec3 mm = 1e3 * step.displacement + Vec3::Zero(),
             degrees = 180.0 / std::numbers::pi * step.turn + Vec3::Zero();
  const std::string who = step.moves.empty() ? "the tool" : step.moves;
  const std::string moves = fmt::format("moves by ({:.4g}, {:.4g}, {:.4g}) mm", mm.x(), mm.y(), mm.z());
  const std::string duration_words = step.duration > 0.0 ? fmt::format(", in {:.4g} s", step.duration) : "";
  if (step.holds()) return fmt::format("{}: nothing moves for {:.4g} s", step.name, step.duration);
  if (!step.turns()) return fmt::format("{}: {} {}{}", step.name, who, moves, duration_words);
  std::string about = "its tip";
  if (step.about) {
    const Vec3 place = 1e3 * *step.about + Vec3::Zero();
    about = fmt::format("({:.4g}, {:.4g}, {:.4g}) mm", place.x(), place.y(), place.z());
  }
  return fmt::format("{}: {} {}turns by {:.4g} degrees, ({:.4g}, {:.4g}, {:.4g}), about {}{}", step.name, who,
                     step.displacement.isZero(0.0) ? "" : moves + " and ", degrees.norm(), degrees.x(),
                     degrees.y(), degrees.z(), about, duration_words);
}

LargestForce largest_force(const Loading& loading, const std::vector<ForceSample>& force) {
  LargestForce largest{*std::max_element(force.begin(), force.end(),
                                         [](const ForceSample& a, const ForceSample& b) {
                                           return std::abs(a.force) < std::abs(b.force);
                                         }),
                       {}};
  double ended = 0.0;  // [s]
  for (const Step& step : loading.steps) {
    ended += step.seconds(loading.rate);
    largest.step = step.name;
    if (largest.sample.t <= ended * (1.0 + 1e-9)) break;
  }
  return largest;
}

double lateral_force(const ForceSample& sample, const Vec3& approach) {
  const Vec3 force(sample.on_tool[0], sample.on_tool[1], sample.on_tool[2]);
  return (force - force.dot(approach) * approach).norm();
}

}  // namespace dimple
