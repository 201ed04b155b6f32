#include "apps/scene/resolve.hpp"

#include <fmt/format.h>

#include "apps/scene/config.hpp"
#include "apps/scene/resolve_parts.hpp"
#include "apps/scene/tool_words.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

std::optional<Goal> goal_of(const Config& config) {
  const std::string& text = config.accuracy.goal;
  Goal goal{.text = text, .budget_s = config.accuracy.budget_s};
  if (text.empty() && !(goal.budget_s > 0.0)) return std::nullopt;
  const Config usual;
  const std::map<std::string, bool> other_than_usual = {
      {"cloud.nodes", config.node_set.nodes != usual.node_set.nodes},
      {"cloud.spacing_mm", config.node_set.spacing_mm != usual.node_set.spacing_mm}};
  for (const auto& [key, is_other] : other_than_usual)  // a file of all options also states the defaults
    if (const auto source = config.source.find(key);
        source != config.source.end() && (is_other || is_of_caller(source->second)))
      throw UsageError(
          {.fact = "both an accuracy and a number of nodes are given",
           .where = fmt::format("{} and {}", source->second, text.empty() ? "--budget" : "--accuracy"),
           .why = "the accuracy determines the nodes",
           .remedy = "leave one of them out"});
  if (text.empty()) return goal;
  const bool of_place = followed_named(config.accuracy.quantity).has_value();
  const std::string unit = of_place ? "mm" : "N";
  const bool is_absolute = text.find(of_place ? 'm' : 'N') != std::string::npos;
  double value = 0.0;
  set_value({.key = "accuracy.goal",
             .flag = "--accuracy",
             .unit = is_absolute ? unit : "%",
             .value = &value,
             .most = is_absolute ? 1e6 : 100.0,
             .least_excluded = true,
             .help = is_absolute ? "largest error"
                                 : fmt::format("largest error, as 2% or {}", of_place ? "0.1mm" : "1mN")},
            text, "--accuracy (accuracy.goal)");
  (is_absolute ? goal.absolute : goal.fraction) = !is_absolute ? 0.01 * value
                                                  : of_place   ? 1e-3 * value
                                                               : value;
  return goal;
}

// Tissue of a label: values of its section, else those of the body's material or of its own preset.
TissueOfLabel tissue_of(const Config& config, const std::string& label,
                        const std::map<std::string, std::string>& differing) {
  Config own = config;
  own.tissue.clear();
  own.source.clear();
  if (config.material.preset != "none" && differing.contains("material.preset"))
    static_cast<MaterialNumbers&>(own.material) = {};
  for (const auto& [key, text] : differing) set_option(own, key, text, "tissue." + label);
  complete(own);
  TissueOfLabel tissue{
      .label = label,
      .numbers = own.material,
      .printed_stress = own.material.stress == "printed",
      .has_own_nu = differing.contains("material.nu") || differing.contains("material.preset")};
  try {
    material_from(tissue.numbers, tissue.printed_stress);
  } catch (UsageError& error) {
    error.report.where = fmt::format("[tissue.{}]", label);
    throw;
  }
  return tissue;
}

void set_material(const Config& config, Scene& scene) {
  static_cast<MaterialNumbers&>(scene.material) = config.material;
  scene.material.mu_spread = 0.01 * config.material.mu_spread_percent;
  scene.material.printed_stress = config.material.stress == "printed";
  scene.material.preset = config.material.preset;
  scene.material.deviations_from_preset = deviations_from_preset(config);
  material_of(scene);  // throws if the numbers give no material
  for (const auto& [label, differing] : config.tissue)
    scene.tissues.push_back(tissue_of(config, label, differing));
}

void set_model(const Config& config, Scene& scene) {
  scene.image = config.image;
  scene.cut = cut_named(config.image.cut, "--cut (image.cut)", config.image.cut_gap_mm);
  scene.scheme = config.scheme.name;
  scene.node_set = config.node_set;
  scene.grid = config.grid;
  scene.support_radius_factor = config.support.radius_factor;
  scene.boundary = config.boundary;
  scene.base_is_held = config.boundary.base_hold != "none";
}

void set_loads(const Config& config, Scene& scene) {
  const Config::Load& load = config.load;
  scene.gravity = gravity_named(load.gravity);
  scene.fluid_lost = fluid_named(load.fluid_lost);
  scene.pressures = pressures_named(config.pressure);
  scene.body_forces = body_forces_named(config.body_force);
  scene.membranes = films_named(config.membrane, load.membrane);
  scene.imaged_loaded = load.imaged == "loaded";
}

void set_contact(const Config& config, Scene& scene) {
  using Self = Scene::SelfContact;
  const Config::Load& load = config.load;
  scene.depth_mm = load.depth_mm;
  scene.rate_mm_per_s = load.rate_mm_per_s;
  scene.contact = load.contact == "bonded" ? Contact::bonded : Contact::frictionless;
  scene.tool = tool_named(config.tool.shape, "--tool (tool.shape)");
  scene.friction = friction_named(config.tool.friction, "--friction (tool.friction)");
  scene.tool_words = config.tool;
  scene.self_contact = load.self_contact == "on"    ? Self::on
                       : load.self_contact == "off" ? Self::off
                                                    : Self::automatic;
  scene.walls = walls_named(config.wall, load.wall);
  scene.supports = supports_named(config.held);
  scene.further_tools = further_tools_named(config.other_tool);
  scene.steps = steps_named(config.step, config.image.cut_gap_mm);
  scene.poses_words = load.poses_taken;
}

void set_numerics(const Config& config, Scene& scene) {
  using Time = Scene::Numerics::Time;
  const Config::SolverSection& s = config.solver;
  scene.solver = {.safety = s.safety,
                  .damping_per_s = s.damping_per_s,
                  .frames = s.frames,
                  .step_radii = s.step_radii,
                  .sample_rate_per_s = s.sample_rate_per_s,
                  .tolerance = s.tolerance,
                  .evaluations = s.evaluations,
                  .precision = s.precision == "single" ? Precision::single_ : Precision::double_,
                  .time = s.time == "explicit"       ? Time::explicit_
                          : s.time == "quasi-static" ? Time::quasi_static
                                                     : Time::automatic};
}

Scene::Given given_in(const Description& description) {
  return {.nodes = !default_nodes(description),
          .stiffness = !default_stiffness(*description.options),
          .contact = was_given(description, "load.contact"),
          .diameter = was_given(description, "boundary.indenter_diameter_mm"),
          .rate = was_given(description, "load.rate_mm_per_s"),
          .sample_rate = was_given(description, "solver.sample_rate_per_s"),
          .depth_is_of_tool = depth_is_of_tool(*description.options)};
}

}  // namespace

Scene resolve(const Description& description) {
  const Config& config = *description.options;
  Scene scene;
  set_model(config, scene);
  set_material(config, scene);
  set_loads(config, scene);
  set_contact(config, scene);
  set_numerics(config, scene);
  scene.error_bounds = config.accuracy.error_bounds == "on";
  scene.goal = goal_of(config);
  scene.followed = followed_named(config.accuracy.quantity);
  scene.output = config.output;
  scene.given = given_in(description);
  check_steps(scene);
  check_tool(scene);
  check_names(scene);
  check_bed(scene);
  return scene;
}

}  // namespace dimple
