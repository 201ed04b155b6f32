#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "apps/scene/config.hpp"
#include "apps/scene/resolve_parts.hpp"
#include "apps/scene/tool_words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

// Prefix of a preset's name in the source of a number.
const std::string of_preset = "preset ";
const std::string by_tool = "the tool";
// Prefix of the source of an option for all cases of a table; a case may override it.
const std::string for_all_cases = "all cases: ";

constexpr std::array keys_of_a_preset = {
    "material.mu_Pa",       "material.nu",          "material.density_kg_per_m3",
    "material.ogden_mu_Pa", "material.ogden_alpha", "material.mooney_c01_Pa",
    "material.gent_limit",  "material.prony_g",     "material.prony_tau_s"};

bool is_of_a_preset(const Option& option) {
  return std::find(keys_of_a_preset.begin(), keys_of_a_preset.end(), option.key) != keys_of_a_preset.end();
}

// Rank of an option's source: 0, none, a preset or a default in a file of all options; 1, for all cases of a
// table, each of which may override it; 2, a file; 3, the caller.
int precedence_of(const Config& config, const std::string& key) {
  const auto source = config.source.find(key);
  if (source == config.source.end() || source->second.starts_with(of_preset)) return 0;
  if (source->second.starts_with(for_all_cases)) return 1;
  if (is_of_caller(source->second)) return 3;
  Config usual, own = config;
  std::vector<Option> all = options_of(own), as_usual = options_of(usual);
  return toml_value(*find_option(all, key)) == toml_value(*find_option(as_usual, key)) ? 0 : 2;
}

// True if the value of an option came from an earlier preset.
bool was_of_a_preset(const Config& config, const std::string& key) {
  const auto source = config.source.find(key);
  return source != config.source.end() &&
         (source->second.starts_with(of_preset) || source->second.starts_with(for_all_cases + of_preset));
}

void take_preset(Config& config, bool young_given) {
  const std::string& preset = config.material.preset;
  const bool none = preset == "none";
  Config published;
  if (!none) static_cast<MaterialNumbers&>(published.material) = numbers_of_preset(preset);
  const int weight = precedence_of(config, "material.preset");
  std::vector<Option> own = options_of(config), theirs = options_of(published);
  for (std::size_t k = 0; k < own.size(); ++k) {
    const std::string& key = own[k].key;
    if (!is_of_a_preset(own[k]) || (key == "material.mu_Pa" && young_given)) continue;
    if (none ? !was_of_a_preset(config, key) : precedence_of(config, key) >= weight) continue;
    std::visit([&](auto* value) { *value = *std::get<decltype(value)>(theirs[k].value); }, own[k].value);
    if (none)
      config.source.erase(key);
    else
      config.source[key] = of_preset + preset;
  }
}

void resolve_young(Config& config) {
  auto& m = config.material;
  if (m.young_Pa == 0.0) return;
  const auto young = config.source.find("material.young_Pa"), mu = config.source.find("material.mu_Pa");
  if (precedence_of(config, "material.mu_Pa") > 1)
    throw UsageError(
        {.fact = fmt::format("both a shear modulus, {} Pa, and Young's modulus, {} Pa, are given", m.mu_Pa,
                             m.young_Pa),
         .where = fmt::format("{} and {}", mu->second, young->second),
         .why = "one follows from the other: mu = E / (2 (1 + nu))",
         .remedy = "give one of --mu and --young; material.young_Pa = 0 unsets one from a file"});
  m.mu_Pa = m.young_Pa / (2.0 * (1.0 + m.nu));
  config.source["material.mu_Pa"] = fmt::format("Young's modulus {} Pa, {}", m.young_Pa, young->second);
  m.young_Pa = 0.0;
}

// Makes mu the sum of Ogden's moduli, or scales the moduli to the sum mu.
void match_ogden(Config& config, int weight_of_modulus) {
  auto& m = config.material;
  double sum = 0.0;
  for (const double mu : m.ogden_mu_Pa) sum += mu;
  constexpr double rounding = 1e-12;
  if (!(sum > 0.0) || std::abs(sum - m.mu_Pa) <= rounding * sum)
    return;  // an invalid law is refused elsewhere
  const int weight = precedence_of(config, "material.ogden_mu_Pa");
  if (weight == weight_of_modulus && weight > 0)
    throw UsageError(
        {.fact = fmt::format("both a shear modulus, {} Pa, and Ogden moduli that add up to {} Pa are given",
                             m.mu_Pa, sum),
         .where = fmt::format("{} and {}", config.source.at("material.mu_Pa"),
                              config.source.at("material.ogden_mu_Pa")),
         .why = "the moduli of Ogden's terms add up to the shear modulus",
         .remedy = "give one of them"});
  if (weight_of_modulus > weight) {
    for (double& mu : m.ogden_mu_Pa) mu *= m.mu_Pa / sum;
    config.source["material.ogden_mu_Pa"] += ", scaled to mu";
  } else {
    m.mu_Pa = sum;
    config.source["material.mu_Pa"] = "the sum of ogden_mu_Pa";
  }
}

// The number of nodes follows from the spacing; a number of the caller overrides a spacing in a file.
void resolve_spacing(Config& config) {
  if (!(config.node_set.spacing_mm > 0.0)) return;
  const int nodes = precedence_of(config, "cloud.nodes"), spacing = precedence_of(config, "cloud.spacing_mm");
  if (nodes > spacing) config.node_set.spacing_mm = 0.0;
  const auto in_terminal = [&](const char* key) {
    const auto source = config.source.find(key);
    return source != config.source.end() && source->second.starts_with("--");
  };
  if (in_terminal("cloud.nodes") && in_terminal("cloud.spacing_mm"))
    throw UsageError({.fact = fmt::format("both {} nodes and a spacing of {} are given",
                                          config.node_set.nodes, length_in_words(config.node_set.spacing_mm)),
                      .where = fmt::format("{} and {}", config.source.at("cloud.nodes"),
                                           config.source.at("cloud.spacing_mm")),
                      .why = "one follows from the other",
                      .remedy = "give one of --nodes and --spacing"});
}

// The source nearer to the command line decides between the number of points and their ratio.
void resolve_points(Config& config) {
  if (!(config.grid.points > 0) || !(config.grid.ratio > 0.0)) return;
  const int points = precedence_of(config, "grid.points"), ratio = precedence_of(config, "grid.ratio");
  if (points < ratio) config.grid.points = 0;
  if (points > ratio) config.grid.ratio = 0.0;
  if (points == ratio)
    throw UsageError({.fact = fmt::format("both {} integration points and {} of them per node are given",
                                          config.grid.points, plain(config.grid.ratio)),
                      .where = "--points (grid.points) and grid.ratio",
                      .why = "one follows from the other",
                      .remedy = "give one of them"});
}

// Makes steps of poses. The depth of a scene of steps follows from them: the largest depth of the tool, or
// else the longest displacement.
void take_poses(Config& config) {
  if (config.load.poses.empty()) return;
  if (!config.step.empty())
    throw UsageError({.fact = "the tool is moved by poses and by steps",
                      .where = "--poses (load.poses)",
                      .why = "poses are steps from one to the next",
                      .remedy = "leave one of the two out"});
  if (precedence_of(config, "load.rate_mm_per_s") > 0)
    throw UsageError({.fact = "a rate is given, and poses",
                      .where = "--rate (load.rate_mm_per_s)",
                      .why = "the times of the poses set the speed of the tool",
                      .remedy = "leave one of the two out"});
  PosesTaken taken = steps_of_poses(config.load.poses);
  config.step = std::move(taken.steps);
  config.load.poses_taken = std::move(taken.words);
  config.load.poses.clear();  // they are steps now
}

void resolve_steps(Config& config) {
  take_poses(config);
  if (config.step.empty()) return;
  std::vector<StepText> moving;
  for (const auto& [name, step] : moving_steps(config)) moving.push_back(step);
  double longest = 0.0;
  for (const StepText& step : moving) {
    double length = 0.0;
    for (const double d : step.move_mm) length = std::hypot(length, d);
    longest = std::max(longest, length);
  }
  const double pressed = deepest_along_approach(moving), depth = pressed > 0.0 ? pressed : longest;
  if (!(depth > 0.0)) return;  // check_steps() refuses it
  const auto given = config.source.find("load.depth_mm");
  if (given != config.source.end() && given->second != "the steps" &&
      std::abs(config.load.depth_mm - depth) > 1e-9 * depth)
    throw UsageError(
        {.fact = fmt::format("a depth of {} is given, and {}", length_in_words(config.load.depth_mm),
                             config.load.poses_taken.empty() ? "steps" : "poses, which are steps"),
         .where = given->second,
         .why = fmt::format("the steps move the tool to a depth of {}", length_in_words(depth)),
         .remedy = "leave the depth out, or the steps"});
  config.load.depth_mm = depth;
  config.source["load.depth_mm"] = "the steps";
}

// Limits the default depth of a contacting tool to a fraction of its radius.
void resolve_depth(Config& config) {
  const std::optional<ToolShape> tool = tool_named(config.tool.shape, "--tool (tool.shape)");
  const bool is_given = config.source.count("load.depth_mm") > 0 && !depth_is_of_tool(config);
  if (!tool || is_given || !config.step.empty()) return;
  config.load.depth_mm = std::min(Config{}.load.depth_mm, usual_depth_in_radii * 1e3 * tool->radius);
  config.source["load.depth_mm"] = by_tool;
}

}  // namespace

bool depth_is_of_tool(const Config& config) {
  const auto source = config.source.find("load.depth_mm");
  return source != config.source.end() && source->second.ends_with(by_tool);
}

bool was_given(const Description& description, const std::string& key) {
  return precedence_of(*description.options, key) > 0;
}

void complete(Config& config) {
  const int young = config.material.young_Pa > 0.0 ? precedence_of(config, "material.young_Pa") : 0;
  const bool young_given = young > 0 && young >= precedence_of(config, "material.preset");
  if (!young_given && config.material.preset != "none") config.material.young_Pa = 0.0;
  const int weight_of_modulus = std::max(precedence_of(config, "material.mu_Pa"), young);
  take_preset(config, young_given);
  resolve_young(config);
  match_ogden(config, weight_of_modulus);
  resolve_steps(config);
  resolve_depth(config);
  resolve_spacing(config);
  resolve_points(config);
}

void complete(Description& description) {
  complete(*description.options);
}

void complete_for_all_cases(Description& description) {
  complete(description);
  for (auto& [key, source] : description.options->source)
    if (key.starts_with("material.") || key == "cloud.nodes") source = for_all_cases + source;
}

std::string deviations_from_preset(const Config& config) {
  if (config.material.preset == "none") return {};
  Config own = config, published;
  static_cast<MaterialNumbers&>(published.material) = numbers_of_preset(config.material.preset);
  const std::vector<Option> ours = options_of(own), theirs = options_of(published);
  std::string text;
  for (std::size_t k = 0; k < ours.size(); ++k) {
    const std::string now = toml_value(ours[k]), then = toml_value(theirs[k]);
    if (!is_of_a_preset(ours[k]) || now == then) continue;
    const auto source = config.source.find(ours[k].key);
    text += fmt::format("{}{} {}{} in place of {}", text.empty() ? config.material.preset + ", but " : "; ",
                        ours[k].key.substr(ours[k].key.find('.') + 1), now,
                        source == config.source.end() ? "" : " (" + source->second + ")", then);
  }
  return text;
}

bool default_stiffness(const Config& config) {
  const auto& m = config.material;
  return m.preset == "none" && m.ogden_mu_Pa.empty() && m.mu_Pa == Config{}.material.mu_Pa &&
         config.source.count("material.mu_Pa") == 0;
}

bool default_nodes(const Description& description) {
  const Config& config = *description.options;
  return config.node_set.nodes == Config{}.node_set.nodes && !(config.node_set.spacing_mm > 0.0) &&
         config.source.count("cloud.nodes") == 0;
}

}  // namespace dimple
