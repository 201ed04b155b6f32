#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "apps/run/compare.hpp"
#include "apps/run/record.hpp"
#include "apps/studies/fit_curve.hpp"

namespace dimple {

/// Default number of nodes for fits that take one run.
inline constexpr Index nodes_for_one_run = 4000;

/// Name of the parameters modulus and first contact.
inline constexpr const char* mu_and_contact = "mu,touch";

struct FitOptions {
  std::string of = "mu";        ///< see fit_numbers()
  std::filesystem::path curve;  ///< see read_measured_curve()
};

/// Fits a material's numbers to a measured curve: fit.csv, fit.png, fit.svg, fitted.toml, summary.json; to a
/// file of many curves by fit_samples().
/// `described`: the image and all options except these numbers and the depth, and the rate if the curve has
/// no times. Throws UsageError: the force is not proportional to one modulus, or a number that follows from
/// the curve is given; InputError: the curve; what simulate() throws; Stopped.
Outcome fit(const Description& described, const FitOptions& options, const std::filesystem::path& folder,
            Existing existing, const std::function<void(const std::string&)>& progress);

}  // namespace dimple
