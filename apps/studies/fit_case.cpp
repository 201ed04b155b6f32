#include "apps/studies/fit_case.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "apps/run/tool.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

// Options that follow from the curve are refused if given as flags. A file of all options states them too,
// and is overruled.
void refuse_given(const Description& described, const std::vector<std::string>& keys,
                  const std::string& what) {
  for (const std::string& key : keys)
    if (const std::string source = source_of(described, key); source.starts_with("--"))
      throw UsageError({.fact = fmt::format("{} is given, and follows from the curve", key),
                        .where = source,
                        .why = what,
                        .remedy = "leave it out"});
}

void require_long_tool(const std::optional<ToolShape>& tool, double depth_mm, const MeasuredCurve& curve) {
  if (const double length = tool ? tool->length : std::numeric_limits<double>::infinity();
      1e-3 * depth_mm > length)
    throw InputError(
        {.fact = fmt::format("the curve goes to {}, and the tool is {} long",
                             length_in_words(1e3 * curve.depth.back()), length_in_words(1e3 * length)),
         .where = curve.name,
         .why = "the holder at its upper end is not modelled",
         .remedy = "fit a shallower part of the curve, or give the tool that it was measured with",
         .code = "bad-curve"});
}

[[noreturn]] void refuse_fit(const std::string& why) {
  throw UsageError(
      {.fact = "the modulus of this case cannot be fitted to a force",
       .where = "dimple fit",
       .why = "the fit needs a force that is proportional to the modulus: " + why,
       .remedy =
           "fit one tissue of neo-Hookean, Ogden's or Gent's law in equilibrium (--time quasi-static)"});
}

}  // namespace

// A row for each set; its search stands in searches_of(), its member of the scene in with_numbers().
const FitNumbers& fit_numbers(const std::string& of) {
  static const std::vector<FitNumbers> all = {
      {"mu", "a modulus alone", {}},
      {mu_and_contact, "with the place of first contact", {}},
      {"mu,alpha", "with Ogden's exponent", {"material.ogden_mu_Pa", "material.ogden_alpha"}},
      {"mu,limit", "with the limit of Gent's law", {"material.gent_limit"}},
      {"mu,g,tau", "with one Prony term", {"material.prony_g", "material.prony_tau_s"}}};
  std::string names, words;
  for (const FitNumbers& numbers : all) {
    if (of == numbers.of) return numbers;
    const std::string between = names.empty() ? "" : &numbers == &all.back() ? " or " : ", ";
    names += between + numbers.of, words += between + numbers.words;
  }
  throw UsageError({.fact = fmt::format("--of {} is not allowed", of),
                    .where = "--of",
                    .why = "a curve may determine " + words,
                    .remedy = "use " + names});
}

void refuse_paper_values(const std::filesystem::path& curve) {
  if (curve != paper_word) return;
  throw UsageError({.fact = "the published values are three end values of two hemispheres, not a curve",
                    .where = "--curve",
                    .why = "they serve for comparison only",
                    .remedy = "dimple run IMAGE -o OUT --compare horton2007"});
}

bool takes_one_run(const std::string& of) {
  return of == "mu" || of == mu_and_contact;
}

Description case_of(const Description& described, const Scene& given, const FitOptions& options,
                    const MeasuredCurve& curve) {
  check_pairs(given, Feature::fit);
  refuse_given(described, {"load.depth_mm"}, "the run is as deep as the curve");
  refuse_given(described, {"material.mu_Pa", "material.young_Pa", "material.mu_spread_percent"},
               "the modulus is the unknown");
  Description own = described;
  put_numbers(own, "material.mu_spread_percent", {0.0});
  const double depth_mm =
      1e3 * (curve.depth.back() +
             (options.of == mu_and_contact ? farthest_first_contact(curve.depth.back()) : 0.0));
  put_numbers(own, "load.depth_mm", {depth_mm}, curve.name);
  require_long_tool(given.tool, depth_mm, curve);
  if (!curve.time.empty()) {
    refuse_given(described, {"load.rate_mm_per_s"}, "the curve has times");
    put_numbers(own, "load.rate_mm_per_s", {1e3 * ramp_rate(curve)}, curve.name);
  }
  if (takes_one_run(options.of) && !given.given.nodes)
    put_numbers(own, "cloud.nodes", {nodes_for_one_run}, "the fit needs one run only");
  refuse_given(described, fit_numbers(options.of).keys, "they are the unknowns");
  if (options.of == "mu,g,tau") ramp_rate(curve);  // throws where the curve has no times
  return own;
}

void multiply(Scene& scene, double factor) {
  scene.material.mu_Pa *= factor;
  for (double& mu : scene.material.ogden_mu_Pa) mu *= factor;
}

void require_no_inertia(const Scene& given, const Scene& found, const Result& result) {
  // A contacting tool is slow unless its rate is given.
  if (given.solver.time != Scene::Numerics::Time::automatic ||
      (result.loading.indenter && !found.given.rate) ||
      choose_time(result.model, {materials_of(found), result.tissues.of_point}, result.loading) ==
          TimeMode::quasi_static)
    return;
  refuse_fit(fmt::format("with the fitted {} the load is so short that inertia is not negligible",
                         stress_in_words(material_of(found).mu)));
}

Scene with_numbers(Scene scene, const std::string& of, const std::vector<double>& numbers) {
  auto& m = scene.material;
  if (of == "mu,alpha") m.ogden_mu_Pa = {m.mu_Pa}, m.ogden_alpha = {numbers[0]};
  if (of == "mu,limit") m.gent_limit = numbers[0];
  if (of == "mu,g,tau") m.prony_g = {numbers[0]}, m.prony_tau_s = {numbers[1]};
  return scene;
}

std::vector<std::vector<FitParameter>> searches_of(const std::string& of, const MeasuredCurve& curve) {
  if (of == "mu") return {{}};
  if (of == mu_and_contact) {
    const double far = 1e3 * farthest_first_contact(curve.depth.back());
    return {{{.name = "touch", .unit = "mm", .start = 0.0, .least = -far, .most = far, .is_place = true}}};
  }
  if (of == "mu,alpha") {
    const FitParameter positive{
        .name = "alpha", .unit = "", .start = 2.0, .least = 0.5, .most = 30.0, .logarithmic = true};
    const FitParameter negative{
        .name = "alpha", .unit = "", .start = -4.7, .least = -0.5, .most = -30.0, .logarithmic = true};
    return {{negative}, {positive}};
  }
  if (of == "mu,limit")
    return {
        {{.name = "limit", .unit = "", .start = 2.0, .least = 0.005, .most = 200.0, .logarithmic = true}}};
  const double duration = curve.depth.back() / ramp_rate(curve);
  return {{{.name = "g", .unit = "", .start = 0.5, .least = 0.01, .most = 0.99},
           {.name = "tau",
            .unit = "s",
            .start = 0.3 * duration,
            .least = 0.01 * duration,
            .most = 100.0 * duration,
            .logarithmic = true}}};
}

// `auto` is quasi-static here: require_no_inertia() decides once the modulus is known.
Result march(Scene scene, bool error_bounds) {
  using Time = Scene::Numerics::Time;
  if (scene.solver.time == Time::automatic) scene.solver.time = Time::quasi_static;
  RunObserver observer;
  observer.march.sample = [](const ForceSample&, const History&) {
    stop_if_requested();
    return true;
  };
  Result result = simulate({.scene = scene, .error_bounds = error_bounds}, observer);
  if (result.history.interrupted) throw Stopped(stop_requested());
  return result;
}

void add_new(std::vector<std::string>& list, const std::vector<std::string>& more) {
  for (const std::string& line : more)
    if (std::find(list.begin(), list.end(), line) == list.end()) list.push_back(line);
}

std::vector<double> forces_later(const ForceCurve& curve, std::vector<double> depth, double later) {
  for (double& d : depth) d = std::max(0.0, d - later);
  return curve.contacting ? contact_forces(curve.force, depth) : forces_between(curve.force, depth);
}

ForceCurve force_curve_of(const Result& result) {
  return {.contacting = result.loading.indenter != nullptr, .force = result.history.force};
}

// Relative half-width of the force's error bounds, as it affects the fit. For the bonded patch, the largest
// at any depth: error bounds at a smaller depth affect the modulus as much. A contacting tool has few nodes
// under it at first, and hardly any force, so its rows are weighted.
double fraction_of_error_bounds(const Result& result, const MeasuredCurve& curve, const CurveFit& fit) {
  if (!result.error_bounds.known()) return 0.0;
  const std::vector<ForceSample>& samples = result.history.force;
  if (result.loading.indenter) {
    std::vector<double> fraction = halves_between(samples, result.error_bounds.half, curve.depth);
    const std::vector<double> force = forces_between(samples, curve.depth);
    for (std::size_t k = 0; k < fraction.size(); ++k) fraction[k] /= std::abs(force[k]);
    return weighted_fraction(fraction, fit.force);
  }
  double fraction = 0.0;
  for (std::size_t k = 0; k < samples.size(); ++k)
    if (const ForceSample& s = samples[k]; s.depth > 0.0)
      fraction = std::max(fraction, result.error_bounds.half[k] / std::abs(s.force));
  return fraction;
}

}  // namespace dimple
