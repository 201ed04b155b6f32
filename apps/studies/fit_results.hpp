#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/compare.hpp"
#include "apps/run/record.hpp"
#include "apps/studies/fit.hpp"

namespace dimple {

/// Result of a half-space formula for the same curve.
struct HalfSpaceCheck {
  double mu = 0.0;         ///< [Pa]
  double thickness = 0.0;  ///< of the body under the tool, in radii of the contact at the end
};

/// Result of the fit of a curve.
struct FoundFit {
  Description options;   ///< of its runs
  Scene scene;           ///< with the numbers that were found
  CurveFit fit;          ///< the best
  double stiffer = 1.0;  ///< its modulus over that of `result`
  Result result = {};    ///< of the run with the other numbers
  int runs = 0;
  std::optional<HalfSpaceCheck> check = {};
  std::vector<std::string> warnings = {};
};

std::vector<double> scaled(std::vector<double> list, double factor);

double largest_force(const MeasuredCurve& curve);  ///< absolute value [N]

/// Writes fit.csv, fit.png, fit.svg, fitted.toml and last summary.json, which marks the fit as complete.
Outcome write_fit(const std::filesystem::path& folder, const FitOptions& options, const MeasuredCurve& curve,
                  const FoundFit& found);

/// Prints warnings and the quality of the fit, a line each.
void say_fit(const MeasuredCurve& curve, const FoundFit& found,
             const std::function<void(const std::string&)>& progress);

}  // namespace dimple
