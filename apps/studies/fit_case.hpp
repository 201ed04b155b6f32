#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/run/compare.hpp"
#include "apps/run/simulate.hpp"
#include "apps/scene/resolve.hpp"
#include "apps/studies/fit.hpp"

namespace dimple {

/// A set of numbers that a curve may determine in addition to the modulus.
struct FitNumbers {
  const char* of;                 ///< as --of names it
  const char* words;              ///< for people
  std::vector<std::string> keys;  ///< options that are not given as well
};

/// Throws UsageError: --of names no set of numbers that can be sought.
const FitNumbers& fit_numbers(const std::string& of);
/// Throws UsageError: the curve is the word for the paper's values.
void refuse_paper_values(const std::filesystem::path& curve);
/// Refuses a fit in which inertia matters; that depends on the modulus, which is known only after the fit.
/// `given`, `found`: the scene before the fit and with its modulus. Throws UsageError.
void require_no_inertia(const Scene& given, const Scene& found, const Result& result);

/// True if the numbers are found from the forces of one run: the modulus, and the position of first contact.
bool takes_one_run(const std::string& of);
/// The options of the case that the curve belongs to, except the numbers sought. `given`: the scene of
/// `described`. Throws UsageError, InputError.
Description case_of(const Description& described, const Scene& given, const FitOptions& options,
                    const MeasuredCurve& curve);
/// Scene with values of the numbers that are sought in addition to mu.
Scene with_numbers(Scene scene, const std::string& of, const std::vector<double>& numbers);
/// Parameters sought in addition to mu; for alpha two searches, one for each sign, as the energy has no alpha
/// between them.
std::vector<std::vector<FitParameter>> searches_of(const std::string& of, const MeasuredCurve& curve);
/// Multiplies all constants of the law by a factor.
void multiply(Scene& scene, double factor);
/// Runs a scene in equilibrium. Throws what simulate() throws, and Stopped.
Result march(Scene scene, bool error_bounds);
/// Forces of a run, and whether they are those of a contacting tool, which interpolate differently.
struct ForceCurve {
  bool contacting = false;
  std::vector<ForceSample> force;
};
ForceCurve force_curve_of(const Result& result);
/// Forces of the model at these depths [N], for a first contact `later` [m] after their zero.
std::vector<double> forces_later(const ForceCurve& curve, std::vector<double> depth, double later);
/// Relative half-width of the force's error bounds, as the fit weighs it.
double fraction_of_error_bounds(const Result& result, const MeasuredCurve& curve, const CurveFit& fit);

/// Adds the lines that `list` does not hold yet.
void add_new(std::vector<std::string>& list, const std::vector<std::string>& more);

}  // namespace dimple
