#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apps/scene/option.hpp"
#include "apps/scene/resolve_parts.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

constexpr double most_turned_deg = 90.0;  // in one step

bool is_of_tool(const Scene::Step& step) {
  return step.moves == tool_word;
}

[[noreturn]] void refuse_step(const std::string& name, const char* key, const std::string& fact,
                              const std::string& why, const std::string& remedy) {
  throw UsageError({.fact = fmt::format("the step '{}' {}", name, fact),
                    .where = fmt::format("step.{}.{}", name, key),
                    .why = why,
                    .remedy = remedy});
}

bool all_zero(const std::vector<double>& numbers) {
  return std::all_of(numbers.begin(), numbers.end(), [](double d) { return d == 0.0; });
}

Vec3 three(const std::vector<double>& numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}

void check_turn(const Scene::Step& step) {
  if (step.turn_deg.empty()) {
    if (!step.about_mm.empty())
      refuse_step(step.name, "about_mm", "has a centre of rotation, and does not turn",
                  "about_mm is the centre of a rotation", "give turn_deg too, or leave about_mm out");
    return;
  }
  if (!is_of_tool(step))
    refuse_step(step.name, "turn_deg", fmt::format("turns '{}'", step.moves),
                "only the measured tool turns; supports and further tools translate",
                "move it by move_mm, or let the tool turn (moves = \"tool\")");
  if (step.turn_deg.size() != 3)
    refuse_step(step.name, "turn_deg", fmt::format("turns by {} numbers", step.turn_deg.size()),
                "a turn is a rotation vector x,y,z in LPS: its direction is the axis, its length the angle",
                "give for instance turn_deg = [0, 20, 0]");
  if (all_zero(step.turn_deg))
    refuse_step(step.name, "turn_deg", "turns by zero", "a step ends at a displacement",
                "leave turn_deg out");
  if (const double angle = three(step.turn_deg).norm(); angle > most_turned_deg * (1.0 + 1e-9))
    refuse_step(step.name, "turn_deg", fmt::format("turns by {:.4g} degrees", angle),
                fmt::format("a step turns by {:g} degrees at most", most_turned_deg),
                "give it several steps, one after the other");
  if (!step.about_mm.empty() && step.about_mm.size() != 3)
    refuse_step(step.name, "about_mm",
                fmt::format("has a centre of rotation of {} numbers", step.about_mm.size()),
                "a place is x,y,z in LPS", "give for instance about_mm = [0, 0, 40]");
}

void check_motion(const Scene& scene, const Scene::Step& step) {
  const std::size_t count = step.move_mm.size();
  check_turn(step);
  if (count == 0 && !step.turn_deg.empty()) return;
  if (count == 0 && step.time_s > 0.0) return;  // a hold
  const bool is_a_tool = is_of_tool(step) || named(scene.further_tools, step.moves);
  const bool along_approach = count == 1 && is_a_tool;
  if (count != 3 && !along_approach)
    refuse_step(step.name, "move_mm",
                count == 0 ? "moves nothing" : fmt::format("moves by {} numbers", count),
                is_a_tool ? "a tool moves by x,y,z in LPS, or by one number along its approach direction"
                          : "a support moves by x,y,z in LPS",
                "give for instance move_mm = [3, 0, 0], or time_s alone to hold for that time");
  if (all_zero(step.move_mm))
    refuse_step(step.name, "move_mm", "moves by zero", "a step ends at a displacement",
                "leave move_mm out and give time_s to hold for that time, or leave the step out");
}

std::string first_turn(const Scene& scene) {
  for (const Scene::Step& step : moving_steps(scene))
    if (!step.turn_deg.empty()) return step.name;
  return {};
}

// Refuses steps that cut and move at once.
void check_cut_steps(const Scene& scene) {
  for (const Scene::Step& step : scene.steps) {
    if (!step.cut) continue;
    if (!step.move_mm.empty() || !step.turn_deg.empty() || !is_of_tool(step))
      refuse_step(step.name, "cut", "cuts and moves something", "nothing moves while a cut is made",
                  "give it two steps, one after the other");
    if (step.time_s > 0.0)
      refuse_step(step.name, "time_s", "cuts, and lasts", "a cut takes no time",
                  "give it a step of its own to hold");
  }
  for (const Scene::Step& step : moving_steps(scene))
    if (step.toughness_J_m2 > 0.0)
      refuse_step(step.name, "toughness_J_m2", "has a toughness and cuts nothing",
                  "toughness is the energy per area of a cut", "give it to a step with a cut");
  if (moving_steps(scene).empty())
    refuse_step(scene.steps.front().name, "cut", "cuts, and no step moves anything",
                "with steps, only the steps move the tool",
                "add one, as step.press.move = 4mm, or cut the body at rest by --cut");
}

}  // namespace

std::vector<Scene::Step> steps_named(const std::map<std::string, StepText>& texts, double cut_gap_mm) {
  std::vector<std::pair<std::string, StepText>> in_order(texts.begin(), texts.end());
  std::sort(in_order.begin(), in_order.end(),
            [](const auto& a, const auto& b) { return a.second.order < b.second.order; });
  std::vector<Scene::Step> steps;
  for (const auto& [name, text] : in_order) {
    Scene::Step step{.name = name,
                     .moves = text.moves,
                     .move_mm = text.move_mm,
                     .turn_deg = text.turn_deg,
                     .about_mm = text.about_mm,
                     .toughness_J_m2 = text.toughness_J_m2,
                     .time_s = text.time_s};
    if (!text.cut.empty()) {
      step.cut = cut_named(text.cut, fmt::format("step.{}.cut", name), cut_gap_mm);
      if (!step.cut)
        throw UsageError({.fact = fmt::format("the cut '{}' is empty", text.cut),
                          .where = step.cut.where,
                          .why = "a step with a cut needs its shape",
                          .remedy = "give it a plane, a line, a sheet or a label"});
    }
    steps.push_back(std::move(step));
  }
  return steps;
}

void check_steps(const Scene& scene) {
  if (scene.steps.empty()) return;
  check_cut_steps(scene);
  const auto moving = moving_steps(scene);
  if (std::all_of(moving.begin(), moving.end(), [](const Scene::Step& step) {
        return step.move_mm.empty() && step.turn_deg.empty() && step.time_s > 0.0;
      }))
    refuse_step(moving.front().name, "time_s", "holds, and no step moves anything",
                "the tool would never make contact", "press first, as step.press.move_mm = 4");
  double pressed = 0.0;
  for (const Scene::Step& step : moving) {
    if (!is_of_tool(step)) {
      std::vector<std::string> known = {tool_word};
      for (const Scene::Support& support : scene.supports) known.push_back(support.name);
      for (const Scene::FurtherTool& tool : scene.further_tools) known.push_back(tool.name);
      if (std::find(known.begin() + 1, known.end(), step.moves) == known.end())
        refuse_step(step.name, "moves", fmt::format("moves '{}', which is not there", step.moves),
                    "it moves the tool, a support or a further tool" + did_you_mean(step.moves, known),
                    "give moves = \"tool\", or the NAME of a [support.NAME] or a [tool.NAME]");
    }
    if (named(scene.walls, step.moves))
      refuse_step(step.name, "moves", fmt::format("moves '{}', and a wall has that name too", step.moves),
                  "a wall does not move, and bodies are moved by name", "name the wall differently");
    check_motion(scene, step);
    if (is_of_tool(step) && step.move_mm.size() == 1) pressed += step.move_mm[0];
    if (pressed < 0.0 && scene.contact == Contact::frictionless)
      refuse_step(step.name, "move_mm", "lifts a frictionless tool above its first contact",
                  "only a bonded tool pulls", "lift it less, or give --contact bonded");
  }
  if (turns(scene) && deepest_along_approach(moving) <= 0.0)
    refuse_step(first_turn(scene), "turn_deg", "turns the tool, and no step presses it in",
                "the nodes are placed for the depth to which it is pressed",
                "press it first, as step.press.move_mm = 2");
}

}  // namespace dimple
