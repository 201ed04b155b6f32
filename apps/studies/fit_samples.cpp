// Fits of many curves that were measured in one scene.
//
// 1. The run is as deep as the deepest curve. Its force is proportional to mu; a further number of the law
// has a run for
//    each value of a grid, even in its logarithm (Ogden's exponent one grid for each sign).
// 2. Forces at a curve's depths come from each run; between two values of the grid they follow the cubic
// polynomial
//    through the four nearest, in the logarithm.
// 3. Each curve is fitted by fit_curve(), as a single one is.
// 4. The half-width by discretisation is that of the run with a neo-Hookean tissue.

#include "apps/studies/fit_samples.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "apps/run/results.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/words.hpp"
#include "apps/studies/fit_case.hpp"
#include "apps/studies/fit_results.hpp"
#include "io/digits.hpp"
#include "io/draw/chart.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"

namespace dimple {
namespace {

constexpr int grid_size = 17;
constexpr int most_looks = 200;
constexpr double none = std::numeric_limits<double>::quiet_NaN();

// Runs of one search: of the scene, or of each value of its parameter for which there is an equilibrium.
struct Library {
  std::vector<FitParameter> sought;  // none, or one
  std::vector<double> at;            // logarithm of the parameter's amount, rising
  std::vector<Result> run;
  double mu = 0.0;  // [Pa] that the runs were made with
};

double log_amount(double number) {
  return std::log(std::abs(number));
}

Library library_of(const Scene& own, const std::string& of, const std::vector<FitParameter>& sought,
                   const std::function<void(const std::string&)>& progress,
                   std::vector<std::string>& warnings) {
  Library library;
  library.sought = sought;
  library.mu = own.material.mu_Pa;
  if (takes_one_run(of)) {
    library.run.push_back(march(own, own.error_bounds));
    add_new(warnings, library.run.front().warnings);
    return library;
  }
  const FitParameter& s = sought.front();
  const double least = log_amount(s.least), most = log_amount(s.most);
  for (int k = 0; k < grid_size; ++k) {
    const double at = least + (most - least) * k / (grid_size - 1);
    const double number = std::copysign(std::exp(at), s.start);
    try {
      library.run.push_back(march(with_numbers(own, of, {number}), false));
      library.at.push_back(at);
      add_new(warnings, library.run.back().warnings);
      progress(fmt::format("run      {} {:.4g}", s.name, number));
    } catch (const SolveError& error) {
      progress(fmt::format("run      {} {:.4g} is left out: {}", s.name, number, error.report.fact));
    }
  }
  if (library.at.size() < 4) library = {};
  return library;
}

// Forces at a curve's depths with a modulus of 1 Pa, as fit_curve() requests them.
class ForcesOf {
 public:
  ForcesOf(const Library& library, const MeasuredCurve& curve) : library_(library), curve_(curve) {
    for (const Result& run : library.run) of_run_.push_back(at_depths(run, 0.0));
  }

  std::vector<double> operator()(const std::vector<double>& numbers) const {
    if (numbers.empty()) return of_run_.front();
    if (library_.at.empty()) return at_depths(library_.run.front(), 1e-3 * numbers[0]);
    return between(log_amount(numbers[0]));
  }

 private:
  std::vector<double> at_depths(const Result& run, double later) const {
    return scaled(forces_later(run, curve_.depth, later), 1.0 / library_.mu);
  }

  // Lagrange's polynomial through the four nearest values of the grid.
  std::vector<double> between(double x) const {
    const std::vector<double>& at = library_.at;
    const auto above = static_cast<std::ptrdiff_t>(std::lower_bound(at.begin(), at.end(), x) - at.begin());
    const auto first = static_cast<std::size_t>(
        std::clamp<std::ptrdiff_t>(above - 2, 0, static_cast<std::ptrdiff_t>(at.size()) - 4));
    std::vector<double> force(curve_.depth.size(), 0.0);
    for (std::size_t k = first; k < first + 4; ++k) {
      double weight = 1.0;
      for (std::size_t j = first; j < first + 4; ++j)
        if (j != k) weight *= (x - at[j]) / (at[k] - at[j]);
      for (std::size_t row = 0; row < force.size(); ++row) force[row] += weight * of_run_[k][row];
    }
    return force;
  }

  const Library& library_;
  const MeasuredCurve& curve_;
  std::vector<std::vector<double>> of_run_;
};

// The best fit of one curve over all searches; nothing where it has none.
std::optional<CurveFit> best_fit(const std::vector<Library>& libraries, const Result& neo_hookean,
                                 double fraction, const MeasuredCurve& curve) {
  std::optional<CurveFit> best;
  for (const Library& library : libraries) try {
      const ForcesOf forces(library, curve);
      std::vector<FitParameter> sought = library.sought;
      if (!library.at.empty()) {  // within the grid that has an equilibrium
        sought[0].least = std::copysign(std::exp(library.at.front()), sought[0].start);
        sought[0].most = std::copysign(std::exp(library.at.back()), sought[0].start);
      }
      CurveFit fit = fit_curve(curve.depth, curve.force, sought, forces, most_looks);
      if (!best || fit.sum2 < best->sum2) best = std::move(fit);
    } catch (const InputError&) {  // no positive modulus
    }
  if (!best) return best;
  const bool known = neo_hookean.error_bounds.known();
  if (known) add_discretisation(*best, curve.depth, fraction);
  conclude(*best, known);
  return best;
}

double quantile(std::vector<double> list, double q) {
  std::erase_if(list, [](double x) { return !std::isfinite(x); });
  if (list.empty()) return none;
  std::sort(list.begin(), list.end());
  const double at = q * static_cast<double>(list.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const double remaining = at - static_cast<double>(below);
  return below + 1 < list.size() ? (1.0 - remaining) * list[below] + remaining * list[below + 1]
                                 : list.back();
}

Table table_of(const std::vector<std::optional<CurveFit>>& fits, const std::vector<MeasuredCurve>& curves,
               const std::vector<FitParameter>& sought) {
  Table table{.header = {"sample", "mu_Pa", "mu_low_Pa", "mu_high_Pa"}, .column = {}};
  for (const FitParameter& s : sought) {
    const std::string unit = s.unit.empty() ? "" : "_" + s.unit;
    table.header.insert(table.header.end(), {s.name + unit, s.name + "_low" + unit, s.name + "_high" + unit});
  }
  table.header.insert(table.header.end(), {"determined", "rms_N", "rms_of_largest_force"});
  table.column.resize(table.header.size());
  for (std::size_t k = 0; k < fits.size(); ++k) {
    std::vector<double> row{curves[k].sample};
    bool determined = fits[k].has_value();
    for (std::size_t n = 0; n < 1 + sought.size(); ++n) {
      if (!fits[k]) {
        row.insert(row.end(), {none, none, none});
        continue;
      }
      const FittedNumber& f = fits[k]->number[n];
      row.insert(row.end(), {f.value, f.value - f.half(), f.value + f.half()});
      determined = determined && f.determined;
    }
    const double rms = fits[k] ? fits[k]->rms : none;
    row.insert(row.end(), {determined ? 1.0 : 0.0, rms, rms / largest_force(curves[k])});
    for (std::size_t c = 0; c < row.size(); ++c) table.column[c].push_back(row[c]);
  }
  return table;
}

// Share of the samples whose number is below x, as a curve.
ChartSeries distribution(std::vector<double> list) {
  std::erase_if(list, [](double x) { return !std::isfinite(x); });
  std::sort(list.begin(), list.end());
  ChartSeries series{.markers = false};
  for (std::size_t k = 0; k < list.size(); ++k) {
    series.x.push_back(list[k]);
    series.y.push_back((static_cast<double>(k) + 0.5) / static_cast<double>(list.size()));
  }
  return series;
}

// Mean residual over all samples, in bins of depth.
ChartSeries mean_residual(const std::vector<std::optional<CurveFit>>& fits,
                          const std::vector<MeasuredCurve>& curves) {
  constexpr std::size_t bins = 20;
  std::vector<double> sum(bins, 0.0), count(bins, 0.0);
  for (std::size_t k = 0; k < fits.size(); ++k)
    for (std::size_t row = 0; fits[k] && row < curves[k].depth.size(); ++row) {
      const double fraction = curves[k].depth[row] / curves[k].depth.back();
      const auto bin = std::min(bins - 1, static_cast<std::size_t>(fraction * bins));
      sum[bin] += (curves[k].force[row] - fits[k]->force[row]) / largest_force(curves[k]);
      count[bin] += 1.0;
    }
  ChartSeries series;
  for (std::size_t b = 0; b < bins; ++b) {
    series.x.push_back((static_cast<double>(b) + 0.5) / bins);
    series.y.push_back(count[b] > 0.0 ? 100.0 * sum[b] / count[b] : none);
  }
  return series;
}

std::vector<Chart> charts_of(const std::string& name, const Table& table,
                             const std::vector<FitParameter>& sought,
                             const std::vector<std::optional<CurveFit>>& fits,
                             const std::vector<MeasuredCurve>& curves) {
  std::vector<Chart> charts{{.title = fmt::format("shear modulus of {} samples of {}", curves.size(), name),
                             .x_label = "mu [Pa]",
                             .y_label = "fraction of samples below",
                             .series = {distribution(*table.find("mu_Pa"))}}};
  for (const FitParameter& s : sought)
    charts.push_back({.title = s.name,
                      .x_label = s.unit.empty() ? s.name : fmt::format("{} [{}]", s.name, s.unit),
                      .y_label = "fraction of samples below",
                      .series = {distribution(table.column[4])}});
  charts.push_back({.title = "mean residual",
                    .subtitle = {fmt::format("measured - model; median rms {:.2f} % of the largest force",
                                             100.0 * quantile(*table.find("rms_of_largest_force"), 0.5))},
                    .x_label = "indentation / largest indentation",
                    .y_label = "residual [% of the largest force]",
                    .series = {mean_residual(fits, curves)}});
  return charts;
}

Json spread_of(const std::vector<double>& list) {
  Json json;
  for (const auto& [name, q] : {std::pair("low_95", 0.025),
                                {"quarter", 0.25},
                                {"median", 0.5},
                                {"three_quarters", 0.75},
                                {"high_95", 0.975}}) {
    const double value = quantile(list, q);
    json[name] = std::isfinite(value) ? Json(value) : Json();
  }
  return json;
}

}  // namespace

Outcome fit_samples(const Description& described, const FitOptions& options,
                    const std::vector<MeasuredCurve>& curves, ResultFolder& results,
                    const std::filesystem::path& folder,
                    const std::function<void(const std::string&)>& progress) {
  if (options.of == "mu,g,tau")
    throw UsageError({.fact = "a Prony term is sought for many samples",
                      .where = "--of",
                      .why = "relaxation times need a run for each sample",
                      .remedy = "fit one sample at a time"});
  const MeasuredCurve& deepest =
      *std::max_element(curves.begin(), curves.end(),
                        [](const auto& a, const auto& b) { return a.depth.back() < b.depth.back(); });
  const Scene given = resolve(described);
  const Description own = case_of(described, given, options, deepest);
  const Scene scene = resolve(own);
  std::vector<std::string> warnings;
  std::vector<Library> libraries;
  for (const std::vector<FitParameter>& sought : searches_of(options.of, deepest)) {
    Library library = library_of(scene, options.of, sought, progress, warnings);
    if (!library.run.empty()) libraries.push_back(std::move(library));
  }
  if (libraries.empty())
    throw SolveError({.fact = "fewer than four values of the number sought have an equilibrium",
                      .where = "--of " + options.of,
                      .why = "the fits interpolate between runs",
                      .remedy = "fit shallower curves, or use more --nodes"});
  std::optional<Result> own_run;
  if (!takes_one_run(options.of)) own_run = march(scene, scene.error_bounds);
  const Result& neo_hookean = own_run ? *own_run : libraries.front().run.front();
  double fraction = 0.0;
  std::vector<std::optional<CurveFit>> fits;
  for (const MeasuredCurve& curve : curves) {
    stop_if_requested();
    if (fraction == 0.0) {  // of the deepest, by the forces of the run
      CurveFit of_run;
      of_run.force = forces_later(neo_hookean, deepest.depth, 0.0);
      fraction = fraction_of_error_bounds(neo_hookean, deepest, of_run);
    }
    fits.push_back(best_fit(libraries, neo_hookean, fraction, curve));
  }
  const std::vector<FitParameter>& sought = libraries.front().sought;
  const Table table = table_of(fits, curves, sought);
  const std::vector<double>& determined = *table.find("determined");
  const auto without = std::count(fits.begin(), fits.end(), std::nullopt);

  results.prepare();
  write_csv(folder / "fits.csv", table);
  const std::string name = options.curve.filename().string();
  for (const char* file : {"fits.png", "fits.svg"})
    write_chart(folder / file, charts_of(name, table, sought, fits, curves));
  Json summary;
  summary["image"] = scene.image.file;
  summary["curve"] = options.curve.string();
  summary["curve_sha256"] = sha256_of_file(options.curve);
  summary["status"] = "finished";
  summary["version"] = DIMPLE_VERSION;
  summary["of"] = options.of;
  summary["samples"] = curves.size();
  summary["samples_without_fit"] = without;
  summary["samples_determined"] = std::count(determined.begin(), determined.end(), 1.0);
  summary["mu_Pa"] = spread_of(*table.find("mu_Pa"));
  for (const FitParameter& s : sought) summary["numbers"][s.name] = spread_of(table.column[4]);
  summary["rms_of_largest_force"] = spread_of(*table.find("rms_of_largest_force"));
  summary["discretisation_share"] = neo_hookean.error_bounds.known() ? Json(fraction) : Json();
  summary["nodes"] = neo_hookean.model.node_count();
  summary["warnings"] = warnings;
  const std::string text = as_text(summary);
  write_file(folder / "summary.json", text);
  for (const std::string& warning : warnings) progress("warning: " + warning);
  std::string headline = fmt::format("{} samples: median mu {}, half of them {} to {}", curves.size(),
                                     stress_in_words(quantile(*table.find("mu_Pa"), 0.5)),
                                     stress_in_words(quantile(*table.find("mu_Pa"), 0.25)),
                                     stress_in_words(quantile(*table.find("mu_Pa"), 0.75)));
  for (const FitParameter& s : sought)
    headline += fmt::format("; median {} {}", s.name, plain(quantile(table.column[4], 0.5), 3));
  headline += fmt::format("; median rms {:.2f} % of the largest force",
                          100.0 * quantile(*table.find("rms_of_largest_force"), 0.5));
  return {.summary_json = text, .headline = headline};
}

}  // namespace dimple
