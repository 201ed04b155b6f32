#include "apps/studies/fit.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "apps/run/organ.hpp"
#include "apps/run/results.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/unless_stopped.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/scene/resolve.hpp"
#include "apps/studies/fit_case.hpp"
#include "apps/studies/fit_results.hpp"
#include "apps/studies/fit_samples.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

std::optional<HalfSpaceCheck> half_space_check(const LoadedModel& result, const MeasuredCurve& curve,
                                               double first_contact_at, double nu) {
  if (!result.loading.indenter || !result.origin) return std::nullopt;
  double products = 0.0, squares = 0.0;
  for (std::size_t k = 0; k < curve.depth.size(); ++k) {
    const std::optional<double> unit =
        half_space_force(result.loading.indenter->shape, curve.depth[k] - first_contact_at);
    if (!unit) return std::nullopt;
    products += curve.force[k] * *unit;
    squares += *unit * *unit;
  }
  const Origin& origin = *result.origin;
  const BodyUnderPatch body =
      body_under_patch(origin.organ.body->surface, origin.boundary, origin.organ.options.boundary.voxel_mm);
  // E / (1 - nu^2) = 2 mu / (1 - nu)
  return HalfSpaceCheck{.mu = 0.5 * (1.0 - nu) * products / squares, .thickness = body.thickness};
}

constexpr int most_runs_of_a_search = 24;  // and one more for the error bounds
constexpr int most_looks_at_one_run = 200;

std::vector<std::string> warnings_of(const MeasuredCurve& curve, const Scene& own) {
  std::vector<std::string> warnings;
  for (const std::string* words : {&curve.left_out, &curve.averaged})
    if (!words->empty()) warnings.push_back(*words);
  if (curve.time.empty() && !own.material.prony_g.empty())
    warnings.push_back(
        fmt::format("the curve has no time_s, and the tissue relaxes: a speed of {} mm/s is used",
                    plain(own.rate_mm_per_s)));
  return warnings;
}

// Data common to the searches for one curve: the case without the sought numbers, and its runs so far.
struct Runs {
  const Scene& own;
  const std::string& of;
  const std::function<void(const std::string&)>& progress;
  int count = 0;
  Result last = {};
  std::vector<std::string> warnings;
};

void march(Runs& runs, const Scene& scene, bool error_bounds) {
  runs.last = march(scene, error_bounds);
  add_new(runs.warnings, runs.last.warnings);
  ++runs.count;
}

// Forces for a modulus of 1 Pa, from a new run unless the numbers are found from the forces of one run.
std::vector<double> unit_forces(Runs& runs, const MeasuredCurve& curve, const std::vector<double>& numbers) {
  const Scene one = with_numbers(runs.own, runs.of, numbers);
  const bool one_run = takes_one_run(runs.of);
  if (!one_run || runs.count == 0) march(runs, one, one_run && runs.own.error_bounds);
  if (!one_run)
    runs.progress(
        fmt::format("run {:>3}  {} {:.4g}", runs.count, runs.of.substr(3), fmt::join(numbers, ", ")));
  const double contact_mm = runs.of == mu_and_contact ? numbers[0] : 0.0;
  return scaled(forces_later(force_curve_of(runs.last), curve.depth, 1e-3 * contact_mm),
                1.0 / material_of(one).mu);
}

// Fits from each start, the best first. A start without equilibrium is skipped if another has one.
std::vector<CurveFit> fits_of(Runs& runs, const MeasuredCurve& curve) {
  const std::vector<std::vector<FitParameter>> searches = searches_of(runs.of, curve);
  const int most_runs = (takes_one_run(runs.of) ? most_looks_at_one_run : most_runs_of_a_search) /
                        static_cast<int>(searches.size());
  std::vector<CurveFit> fits;
  std::size_t failed = 0;
  for (const std::vector<FitParameter>& sought : searches) try {
      fits.push_back(unless_stopped([&] {
        return fit_curve(
            curve.depth, curve.force, sought,
            [&](const std::vector<double>& numbers) { return unit_forces(runs, curve, numbers); }, most_runs);
      }));
    } catch (const SolveError& error) {
      if (++failed == searches.size()) throw;
      runs.warnings.push_back(
          fmt::format("no fit near {} = {}: {}", sought[0].name, plain(sought[0].start), error.report.fact));
    }
  std::stable_sort(fits.begin(), fits.end(),
                   [](const CurveFit& a, const CurveFit& b) { return a.sum2 < b.sum2; });
  return fits;
}

// Case and run with the numbers of the best fit.
FoundFit found_with(const Description& options, Runs& runs, const CurveFit& best) {
  std::vector<double> numbers;
  for (std::size_t k = 1; k < best.number.size(); ++k) numbers.push_back(best.number[k].value);
  FoundFit found{.options = options, .scene = with_numbers(runs.own, runs.of, numbers), .fit = best};
  if (!takes_one_run(runs.of)) march(runs, found.scene, runs.own.error_bounds);
  found.stiffer = best.number[0].value / material_of(found.scene).mu;
  multiply(found.scene, found.stiffer);
  found.result = std::move(runs.last);
  found.runs = runs.count;
  found.warnings = std::move(runs.warnings);
  // Range from fat in vivo to cartilage.
  constexpr double softest_Pa = 10.0, stiffest_Pa = 2e5;
  if (const double mu = best.number[0].value;
      best.number[0].determined && !(mu > softest_Pa && mu < stiffest_Pa))
    found.warnings.push_back(
        fmt::format("a shear modulus of {} is unusual for soft tissue, which has about {} to {}: check the "
                    "units in the curve's header",
                    stress_in_words(mu), stress_in_words(softest_Pa), stress_in_words(stiffest_Pa)));
  return found;
}

double first_contact_of(const FoundFit& found, const std::string& of) {
  return of == mu_and_contact ? 1e-3 * found.fit.number[1].value : 0.0;  // [m]
}

// Adds the errors by the error bounds of the force and, if it was not sought, by the first contact.
void add_errors(FoundFit& found, const MeasuredCurve& curve, const std::string& of) {
  const Result& result = found.result;
  add_discretisation(found.fit, curve.depth, fraction_of_error_bounds(result, curve, found.fit));
  if (of == mu_and_contact) return;
  const double off = off_first_contact(curve.depth.back());
  add_first_contact(found.fit, curve.force,
                    scaled(forces_later(force_curve_of(result), curve.depth, -off), found.stiffer),
                    scaled(forces_later(force_curve_of(result), curve.depth, off), found.stiffer));
}

void warn_of_residuals(FoundFit& found, const MeasuredCurve& curve, const std::string& of) {
  const double off = found.fit.rms / largest_force(curve);
  if (off > 0.02 && found.fit.memory > 2.0 / std::sqrt(static_cast<double>(curve.depth.size())))
    found.warnings.push_back(fmt::format(
        "the residuals, {:.1f} % of the largest force (rms), are not noise: neighbours have the same sign. "
        "The tissue follows another law, or the indentation does not start at contact{}",
        100.0 * off, of == "mu" ? " (--of mu,touch fits it)" : ""));
}

// Warns that the sign of alpha is not determined if the other one fits as well.
void weigh_other_sign(FoundFit& found, const CurveFit& other) {
  if (!alike(found.fit, other)) return;
  FittedNumber &mu = found.fit.number[0], &alpha = found.fit.number[1];
  const FittedNumber &mu2 = other.number[0], &alpha2 = other.number[1];
  found.warnings.push_back(
      fmt::format("{} {} with mu {} fits as well, within the noise, as {} with mu {}: this curve does not "
                  "determine its sign; a deeper or less noisy curve may",
                  alpha.name, plain(alpha2.value, 3), stress_in_words(mu2.value), plain(alpha.value, 3),
                  stress_in_words(mu.value)));
  alpha.determined = false;
  mu.noise = std::max(mu.noise, std::abs(mu.value - mu2.value) + mu2.noise);
}

}  // namespace

Outcome fit(const Description& described, const FitOptions& options, const fs::path& folder,
            Existing existing, const std::function<void(const std::string&)>& progress) {
  fit_numbers(options.of);
  refuse_paper_values(options.curve);
  ResultFolder results(folder, existing);
  const std::vector<MeasuredCurve> curves = read_measured_curves(options.curve);
  if (curves.size() > 1) return fit_samples(described, options, curves, results, folder, progress);
  const MeasuredCurve& curve = curves.front();
  const Scene given = resolve(described);
  const Description own = case_of(described, given, options, curve);
  const Scene scene = resolve(own);

  Runs runs{.own = scene, .of = options.of, .progress = progress, .warnings = warnings_of(curve, scene)};
  const std::vector<CurveFit> fits = fits_of(runs, curve);
  FoundFit found = found_with(own, runs, fits.front());
  require_no_inertia(given, found.scene, found.result);
  add_errors(found, curve, options.of);
  const double first_contact_at = first_contact_of(found, options.of);
  if (options.of == mu_and_contact) found.scene.depth_mm = 1e3 * (curve.depth.back() - first_contact_at);
  found.check =
      half_space_check(found.result, curve, first_contact_at, poisson_ratio(material_of(found.scene)));

  if (!found.fit.converged)
    found.warnings.push_back(
        fmt::format("the search was ended after {} runs: the numbers may not be the best", found.runs));
  warn_of_residuals(found, curve, options.of);
  if (fits.size() > 1) weigh_other_sign(found, fits[1]);
  add_new(found.warnings, conclude(found.fit, found.result.error_bounds.unknown.empty()));

  results.prepare();
  Outcome outcome = write_fit(folder, options, curve, found);
  say_fit(curve, found, progress);
  return outcome;
}

}  // namespace dimple
