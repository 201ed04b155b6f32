#include "apps/scene/compatibility.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <vector>

#include "io/error.hpp"

namespace dimple {
namespace {

Feature feature_at(std::size_t k) {
  return static_cast<Feature>(k);
}

template <class Named, class Is>
std::string first_named(const Named& all, const Is& is) {
  for (const auto& one : all)
    if (is(one)) return one.name;
  return {};
}

bool goes_somewhere(const std::vector<double>& components) {
  return std::any_of(components.begin(), components.end(), [](double d) { return d != 0.0; });
}

constexpr auto moves_along = [](const auto& one) { return goes_somewhere(one.move_mm); };
constexpr auto has_friction = [](const auto& one) { return one.friction > 0.0; };
constexpr auto cuts_body = [](const Scene::Step& step) { return static_cast<bool>(step.cut); };
constexpr auto turns_tool = [](const Scene::Step& step) {
  return !step.turn_deg.empty() && step.moves == tool_word;
};
constexpr auto goes_in_space = [](const Scene::Step& step) {
  return step.move_mm.size() == 3 && step.moves == tool_word;
};

template <class Named, class Is>
bool any_is(const Named& all, const Is& is) {
  return std::any_of(all.begin(), all.end(), is);
}

void add_tools(const Scene& scene, Features& has) {
  const bool is_bonded_patch = !scene.tool;
  has.set(Feature::bonded_patch, is_bonded_patch);
  has.set(Feature::contacting_tool, !is_bonded_patch);
  has.set(Feature::friction, scene.friction > 0.0);
  has.set(Feature::further_friction,
          any_is(scene.further_tools, has_friction) || any_is(scene.walls, has_friction));
  has.set(Feature::chosen_contact, scene.given.contact);
  has.set(Feature::chosen_diameter, scene.given.diameter);
  has.set(Feature::frictionless, scene.contact == Contact::frictionless);
  has.set(Feature::sideways, is_bonded_patch && any_is(scene.steps, goes_in_space));
  has.set(Feature::turning, any_is(scene.steps, turns_tool));
  has.set(Feature::further_tool, !scene.further_tools.empty());
  has.set(Feature::moving_further_tool, any_is(scene.further_tools, moves_along));
}

void add_body(const Scene& scene, Features& has) {
  has.set(Feature::fluid_lost, scene.fluid_lost.has_value());
  has.set(Feature::gravity, !scene.gravity.isZero(0.0));
  has.set(Feature::pressure, !scene.pressures.empty());
  has.set(Feature::body_force, !scene.body_forces.empty());
  has.set(Feature::membrane, !scene.membranes.empty());
  has.set(Feature::tension,
          any_is(scene.membranes, [](const Scene::Film& film) { return film.tension_N_per_m != 0.0; }));
  has.set(Feature::free_base, !scene.base_is_held);
  has.set(Feature::wall, !scene.walls.empty());
  has.set(Feature::wall_at_gap,
          any_is(scene.walls, [](const Scene::Wall& wall) { return wall.gap.has_value(); }));
  has.set(Feature::support, !scene.supports.empty());
  has.set(Feature::moving_support, any_is(scene.supports, moves_along));
  has.set(Feature::steps, !scene.steps.empty());
  has.set(Feature::cut, has_cuts(scene));
  has.set(Feature::cut_step, any_is(scene.steps, cuts_body));
  has.set(Feature::cut_after_step, !cuts_after_moves(scene).empty());
  has.set(Feature::self_contact, scene.self_contact == Scene::SelfContact::on);
  has.set(Feature::imaged_loaded, scene.imaged_loaded);
}

void add_numerics(const Scene& scene, Features& has) {
  const std::vector<Material> materials = materials_of(scene);
  has.set(Feature::converging_scheme, converges(scene));
  has.set(Feature::paper_scheme, !converges(scene));
  has.set(Feature::inertia, scene.solver.time == Scene::Numerics::Time::explicit_);
  has.set(Feature::viscous, relaxes(materials));
  has.set(Feature::tissues, !scene.tissues.empty());
  has.set(Feature::other_law, !is_plain(materials.front()));
  has.set(Feature::printed_stress, is_as_printed(materials.front()));
  has.set(Feature::ogden, !scene.material.ogden_mu_Pa.empty());
  has.set(Feature::mooney, scene.material.mooney_c01_Pa > 0.0);
  has.set(Feature::preset, scene.material.preset != "none");
  has.set(Feature::uncertain_mu, scene.material.mu_spread > 0.0);
}

void add_output(const Scene& scene, Features& has) {
  const std::vector<std::string>& write = scene.output.write;
  has.set(Feature::grid_images, std::find(write.begin(), write.end(), "images") != write.end());
  has.set(Feature::warped_images, !scene.output.warp.empty() || !scene.output.warp_labels.empty());
  has.set(Feature::followed_place, scene.followed.has_value());
  has.set(Feature::accuracy, scene.goal.has_value());
  has.set(Feature::comparison, !scene.output.compare.empty());
  has.set(Feature::paper_comparison, scene.output.compare == paper_word);
}

// First of some features that is present, in the order of the enumeration.
std::optional<Feature> first_of(Features some, Features there) {
  for (std::size_t k = 0; k < feature_count; ++k)
    if (some.has(feature_at(k)) && there.has(feature_at(k))) return feature_at(k);
  return std::nullopt;
}

// Text of the table with its placeholders replaced.
std::string filled_in(const char* text, const Scene& scene, Feature other) {
  const auto after = cuts_after_moves(scene);
  const auto any = [](const auto&) { return true; };
  return fmt::format(
      fmt::runtime(text), fmt::arg("beside", words_of(other).name),
      fmt::arg("option", words_of(other).option), fmt::arg("tool", scene.tool_words.shape),
      fmt::arg("friction", scene.tool_words.friction), fmt::arg("cut", scene.cut.text),
      fmt::arg("time", name_of(scene.solver.time)), fmt::arg("scheme", scene.scheme),
      fmt::arg("spread", fmt::format("{:g}", 100.0 * scene.material.mu_spread)),
      fmt::arg("accuracy", !scene.goal || scene.goal->text.empty() ? "accuracy.budget_s" : "accuracy.goal"),
      fmt::arg("membrane", named(scene.membranes, "surface") ? "--membrane (load.membrane)" : "membrane"),
      fmt::arg("wall", named(scene.walls, "wall") ? "--wall (load.wall)" : "wall"),
      fmt::arg("further_tool", first_named(scene.further_tools, any)),
      fmt::arg("moving_tool", first_named(scene.further_tools, moves_along)),
      fmt::arg("moving_support", first_named(scene.supports, moves_along)),
      fmt::arg("turning", first_named(scene.steps, turns_tool)),
      fmt::arg("sideways", first_named(scene.steps, goes_in_space)),
      fmt::arg("any_cut_step", first_named(scene.steps, cuts_body)),
      fmt::arg("cut_step", after.empty() ? "" : after.front().name));
}

Report report_of(const Clash& row, const Scene& scene, Feature other) {
  const auto filled = [&](const char* text) { return filled_in(text, scene, other); };
  return {.fact = filled(row.fact),
          .where = filled(row.where),
          .why = filled(row.why),
          .remedy = filled(row.remedy)};
}

// First reason in the table why there are no error bounds or no proportional force.
const Clash* reason_in(Features has, Feature requested) {
  for (const Clash& row : clashes())
    if (row.feature == requested && first_of(row.other, has)) return &row;
  return nullptr;
}

std::optional<Report> clash_in(Features has, const Scene& scene) {
  for (const Clash& row : clashes())
    if (has.has(row.feature))
      if (const std::optional<Feature> other = first_of(row.other, has)) return report_of(row, scene, *other);
  for (const Need& need : needs())
    if (has.has(need.feature))
      if (const Clash* row = reason_in(has, need.needs))
        return Report{.fact = filled_in(need.fact, scene, need.needs),
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

Features features_of(const Scene& scene) {
  Features has;
  add_tools(scene, has);
  add_body(scene, has);
  add_numerics(scene, has);
  add_output(scene, has);
  return has;
}

std::optional<Report> clash_of(const Scene& scene, Feature driver) {
  Features has = features_of(scene);
  has.set(driver);
  // The scheme is the model's, which check_materials() checks.
  if (driver == Feature::solve || driver == Feature::solve_in_memory || driver == Feature::session)
    has.erase(Feature::converging_scheme);
  return clash_in(has, scene);
}

void check_pairs(const Scene& scene, Feature driver) {
  if (std::optional<Report> report = clash_of(scene, driver)) throw UsageError(*std::move(report));
}

void check_pair(const Scene& scene, Feature feature, Feature other) {
  if (!features_of(scene).has(feature)) return;
  for (const Clash& row : clashes()) {
    if (row.feature == feature && row.other.has(other)) throw UsageError(report_of(row, scene, other));
    if (row.feature == other && row.other.has(feature)) throw UsageError(report_of(row, scene, feature));
  }
}

std::string why_without(const Scene& scene, Feature requested) {
  const Clash* row = reason_in(features_of(scene), requested);
  return row ? row->why : "";
}

void check_materials(const Scene& scene, const Scheme& scheme) {
  const Feature its = scheme.pressure_patches ? Feature::converging_scheme : Feature::paper_scheme;
  for (const Feature feature : {Feature::tissues, Feature::other_law, Feature::printed_stress})
    check_pair(scene, feature, its);
}

std::string pairs_in_words() {
  std::string text;
  for (std::size_t k = 0; k < feature_count; ++k) {
    const Feature feature = feature_at(k);
    std::string rows;
    for (const Clash& row : clashes())
      if (row.feature == feature)
        rows += fmt::format("  not with   {}\n             {}\n", names_in_words(row.other), row.why);
    for (const Need& need : needs())
      if (need.feature == feature) rows += fmt::format("  needs      {}\n", words_of(need.needs).name);
    if (!rows.empty()) text += fmt::format("{}\n{}\n", words_of(feature).name, rows);
  }
  return text;
}

}  // namespace dimple
