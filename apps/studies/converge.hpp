#pragma once

#include "apps/run/record.hpp"
#include "apps/studies/measure.hpp"

namespace dimple {

/// Force [N] at each of the depths [mm], ascending, between the samples on both sides: an equilibrium has one
/// for each frame, central differences hundreds. As many as the samples reach.
std::vector<double> forces_at(const std::vector<ForceSample>& samples, const std::vector<double>& depths_mm);

/// force_N at each of the depths [mm], from a table that holds them. Throws InputError: no such column or row.
std::vector<double> reference_at(const std::filesystem::path& file, const std::vector<double>& depths_mm);

struct ConvergenceOptions {
  std::vector<Index> nodes = {1000, 2000, 4250, 8500};
  std::vector<double> densities = {1.0, 2.0};  ///< of points, as multiples of config's
  int seeds = 3;
  std::filesystem::path reference;  ///< CSV with indentation_mm and force_N, or empty
};

/// Runs one scene with several clouds and says how far its force can be trusted: convergence.csv holds every
/// run, convergence.md what follows from them, convergence.png and .svg show both. Throws what measure() throws,
/// and UsageError.
///
/// Per depth and cloud size: the mean force over the seeds, their scatter (largest - smallest), what doubling
/// the points changes, the difference from the reference, or without one from the finest cloud, and the
/// largest kink: second difference of the curve / its last force. `progress` is called with a line about each
/// run.
Outcome converge(const Config& config, const ConvergenceOptions& options, const std::filesystem::path& folder,
                 const std::function<void(const std::string&)>& progress);

}  // namespace dimple
