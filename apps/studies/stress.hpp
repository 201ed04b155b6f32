#pragma once

#include "apps/run/record.hpp"
#include "apps/studies/stress_maps.hpp"

namespace dimple {

struct StressOptions {
  std::vector<std::string> maps;  ///< names of stress_maps(); empty: all, unless x and y say another
  std::string x, y;               ///< a map of one's own: "material.nu=0.3,0.45"
  std::vector<std::string> schemes = {"converging", "horton2007"};
  std::vector<Index> finest = {3000, 1500};  ///< nodes of the runs to compare with, the next where one fails
  double limit_s = 300.0;                    ///< for one run
};

/// Runs a scene all over two axes and draws where it survives, and why not: per map stress_NAME.csv, .png,
/// .svg with a panel for each scheme, and stress.csv with how many cells came to what. The scene is a block
/// made here, left in the folder; or config's image, with x and y.
///
/// Each run is one case in memory, on one thread, as many at once as there are threads. What is left of it goes
/// to runs/NAME.json as soon as it ends; a later call takes it from there if options, image and program are the same. CSVs and pictures depend on these
/// alone: same input, same bytes, however often it was interrupted. A run that was out of time is taken again
/// if the limit is another one.
///
/// Throws UsageError; what a run throws that was refused (exit codes 2, 3, 6); a run that fails otherwise is
/// a cell. The limit of time is looked at after each equilibrium or sample.
Outcome stress(const Config& config, const StressOptions& options, const std::filesystem::path& folder,
               const std::function<void(const std::string&)>& progress);

}  // namespace dimple
