#include "apps/run/run_words.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "apps/run/loads.hpp"
#include "apps/run/membranes.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/verdict.hpp"
#include "apps/run/words.hpp"

namespace dimple {
namespace {

std::string crossings_in_words(double crossings) {
  return crossings < 1.0
             ? fmt::format("the load lasts {} of the travel time of a shear wave through the organ",
                           percent(crossings))
             : fmt::format("the load lasts {} times the travel time of a shear wave through the organ",
                           three_digits(crossings));
}

// "neo-Hookean, mu 210 Pa, nu 0.49; label 2: neo-Hookean, mu 3000 Pa, nu 0.49".
std::string moduli_in_words(const Scene& scene, const Tissues& tissues) {
  std::vector<std::string> words;
  auto own = scene.tissues.begin();
  for (std::size_t t = 0; t < tissues.material.size(); ++t) {
    const Material& m = tissues.material[t];
    words.push_back(fmt::format("{}{}, mu {}, nu {}", t == 0 ? "" : fmt::format("label {}: ", (own++)->label),
                                words_of(m).title, stress_in_words(m.mu), plain(poisson_ratio(m), 4)));
  }
  return fmt::format("{}", fmt::join(words, "; "));
}

// Loads on the body and its surface before the tool moves, and the preload displacement.
std::string loads_and_films_in_words(const Result& result) {
  const Loads& loads = result.loading.loads;
  std::vector<std::string> words;
  if (const std::string text = in_words(loads); !text.empty()) words.push_back(text);
  for (const Membrane& film : loads.membrane) words.push_back("membrane " + in_words(film));
  if (loads.move_the_body())
    words.push_back(fmt::format("preload: largest displacement {}",
                                length_in_words(1e3 * result.history.preload_displacement)));
  return fmt::format("{}", fmt::join(words, "; "));
}

std::string supports_in_words(const std::vector<HeldSet>& supports) {
  std::vector<std::string> words;
  for (const HeldSet& one : supports)
    words.push_back(fmt::format("{}, {} nodes {}", one.name, one.node.size(),
                                one.hold == HeldSet::Hold::along ? "sliding" : "fixed"));
  return fmt::format("{}", fmt::join(words, "; "));
}

std::string cuts_in_words(const LoadedModel& result) {
  const double area = result.cut.area_mm2, removed = result.cut.removed_mm3;
  std::vector<std::string> words;
  if (area > 0.0) words.push_back(fmt::format("{} mm2", three_digits(area)));
  if (removed > 0.0) words.push_back(volume_in_words(removed) + " removed");
  for (const LabelMeasure& label : result.cut.labels)
    words.push_back("label " + in_words(label) + " removed");
  return fmt::format("{}", fmt::join(words, ", "));
}

std::string steps_in_words(const Loading& loading) {
  std::vector<std::string> words;
  for (const Step& step : loading.steps) words.push_back(in_words(step));
  return fmt::format("{}", fmt::join(words, "; "));
}

}  // namespace

std::vector<std::string> scene_in_words(const Scene& scene, const Result& result) {
  const Loading& loading = result.loading;
  std::vector<std::string> lines;
  const auto add = [&](const char* name, const std::string& words) {
    if (!words.empty()) lines.push_back(fmt::format("{}: {}", name, words));
  };
  add("material", moduli_in_words(scene, result.tissues));
  add("contact",
      loading.indenter ? friction_in_words(loading.indenter->friction) : std::string(name_of(scene.contact)));
  add("loads", loads_and_films_in_words(result));
  add("supports", supports_in_words(loading.further));
  add("cut", cuts_in_words(result));
  add("steps", steps_in_words(loading));
  return lines;
}

std::string nodes_for_error_bounds_in_words(Index nodes, Index usual, double facing_fraction) {
  return fmt::format(
      "nodes    {} instead of {}, as none were given: {:.0f} % of the surface faces another part of it, and "
      "error bounds of such a body need at least {} nodes",
      nodes, usual, 100.0 * facing_fraction, nodes);
}

std::string nodes_for_edge_in_words(Index nodes, Index usual) {
  return fmt::format("nodes    {} instead of {}, as none were given: tools with edges need finer nodes",
                     nodes, usual);
}

void report_supports(const RunLog& log, const Model& model) {
  const SupportReport& support = model.support_report;
  const ConsistencyReport& consistency = model.consistency_report;
  log.detail(fmt::format(
      "support  radius {:.2f} spacings: {} to {} nodes per point, mean {:.1f}; {} grown for conditioning",
      model.scheme.support.radius_factor, support.fewest, support.most, support.mean, support.grown));
  log.detail(fmt::format("support  linear fields reproduced to {:.1e}; worst pivot ratio {:.1e}",
                         support.linear_error, support.worst_pivot_ratio));
  if (consistency.iterations > 0)
    log.detail(fmt::format(
        "patch    forces of a constant pressure: {:.1e} off before, {:.1e} after a change of gradients by at "
        "most {:.2f} of a cell's largest",
        consistency.before, consistency.after, consistency.largest_change));
  if (support.unseen > 0)
    log.detail(
        fmt::format("folds    {} pairs of a node and a point across a gap are separated; {} points have too "
                    "few nodes and use the nearest ones",
                    support.unseen, support.unconnected.size()));
  else if (model.scheme.consistent_gradients && model.surface.empty())
    log.warn("without a surface the gradients are not made consistent: forces at high pressure are too low");
  log.detail(fmt::format("mass     {} g in all, {} to {} g per node", three_digits(model.mass.sum() * 1e3),
                         three_digits(model.mass.minCoeff() * 1e3),
                         three_digits(model.mass.maxCoeff() * 1e3)));
}

std::vector<Material> in_use(const Tissues& tissues) {
  std::vector<char> met(tissues.material.size(), 0);
  for (const int tissue : tissues.of_point) met[static_cast<std::size_t>(tissue)] = 1;
  std::vector<Material> result;
  for (std::size_t t = 0; t < met.size(); ++t)
    if (met[t]) result.push_back(tissues.material[t]);
  return result;
}

std::string describe(const Tissues& tissues, std::size_t t, const std::string& label) {
  const Material& m = tissues.material[t];
  const LawWords words = words_of(m);
  std::string law = words.title;
  for (const auto& term : words.terms) {
    std::vector<std::string> numbers;
    for (const auto& [name, value] : term)
      numbers.push_back(name.ends_with("_Pa") ? stress_in_words(value) : plain(value));
    law += fmt::format(" ({})", fmt::join(numbers, ", "));
  }
  for (const PronyTerm& term : m.prony)
    law += fmt::format(", {} relaxing in {} s", plain(term.g), plain(term.tau));
  return fmt::format("material {}{}: mu {}, nu {}, density {} kg/m3",
                     t == 0 ? ""
                            : fmt::format("of label {}, {} points, ", label,
                                          (tissues.of_point.array() == static_cast<int>(t)).count()),
                     law, stress_in_words(m.mu), plain(poisson_ratio(m)), plain(m.density));
}

std::string time_in_words(TimeMode mode, double crossings, bool shallow) {
  return fmt::format(
      "time     {}: {}{}", mode == TimeMode::explicit_ ? "explicit dynamics" : "quasi-static",
      crossings_in_words(crossings),
      shallow ? "; the load is short, but its tool is slow; --time explicit resolves the waves" : "");
}

void ask_for_units(const RunLog& log, const Scene& scene, const LoadedModel& result) {
  constexpr double shallowest_mm = 0.05, softest_Pa = 5.0, thinnest_film_mm = 0.005, softest_film_Pa = 1e3;
  const auto ask = [&](const std::string& what, const std::string& least, const std::string& option,
                       const char* unit) {
    log.warn(fmt::format("{} is less than {}: check the units of {}: a bare number is in {}", what, least,
                         option, unit));
  };
  if (scene.depth_mm < shallowest_mm)
    ask("a depth of " + length_in_words(scene.depth_mm), length_in_words(shallowest_mm),
        scene.steps.empty() ? "--depth (load.depth_mm)" : "the steps", "mm");
  for (const Material& tissue : in_use(result.tissues))
    if (tissue.mu < softest_Pa)
      ask("a shear modulus of " + stress_in_words(tissue.mu), stress_in_words(softest_Pa),
          "the material (--mu, --young)", "Pa");
  for (const Membrane& film : result.loading.loads.membrane) {
    if (!(film.shear_modulus > 0.0)) continue;  // tension only
    const std::string option = fmt::format("the membrane '{}'", film.name);
    if (1e3 * film.thickness < thinnest_film_mm)
      ask(fmt::format("a film of {}", length_in_words(1e3 * film.thickness)),
          length_in_words(thinnest_film_mm), option, "mm");
    if (film.shear_modulus < softest_film_Pa)
      ask(fmt::format("a film's shear modulus of {}", stress_in_words(film.shear_modulus)),
          stress_in_words(softest_film_Pa), option, "Pa");
  }
}

void warn_of_inertia(const RunLog& log, const Result& result) {
  if (result.time == TimeMode::quasi_static || result.history.force.empty()) return;
  const ForceSample& last = result.history.force.back();
  const double off = std::abs(last.base_force - last.force);
  if (!(off > inertia_to_check * std::abs(last.force))) return;
  log.warn(
      fmt::format("the force includes inertia: {} on the tool at the end, {} on the base; {}; give a lower "
                  "--rate, or --time quasi-static for the force of equilibrium",
                  force_in_words(last.force), force_in_words(last.base_force),
                  crossings_in_words(shear_crossings(result.model, result.tissues, result.loading))));
}

std::string level_in_words(int number, const RefinementLevel& level, bool has_displacement) {
  const auto width = [](double half, double of) {
    return half > 0.0 ? " +- " + percent(half / of) : std::string();
  };
  return fmt::format("refine   level {}, {} nodes: {}{}{}, {:.1f} s", number, level.nodes,
                     force_in_words(level.force), width(level.half, std::abs(level.force)),
                     has_displacement ? fmt::format(", {} mm{}", three_digits(1e3 * level.length),
                                                    width(level.half_length, level.length))
                                      : "",
                     level.seconds);
}

std::string failure_in_words(int number, Index nodes, const std::string& fact) {
  return fmt::format("refine   level {}, {} nodes: {}", number, nodes, fact);
}

std::string in_words(const RefinementEnd& end, const Goal& goal) {
  switch (end.why) {
    case RefinementEnd::Why::stopped:
      return "the run was stopped";
    case RefinementEnd::Why::failed:
      return fmt::format("with {} nodes: {}", end.nodes, end.fact);
    case RefinementEnd::Why::out_of_time:
      return fmt::format("{} nodes would need about {:.0f} s more, beyond the {:g} s given", end.nodes,
                         end.seconds, goal.budget_s);
    case RefinementEnd::Why::too_many_nodes:
      return fmt::format("more than {} nodes are not tried", most_nodes_for_accuracy);
  }
  return "";
}

std::string shortfall_in_words(const std::string& requested, std::optional<double> fraction,
                               const std::string& ended) {
  return fmt::format("the requested accuracy, {}, was not reached: {}; {}", requested,
                     fraction ? "the error is +- " + percent(*fraction) : "the error is unknown so far",
                     ended);
}

std::string next_half_in_words(const Refinement& refinement, Index more) {
  const Index nodes = refinement.finest->result.model.node_count();
  const double more_s = refinement.finest->seconds * static_cast<double>(more) / static_cast<double>(nodes);
  return fmt::format("refine   {} nodes in {:.1f} s; half the error needs about {} nodes and {:.0f} s", nodes,
                     refinement.seconds, (more + 50) / 100 * 100, more_s + refinement.seconds);
}

}  // namespace dimple
