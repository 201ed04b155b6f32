#include "apps/studies/fit_results.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "apps/run/results.hpp"
#include "apps/run/summary.hpp"
#include "io/digits.hpp"
#include "io/draw/chart.hpp"
#include "io/file.hpp"
#include "io/table.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

std::string plus_minus(double half, const FittedNumber& f) {
  if (f.scale > 0.0) return fmt::format("+-{} {}", plain(half, 2), f.unit);
  return fmt::format("+-{:.1f} %", 100.0 * half / std::abs(f.value));
}

std::string with_unit(double value, const std::string& unit) {
  return plain(value, 4) + (unit.empty() ? "" : " " + unit);
}

// Number as text: "mu 231 Pa, 221 to 241 (noise +-1.2 %, discretisation +-3.1 %)"
std::string in_words(const FittedNumber& f, const std::string& unknown) {
  if (!f.determined)
    return fmt::format("{} is not determined by this curve (best {})", f.name, with_unit(f.value, f.unit));
  const std::string from_to = fmt::format("{} {}, {} to {}", f.name, with_unit(f.value, f.unit),
                                          plain(f.value - f.half(), 4), plain(f.value + f.half(), 4));
  if (!unknown.empty())
    return fmt::format("{} by noise only ({}; discretisation unknown)", from_to, plus_minus(f.noise, f));
  return fmt::format("{} (noise {}, discretisation {})", from_to, plus_minus(f.noise, f),
                     plus_minus(f.discretisation, f));
}

// "mu 217 to 248 Pa with the first touch 0.10 mm off"; empty if first contact was sought itself.
std::string first_contact_in_words(const FittedNumber& f, double off) {
  if (std::isnan(f.earlier)) return {};
  const auto [low, high] = std::minmax(f.earlier, f.later);
  return fmt::format("{} {} to {}{} with the first contact {} off", f.name, plain(low, 4), plain(high, 4),
                     f.unit.empty() ? "" : " " + f.unit, length_in_words(1e3 * off));
}

std::string in_words(const HalfSpaceCheck& check, double mu) {
  return fmt::format(
      "check    the formula of Hertz and Sneddon for a half-space without friction gives {} from this curve, "
      "{:+.1f} %. It neglects the body's shape and large strain, and is too high on a thin layer; here the "
      "body is {:.3g} contact radii thick",
      stress_in_words(check.mu), 100.0 * (check.mu / mu - 1.0), check.thickness);
}

// Sentences on each number, then on the effect of an error in the first contact on each.
std::vector<std::string> in_words(const FoundFit& found, double off_contact) {
  std::vector<std::string> words;
  for (const FittedNumber& f : found.fit.number)
    words.push_back(in_words(f, found.result.error_bounds.unknown));
  for (const FittedNumber& f : found.fit.number)
    if (const std::string text = first_contact_in_words(f, off_contact); !text.empty()) words.push_back(text);
  return words;
}

// Measured forces minus those of the model [N].
std::vector<double> residuals(const MeasuredCurve& curve, const CurveFit& fit) {
  std::vector<double> residual = curve.force;
  for (std::size_t k = 0; k < residual.size(); ++k) residual[k] -= fit.force[k];
  return residual;
}

std::vector<Chart> charts_of(const MeasuredCurve& curve, const FoundFit& found,
                             const std::vector<std::string>& words) {
  const CurveFit& fit = found.fit;
  const Written axis = force_written(largest_force(curve));
  const double unit = axis.per_unit;
  const std::string in_unit = fmt::format("[{}]", axis.unit);
  const std::vector<double> depth_mm = scaled(curve.depth, 1e3);
  std::vector<double> zero_and_depths = depth_mm, zero_and_forces = scaled(fit.force, unit);
  zero_and_depths.insert(zero_and_depths.begin(), 0.0);
  zero_and_forces.insert(zero_and_forces.begin(), 0.0);
  return {{.title = fmt::format("{} fitted to {}", fs::path(found.scene.image.file).filename().string(),
                                curve.name),
           .subtitle = words,
           .x_label = "indentation [mm]",
           .y_label = "force " + in_unit,
           .series = {{.name = "measured", .x = depth_mm, .y = scaled(curve.force, unit), .line = false},
                      {.name = "model", .x = zero_and_depths, .y = zero_and_forces, .markers = false}}},
          {.title = "residuals",
           .subtitle = {fmt::format("measured - model; rms {:.2f} % of the largest force",
                                    100.0 * (fit.rms / largest_force(curve)))},
           .x_label = "indentation [mm]",
           .y_label = "residual " + in_unit,
           .series = {{.x = depth_mm, .y = scaled(residuals(curve, fit), unit), .line = false}}}};
}

// Fitted numbers as a file of options, with their sources as comments.
std::string fitted_toml(const MeasuredCurve& curve, const FoundFit& found,
                        const std::vector<std::string>& words) {
  const Scene::Material& m = found.scene.material;
  const std::map<std::string, std::map<std::string, std::vector<double>>> numbers = {
      {"mu", {{"material.mu_Pa", {m.mu_Pa}}, {"material.ogden_mu_Pa", m.ogden_mu_Pa}}},
      {"touch", {}},
      {"alpha", {{"material.ogden_alpha", m.ogden_alpha}}},
      {"limit", {{"material.gent_limit", {m.gent_limit}}}},
      {"g", {{"material.prony_g", m.prony_g}}},
      {"tau", {{"material.prony_tau_s", m.prony_tau_s}}}};
  Description options = found.options;
  put_numbers(options, "load.depth_mm", {found.scene.depth_mm});
  std::map<std::string, std::string> notes;
  for (std::size_t k = 0; k < found.fit.number.size(); ++k)
    for (const auto& [key, values] : numbers.at(found.fit.number[k].name)) {
      put_numbers(options, key, values, fmt::format("fitted to {}", curve.name));
      notes[key] = words[k];
    }
  return to_toml(options, notes);
}

constexpr const char* not_in_error_bounds =
    "the error bounds exclude the base, the place of the contact patch, the contact, the segmentation and "
    "the choice of this law";
constexpr const char* not_in_error_bounds_of_a_tool =
    "the error bounds exclude the base, the tool's place and shape, its friction, its first contact, the "
    "segmentation and the choice of this law";

Json to_json(const FittedNumber& f, bool known) {
  const auto finite = [](double x) { return std::isfinite(x) ? Json(x) : Json(); };
  return {{"value", f.value},
          {"unit", f.unit},
          {"low", finite(f.value - f.half())},
          {"high", finite(f.value + f.half())},
          {"noise_half", finite(f.noise)},
          {"discretisation_half", known ? finite(f.discretisation) : Json()},
          {"by_tilt_of_1_percent", finite(f.by_tilt)},
          {"if_touched_earlier", finite(f.earlier)},
          {"if_touched_later", finite(f.later)},
          {"determined", f.determined}};
}

const char* left_out_of_error_bounds(const FoundFit& found) {
  return found.result.loading.indenter ? not_in_error_bounds_of_a_tool : not_in_error_bounds;
}

// Writes the modulus and its errors to the summary.
void put_numbers(Json& summary, const FitOptions& options, const MeasuredCurve& curve,
                 const FoundFit& found) {
  const FittedNumber& mu = found.fit.number[0];
  const std::string& unknown = found.result.error_bounds.unknown;
  // A modulus that is not determined is null.
  const auto reported = [&](double x) { return mu.determined && std::isfinite(x) ? Json(x) : Json(); };
  summary["mu_Pa"] = reported(mu.value);
  summary["mu_low_Pa"] = reported(mu.value - mu.half());
  summary["mu_high_Pa"] = reported(mu.value + mu.half());
  summary["noise_share"] = std::isfinite(mu.noise) ? Json(mu.noise / mu.value) : Json();
  summary["discretisation_share"] = unknown.empty() ? Json(mu.discretisation / mu.value) : Json();
  if (!unknown.empty()) summary["discretisation_unknown"] = unknown;
  summary["band_of"] = unknown.empty() ? "noise and discretisation" : "noise alone";
  for (const FittedNumber& f : found.fit.number) summary["numbers"][f.name] = to_json(f, unknown.empty());
  if (options.of != mu_and_contact) {
    summary["first_touch"] = {{"off_mm", 1e3 * off_first_contact(curve.depth.back())},
                              {"mu_if_earlier_Pa", reported(mu.earlier)},
                              {"mu_if_later_Pa", reported(mu.later)}};
  }
  if (found.check)
    summary["half_space_check"] = {{"mu_Pa", found.check->mu},
                                   {"ratio", found.check->mu / mu.value},
                                   {"thickness_in_contact_radii", found.check->thickness}};
}

Json summary_of(const FitOptions& options, const MeasuredCurve& curve, const FoundFit& found) {
  Json summary;
  summary["image"] = found.scene.image.file;
  summary["curve"] = options.curve.string();
  summary["curve_sha256"] = sha256_of_file(options.curve);
  summary["status"] = "finished";
  summary["version"] = DIMPLE_VERSION;
  summary["of"] = options.of;
  put_numbers(summary, options, curve, found);
  if (found.result.loading.indenter) summary["tool"] = found.scene.tool_words.shape;
  if (found.result.loading.indenter) summary["friction"] = found.scene.tool_words.friction;
  summary["rows"] = curve.depth.size();
  summary["depth_mm"] = 1e3 * curve.depth.back();
  summary["nodes"] = found.result.model.node_count();
  summary["runs"] = found.runs;
  summary["residual_rms_N"] = found.fit.rms;
  summary["residual_memory"] = found.fit.memory;
  summary["not_in_the_band"] = left_out_of_error_bounds(found);
  summary["warnings"] = found.warnings;
  return summary;
}

}  // namespace

std::vector<double> scaled(std::vector<double> list, double factor) {
  for (double& x : list) x *= factor;
  return list;
}

double largest_force(const MeasuredCurve& curve) {
  const auto [least, most] = std::minmax_element(curve.force.begin(), curve.force.end());
  return std::max(std::abs(*least), std::abs(*most));
}

Outcome write_fit(const fs::path& folder, const FitOptions& options, const MeasuredCurve& curve,
                  const FoundFit& found) {
  write_csv(folder / "fit.csv", {.header = {"indentation_mm", "measured_N", "model_N", "residual_N"},
                                 .column = {scaled(curve.depth, 1e3), curve.force, found.fit.force,
                                            residuals(curve, found.fit)}});
  const std::vector<std::string> words = in_words(found, off_first_contact(curve.depth.back()));
  const std::vector<Chart> charts = charts_of(curve, found, words);
  for (const char* name : {"fit.png", "fit.svg"}) write_chart(folder / name, charts);
  write_file(folder / "fitted.toml", fitted_toml(curve, found, words));
  const std::string text = as_text(summary_of(options, curve, found));
  write_file(folder / "summary.json", text);
  return {.summary_json = text, .headline = fmt::format("{}", fmt::join(words, "; "))};
}

void say_fit(const MeasuredCurve& curve, const FoundFit& found,
             const std::function<void(const std::string&)>& progress) {
  for (const std::string& warning : found.warnings) progress("warning: " + warning);
  if (const std::string& unknown = found.result.error_bounds.unknown; !unknown.empty()) {
    progress("bounds   discretisation unknown: " + unknown);
    for (const FittedNumber& f : found.fit.number)
      if (f.by_tilt > 0.0 && std::isfinite(f.by_tilt))
        progress(
            fmt::format("bounds   with computed forces 1 % too large at first and 1 % too small at the end, "
                        "{} would change by {}",
                        f.name, plain(f.by_tilt, 2)));
  }
  progress(fmt::format(
      "fit      {} rows to {}, {} run{} with {} nodes, residuals {:.2f} % of the largest force (rms)",
      curve.depth.size(), length_in_words(1e3 * curve.depth.back()), found.runs, found.runs == 1 ? "" : "s",
      found.result.model.node_count(), 100.0 * (found.fit.rms / largest_force(curve))));
  if (found.check) progress(in_words(*found.check, found.fit.number[0].value));
  progress(fmt::format("note     {}", left_out_of_error_bounds(found)));
}

}  // namespace dimple
