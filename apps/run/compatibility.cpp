#include "apps/run/compatibility.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <vector>

#include "apps/run/compare.hpp"
#include "apps/run/cuts.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/tool.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

Feature feature_at(std::size_t k) {
  return static_cast<Feature>(k);
}

template <class Named, class Is>
std::string first_named(const Named& all, const Is& is) {
  for (const auto& [name, one] : all)
    if (is(one)) return name;
  return {};
}

bool goes_somewhere(const std::vector<double>& way) {
  return std::any_of(way.begin(), way.end(), [](double d) { return d != 0.0; });
}

constexpr auto moves_along = [](const auto& one) { return goes_somewhere(one.move_mm); };
constexpr auto has_friction = [](const auto& one) { return one.friction != "0"; };
constexpr auto cuts_body = [](const Config::Step& step) { return !step.cut.empty(); };
constexpr auto turns_tool = [](const Config::Step& step) {
  return !step.turn_deg.empty() && step.moves == "tool";
};
constexpr auto goes_in_space = [](const Config::Step& step) {
  return step.move_mm.size() == 3 && step.moves == "tool";
};

template <class Named, class Is>
bool any_is(const Named& all, const Is& is) {
  return std::any_of(all.begin(), all.end(), [&](const auto& one) { return is(one.second); });
}

void add_tools(const Config& config, Features& has) {
  const bool is_circle = !tool_of(config);
  has.set(Feature::circle, is_circle);
  has.set(Feature::touching_tool, !is_circle);
  has.set(Feature::friction, friction_of(config) > 0.0);
  has.set(Feature::further_friction,
          any_is(config.other_tool, has_friction) || any_is(config.wall, has_friction));
  has.set(Feature::chosen_contact, was_given(config, "load.contact"));
  has.set(Feature::chosen_diameter, was_given(config, "boundary.indenter_diameter_mm"));
  has.set(Feature::frictionless, config.load.contact == "frictionless");
  has.set(Feature::sideways, is_circle && any_is(config.step, goes_in_space));
  has.set(Feature::turning, any_is(config.step, turns_tool));
  has.set(Feature::further_tool, !config.other_tool.empty());
  has.set(Feature::moving_further_tool, any_is(config.other_tool, moves_along));
}

void add_body(const Config& config, Features& has) {
  has.set(Feature::fluid_lost, config.load.fluid_lost != "none");
  has.set(Feature::gravity, config.load.gravity != "none");
  has.set(Feature::pressure, !config.pressure.empty());
  has.set(Feature::membrane, has_membranes(config));
  has.set(Feature::tension,
          any_is(config.membrane, [](const Config::Film& film) { return film.tension_N_per_m != 0.0; }));
  has.set(Feature::free_base, !has_base(config));
  has.set(Feature::wall, has_walls(config));
  has.set(Feature::wall_at_gap,
          any_is(config.wall, [](const Config::Wall& wall) { return wall.gap != "image"; }));
  has.set(Feature::support, !config.held.empty());
  has.set(Feature::moving_support, any_is(config.held, moves_along));
  has.set(Feature::steps, !config.step.empty());
  has.set(Feature::cut, has_cuts(config));
  has.set(Feature::cut_step, any_is(config.step, cuts_body));
  has.set(Feature::cut_after_step, !cuts_after_moves(config).empty());
  has.set(Feature::self_contact, config.load.self_contact == "on");
  has.set(Feature::imaged_loaded, config.load.imaged == "loaded");
}

void add_numerics(const Config& config, Features& has) {
  const std::vector<Material> materials = materials_of(config);
  const bool converges = config.scheme.name == Config{}.scheme.name;
  has.set(Feature::converging_scheme, converges);
  has.set(Feature::paper_scheme, !converges);
  has.set(Feature::inertia, config.solver.time == "explicit");
  has.set(Feature::viscous, relaxes(materials));
  has.set(Feature::tissues, !config.tissue.empty());
  has.set(Feature::other_law, !is_plain(materials.front()));
  has.set(Feature::printed_stress, is_as_printed(materials.front()));
  has.set(Feature::ogden, !config.material.ogden_mu_Pa.empty());
  has.set(Feature::mooney, config.material.mooney_c01_Pa > 0.0);
  has.set(Feature::preset, config.material.preset != "none");
  has.set(Feature::uncertain_mu, config.material.mu_spread_percent > 0.0);
}

void add_output(const Config& config, Features& has) {
  const std::vector<std::string>& write = config.output.write;
  has.set(Feature::grid_images, std::find(write.begin(), write.end(), "images") != write.end());
  has.set(Feature::warped_images, !config.output.warp.empty() || !config.output.warp_labels.empty());
  has.set(Feature::followed_place, config.accuracy.quantity != Config{}.accuracy.quantity);
  has.set(Feature::accuracy, !config.accuracy.goal.empty() || config.accuracy.budget_s > 0.0);
  has.set(Feature::comparison, !config.output.compare.empty());
  has.set(Feature::paper_comparison, config.output.compare == paper_word);
}

// Which of them is there first, in the order of the enumeration.
std::optional<Feature> first_of(Features some, Features there) {
  for (std::size_t k = 0; k < feature_count; ++k)
    if (some.has(feature_at(k)) && there.has(feature_at(k))) return feature_at(k);
  return std::nullopt;
}

// What the texts of the table may hold.
std::string filled_in(const char* text, const Config& config, Feature beside) {
  const auto after = cuts_after_moves(config);
  const auto any = [](const auto&) { return true; };
  return fmt::format(
      fmt::runtime(text), fmt::arg("beside", words_of(beside).name),
      fmt::arg("option", words_of(beside).option), fmt::arg("tool", config.tool.shape),
      fmt::arg("friction", config.tool.friction), fmt::arg("cut", config.image.cut),
      fmt::arg("time", config.solver.time), fmt::arg("scheme", config.scheme.name),
      fmt::arg("spread", fmt::format("{:g}", config.material.mu_spread_percent)),
      fmt::arg("accuracy", config.accuracy.goal.empty() ? "accuracy.budget_s" : "accuracy.goal"),
      fmt::arg("membrane", config.load.membrane != "none" ? "--membrane (load.membrane)" : "membrane"),
      fmt::arg("wall", config.load.wall != "none" ? "--wall (load.wall)" : "wall"),
      fmt::arg("further_tool", first_named(config.other_tool, any)),
      fmt::arg("moving_tool", first_named(config.other_tool, moves_along)),
      fmt::arg("moving_support", first_named(config.held, moves_along)),
      fmt::arg("turning", first_named(steps_in_order(config), turns_tool)),
      fmt::arg("sideways", first_named(steps_in_order(config), goes_in_space)),
      fmt::arg("any_cut_step", first_named(steps_in_order(config), cuts_body)),
      fmt::arg("cut_step", after.empty() ? "" : after.front().name));
}

Report report_of(const Clash& row, const Config& config, Feature beside) {
  const auto filled = [&](const char* text) { return filled_in(text, config, beside); };
  return {.fact = filled(row.fact),
          .where = filled(row.where),
          .why = filled(row.why),
          .remedy = filled(row.remedy)};
}

// The first reason of the table why there are no error bounds, or no proportional force.
const Clash* reason_in(Features has, Feature wanted) {
  for (const Clash& row : clashes())
    if (row.feature == wanted && first_of(row.beside, has)) return &row;
  return nullptr;
}

std::optional<Report> clash_in(Features has, const Config& config) {
  for (const Clash& row : clashes())
    if (has.has(row.feature))
      if (const std::optional<Feature> beside = first_of(row.beside, has))
        return report_of(row, config, *beside);
  for (const Need& need : needs())
    if (has.has(need.feature))
      if (const Clash* row = reason_in(has, need.needs))
        return Report{.fact = filled_in(need.fact, config, need.needs),
                      .where = need.where,
                      .why = std::string(need.lead) + row->why,
                      .remedy = need.remedy};
  return std::nullopt;
}

std::string names_in_words(Features some) {
  std::vector<std::string> names;
  for (std::size_t k = 0; k < feature_count; ++k)
    if (some.has(feature_at(k))) names.emplace_back(words_of(feature_at(k)).name);
  return fmt::format("{}", fmt::join(names, "; "));
}

}  // namespace

Features features_of(const Config& config) {
  Features has;
  add_tools(config, has);
  add_body(config, has);
  add_numerics(config, has);
  add_output(config, has);
  return has;
}

std::optional<Report> clash_of(const Config& config, Feature driver) {
  Features has = features_of(config);
  has.set(driver);
  // The scheme is that of the model, which check_materials() is given.
  if (driver == Feature::solve || driver == Feature::solve_in_memory || driver == Feature::session)
    has.erase(Feature::converging_scheme);
  return clash_in(has, config);
}

void check_pairs(const Config& config, Feature driver) {
  if (std::optional<Report> report = clash_of(config, driver)) throw UsageError(*std::move(report));
}

void check_pair(const Config& config, Feature feature, Feature beside) {
  if (!features_of(config).has(feature)) return;
  for (const Clash& row : clashes()) {
    if (row.feature == feature && row.beside.has(beside)) throw UsageError(report_of(row, config, beside));
    if (row.feature == beside && row.beside.has(feature)) throw UsageError(report_of(row, config, feature));
  }
}

std::string why_without(const Config& config, Feature wanted) {
  const Clash* row = reason_in(features_of(config), wanted);
  return row ? row->why : "";
}

void check_materials(const Config& config, const Scheme& scheme) {
  const Feature its = scheme.pressure_patches ? Feature::converging_scheme : Feature::paper_scheme;
  for (const Feature feature : {Feature::tissues, Feature::other_law, Feature::printed_stress})
    check_pair(config, feature, its);
}

std::string pairs_in_words() {
  std::string text;
  for (std::size_t k = 0; k < feature_count; ++k) {
    const Feature feature = feature_at(k);
    std::string rows;
    for (const Clash& row : clashes())
      if (row.feature == feature)
        rows += fmt::format("  not with   {}\n             {}\n", names_in_words(row.beside), row.why);
    for (const Need& need : needs())
      if (need.feature == feature) rows += fmt::format("  needs      {}\n", words_of(need.needs).name);
    if (!rows.empty()) text += fmt::format("{}\n{}\n", words_of(feature).name, rows);
  }
  return text;
}

}  // namespace dimple
