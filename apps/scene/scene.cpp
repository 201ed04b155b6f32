#include "apps/scene/scene.hpp"

#include <algorithm>

namespace dimple {

bool converges(const ModelChoices& choices) {
  return choices.scheme == converging.name;
}

bool has_loads(const Scene& scene) {
  return !scene.gravity.isZero(0.0) || scene.fluid_lost || !scene.pressures.empty() ||
         !scene.body_forces.empty();
}

bool has_tool_alone(const Scene& scene) {
  return scene.base_is_held && !has_loads(scene) && scene.membranes.empty() && scene.walls.empty() &&
         scene.supports.empty() && scene.further_tools.empty() && scene.steps.empty();
}

std::vector<Scene::Step> moving_steps(const Scene& scene) {
  std::vector<Scene::Step> steps;
  for (const Scene::Step& step : scene.steps)
    if (!step.cut) steps.push_back(step);
  return steps;
}

bool turns(const Scene& scene) {
  return std::any_of(scene.steps.begin(), scene.steps.end(),
                     [](const Scene::Step& step) { return !step.turn_deg.empty(); });
}

std::vector<Cut> cuts_of_undeformed_body(const Scene& scene) {
  std::vector<Cut> cuts;
  if (scene.cut) cuts.push_back(scene.cut);
  for (const Scene::Step& step : scene.steps) {
    if (!step.cut) break;
    cuts.push_back(step.cut);
  }
  return cuts;
}

bool has_cuts(const Scene& scene) {
  return scene.cut || (!scene.steps.empty() && scene.steps.front().cut);
}

std::vector<CutStep> cuts_after_moves(const Scene& scene) {
  std::vector<CutStep> cuts;
  std::size_t moved = 0;
  for (const Scene::Step& step : scene.steps) {
    if (!step.cut)
      ++moved;
    else if (moved > 0)
      cuts.push_back({step.name, step.cut, moved, step.toughness_J_m2});
  }
  return cuts;
}

const char* name_of(Scene::Numerics::Time time) {
  using Time = Scene::Numerics::Time;
  return time == Time::automatic ? "auto" : time == Time::explicit_ ? "explicit" : "quasi-static";
}

const char* name_of(Contact contact) {
  return contact == Contact::bonded ? "bonded" : "frictionless";
}

Scheme scheme_of(const ModelChoices& c) {
  Scheme scheme = *scheme_named(c.scheme);  // one of the option's choices
  if (c.node_set.patch_edge > 0.0) {
    scheme.grading.patch_edge = c.node_set.patch_edge;
    scheme.grading.least = 0.0;
  }
  if (c.grid.ratio > 0.0) scheme.points_per_node = c.grid.ratio;
  if (c.support_radius_factor > 0.0) scheme.support.radius_factor = c.support_radius_factor;
  return scheme;
}

Material material_of(const Scene& scene) {
  return material_from(scene.material, scene.material.printed_stress);
}

std::vector<Material> materials_of(const Scene& scene) {
  std::vector<Material> materials = {material_of(scene)};
  for (const TissueOfLabel& tissue : scene.tissues)
    materials.push_back(material_from(tissue.numbers, tissue.printed_stress));
  return materials;
}

Loading loading_of(const Scene& scene) {
  return {.depth = 1e-3 * scene.depth_mm,
          .rate = 1e-3 * scene.rate_mm_per_s,
          .contact = scene.contact,
          .loads = {.gravity = scene.gravity, .pressure = {}, .membrane = {}}};
}

SolverOptions solver_options(const Scene& scene) {
  constexpr double fewest_samples = 20.0;  // for a load too short for them at the default rate
  const double least_rate =
      scene.given.sample_rate ? 0.0 : fewest_samples * scene.rate_mm_per_s / scene.depth_mm;
  return {.safety = scene.solver.safety,
          .damping = scene.solver.damping_per_s,
          .frames = static_cast<int>(scene.solver.frames),
          .step_radii = scene.solver.step_radii,
          .sample_rate = std::max(scene.solver.sample_rate_per_s, least_rate),
          .tolerance = scene.solver.tolerance,
          .evaluations = scene.solver.evaluations};
}

double longest_step_radii(const Scene& scene) {
  const double step = scene.solver.step_radii;
  return step > 0.0 ? step : longest_step(scene.tool.has_value());
}

}  // namespace dimple
