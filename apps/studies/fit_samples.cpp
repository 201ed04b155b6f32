// Fits of many curves that were measured in one scene.
//
// 1. The run is as deep as the deepest curve, and as fast. Its force is proportional to mu. A further number
//    of the law has a run for each value of a grid, even in its logarithm. Ogden's exponent has a grid for
//    each sign.
// 2. Each run gives forces at the depths of a curve. Between values of the grid they follow the cubic
//    polynomial through the four nearest, in the logarithm.
// 3. Each curve is fitted by fit_curve(), as a single one is.
// 4. The half-width by discretisation is that of the run with a neo-Hookean tissue, weighed as by the deepest
//    curve.

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

// Forces of one search: of one run, or of a run for each value of its parameter that has an equilibrium.
struct Library {
  std::vector<FitParameter> sought = {};  // none, or one
  std::vector<double> at = {};            // logarithm of the parameter's amount, rising
  std::vector<ForceCurve> run = {};
  double mu = 0.0;  // [Pa] of the runs
};

double log_amount(double number) {
  return std::log(std::abs(number));
}

Library library_of(const Scene& own, const std::string& of, const FitParameter& s,
                   const std::function<void(const std::string&)>& progress,
                   std::vector<std::string>& warnings) {
  Library library{.sought = {s}, .mu = own.material.mu_Pa};
  const double least = log_amount(s.least), most = log_amount(s.most);
  for (int k = 0; k < grid_size; ++k) {
    const double at = least + (most - least) * k / (grid_size - 1);
    const double number = std::copysign(std::exp(at), s.start);
    try {
      const Result result = march(with_numbers(own, of, {number}), false);
      library.run.push_back(force_curve_of(result));
      library.at.push_back(at);
      add_new(warnings, result.warnings);
      progress(fmt::format("run      {} {:.4g}", s.name, number));
    } catch (const SolveError& error) {
      progress(fmt::format("run      {} {:.4g} is left out: {}", s.name, number, error.report.fact));
    }
  }
  return library;
}

// `one`: the run with a neo-Hookean tissue. A grid with fewer than four runs is left out.
std::vector<Library> libraries_of(const Scene& own, const std::string& of, const MeasuredCurve& deepest,
                                  const Result& one, const std::function<void(const std::string&)>& progress,
                                  std::vector<std::string>& warnings) {
  std::vector<Library> libraries;
  for (const std::vector<FitParameter>& sought : searches_of(of, deepest)) {
    if (takes_one_run(of))
      libraries.push_back({.sought = sought, .run = {force_curve_of(one)}, .mu = own.material.mu_Pa});
    else if (Library library = library_of(own, of, sought.front(), progress, warnings);
             library.at.size() >= 4)
      libraries.push_back(std::move(library));
  }
  if (libraries.empty())
    throw SolveError({.fact = "fewer than four values of the number sought have an equilibrium",
                      .where = "--of " + of,
                      .why = "the fits interpolate between runs",
                      .remedy = "fit shallower curves, or use more --nodes"});
  return libraries;
}

// Forces at a curve's depths with a modulus of 1 Pa, as fit_curve() requests them.
class ForcesOf {
 public:
  ForcesOf(const Library& library, const MeasuredCurve& curve) : library_(library), curve_(curve) {
    for (const ForceCurve& run : library.run) of_run_.push_back(at_depths(run, 0.0));
  }

  std::vector<double> operator()(const std::vector<double>& numbers) const {
    if (numbers.empty()) return of_run_.front();
    if (library_.at.empty()) return at_depths(library_.run.front(), 1e-3 * numbers[0]);
    return between(log_amount(numbers[0]));
  }

 private:
  std::vector<double> at_depths(const ForceCurve& run, double later) const {
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

// The best fit of one curve over all searches; nothing where it has none. `fraction`: relative half-width of
// the force by discretisation; none: not known.
std::optional<CurveFit> best_fit(const std::vector<Library>& libraries, std::optional<double> fraction,
                                 const MeasuredCurve& curve) {
  std::vector<CurveFit> fits;
  for (const Library& library : libraries) try {
      const ForcesOf forces(library, curve);
      std::vector<FitParameter> sought = library.sought;
      if (!library.at.empty()) {  // within the grid that has an equilibrium
        sought[0].least = std::copysign(std::exp(library.at.front()), sought[0].start);
        sought[0].most = std::copysign(std::exp(library.at.back()), sought[0].start);
      }
      fits.push_back(fit_curve(curve.depth, curve.force, sought, forces, most_looks));
    } catch (const InputError&) {  // no positive modulus
    }
  if (fits.empty()) return std::nullopt;
  std::stable_sort(fits.begin(), fits.end(),
                   [](const CurveFit& a, const CurveFit& b) { return a.sum2 < b.sum2; });
  CurveFit& best = fits.front();
  if (fraction) add_discretisation(best, curve.depth, *fraction);
  conclude(best, fraction.has_value());
  if (fits.size() > 1 && alike(best, fits[1])) best.number[1].determined = false;  // the sign of alpha
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

double median_of(const Table& table, const std::string& column) {
  return quantile(*table.find(column), 0.5);
}

std::string column_of(const FitParameter& s, const std::string& limit = "") {
  return s.name + limit + (s.unit.empty() ? "" : "_" + s.unit);
}

Table table_of(const std::vector<std::optional<CurveFit>>& fits, const std::vector<MeasuredCurve>& curves,
               const std::vector<FitParameter>& sought) {
  Table table{.header = {"sample", "mu_Pa", "mu_low_Pa", "mu_high_Pa"}, .column = {}};
  for (const FitParameter& s : sought)
    table.header.insert(table.header.end(), {column_of(s), column_of(s, "_low"), column_of(s, "_high")});
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

// Fraction of the samples whose number is below x, as a curve.
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
                      .series = {distribution(*table.find(column_of(s)))}});
  charts.push_back({.title = "mean residual",
                    .subtitle = {fmt::format("measured - model; median rms {:.2f} % of the largest force",
                                             100.0 * median_of(table, "rms_of_largest_force"))},
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

// Warnings about the curves, once for all samples.
std::vector<std::string> warnings_of(const std::vector<MeasuredCurve>& curves, const MeasuredCurve& deepest,
                                     const Scene& own) {
  std::vector<std::string> warnings;
  const auto count = [&](auto member) {
    return std::count_if(curves.begin(), curves.end(),
                         [&](const MeasuredCurve& curve) { return !(curve.*member).empty(); });
  };
  if (const auto some = count(&MeasuredCurve::left_out); some > 0)
    warnings.push_back(
        fmt::format("rows after the largest depth are left out in {} of {} samples: they are not loading",
                    some, curves.size()));
  if (const auto some = count(&MeasuredCurve::averaged); some > 0)
    warnings.push_back(
        fmt::format("means of successive rows are used in {} of {} samples", some, curves.size()));
  if (!own.material.prony_g.empty())
    warnings.push_back(fmt::format("the tissue relaxes: all samples use {} mm/s, the speed of {}",
                                   plain(own.rate_mm_per_s),
                                   deepest.time.empty() ? "the options" : deepest.name));
  return warnings;
}

Json summary_of(const FitOptions& options, const Scene& scene, const Table& table,
                const std::vector<FitParameter>& sought, std::optional<double> fraction) {
  const std::vector<double>&mu = *table.find("mu_Pa"), &determined = *table.find("determined");
  Json summary;
  summary["image"] = scene.image.file;
  summary["curve"] = options.curve.string();
  summary["curve_sha256"] = sha256_of_file(options.curve);
  summary["status"] = "finished";
  summary["version"] = DIMPLE_VERSION;
  summary["of"] = options.of;
  summary["samples"] = table.rows();
  summary["samples_without_fit"] =
      std::count_if(mu.begin(), mu.end(), [](double x) { return std::isnan(x); });
  summary["samples_determined"] = std::count(determined.begin(), determined.end(), 1.0);
  summary["mu_Pa"] = spread_of(mu);
  for (const FitParameter& s : sought) summary["numbers"][s.name] = spread_of(*table.find(column_of(s)));
  summary["rms_of_largest_force"] = spread_of(*table.find("rms_of_largest_force"));
  summary["discretisation_share"] = fraction ? Json(*fraction) : Json();
  return summary;
}

std::string headline_of(const Table& table, const std::vector<FitParameter>& sought) {
  const std::vector<double>& mu = *table.find("mu_Pa");
  std::string headline = fmt::format("{} samples: median mu {}, half of them {} to {}", table.rows(),
                                     stress_in_words(quantile(mu, 0.5)), stress_in_words(quantile(mu, 0.25)),
                                     stress_in_words(quantile(mu, 0.75)));
  for (const FitParameter& s : sought)
    headline += fmt::format("; median {} {}", s.name, plain(median_of(table, column_of(s)), 3));
  return headline + fmt::format("; median rms {:.2f} % of the largest force",
                                100.0 * median_of(table, "rms_of_largest_force"));
}

// Inertia matters most for the softest sample, whose waves are slowest.
void require_slow_for_softest(const Scene& given, Scene found, const Table& table, const Result& result) {
  const double softest = quantile(*table.find("mu_Pa"), 0.0);
  if (!std::isfinite(softest)) return;
  multiply(found, softest / material_of(found).mu);
  require_no_inertia(given, found, result);
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
  const Scene scene = resolve(case_of(described, given, options, deepest));
  std::vector<std::string> warnings = warnings_of(curves, deepest, scene);
  const Result one = march(scene, scene.error_bounds);
  add_new(warnings, one.warnings);
  const std::vector<Library> libraries = libraries_of(scene, options.of, deepest, one, progress, warnings);

  std::optional<double> fraction;
  if (one.error_bounds.known()) {
    CurveFit of_run;
    of_run.force = forces_later(force_curve_of(one), deepest.depth, 0.0);
    fraction = fraction_of_error_bounds(one, deepest, of_run);
  }
  std::vector<std::optional<CurveFit>> fits;
  for (const MeasuredCurve& curve : curves) {
    stop_if_requested();
    fits.push_back(best_fit(libraries, fraction, curve));
  }
  const std::vector<FitParameter>& sought = libraries.front().sought;
  const Table table = table_of(fits, curves, sought);
  require_slow_for_softest(given, scene, table, one);

  results.prepare();
  write_csv(folder / "fits.csv", table);
  const std::vector<Chart> charts = charts_of(options.curve.filename().string(), table, sought, fits, curves);
  for (const char* file : {"fits.png", "fits.svg"}) write_chart(folder / file, charts);
  Json summary = summary_of(options, scene, table, sought, fraction);
  summary["nodes"] = one.model.node_count();
  summary["warnings"] = warnings;
  const std::string text = as_text(summary);
  write_file(folder / "summary.json", text);
  for (const std::string& warning : warnings) progress("warning: " + warning);
  return {.summary_json = text, .headline = headline_of(table, sought)};
}

}  // namespace dimple
