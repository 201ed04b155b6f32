#pragma once

#include <array>
#include <filesystem>
#include <initializer_list>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/summary.hpp"
#include "io/error.hpp"
#include "io/table.hpp"
#include "solver/march.hpp"

// The only reader of what runs have left in their folders: for compare, collect and batch.

namespace dimple {

/// The part of a summary under these names, each within the one before; nullptr if it is absent.
const Json* part_of(const Json& summary, std::initializer_list<const char*> names);

/// The failure in the summary.json of a run that ended with that code; nothing if none can be read.
std::optional<Report> failure_in(const std::filesystem::path& folder, int exit_code);

/// The content of a file of a run. Throws InputError: it is absent, larger than most_bytes_of_text, a pipe or
/// a device.
std::string read_small_file(const std::filesystem::path& file);

/// force.csv of a run's folder. Throws InputError as read_csv() does, and for a pipe or a device.
Table force_table_in(const std::filesystem::path& folder);

/// A run that has finished: its options, and its force curve in SI units without the row at rest.
struct FinishedRun {
  std::string folder;  ///< as it was given, fit for a message
  Json summary;
  std::map<std::string, std::string> options;  ///< of config.resolved.toml
  std::vector<ForceSample> curve;              ///< at depths that increase
  std::vector<double> half;  ///< half-width of the error bounds at each of them [N], or none
  std::string no_band;       ///< why there is none
  std::string image_sha256;  ///< empty if it is not known
  double cut_area = 0.0;     ///< of all its cuts [m^2]
  double stored = 0.0;       ///< energy at the end [J]
};

/// Throws InputError: no such folder, no run in it, one that has not finished or is a scene of steps, files
/// that are not of one run.
FinishedRun read_finished_run(const std::string& folder);

/// What the folder of one run says, as it stands in a table; what it does not say is empty.
struct CollectedCase {
  std::string id;
  std::string status;  ///< of summary.json: finished, failed, interrupted; unfinished: none is there;
                       ///< missing: no folder; changed: a finished run of other options than its row
  std::string code, fact, where, remedy;  ///< of a failure
  std::string image, labels, volume_mm3, mu_Pa, indentation_mm, total_s, nodes, warnings, version, tool;
  using Force = std::array<std::string, 3>;  ///< with the low and the high end of its band [N]
  Force force;                               ///< at the end
  std::array<std::string, 3> largest;        ///< of a scene of steps: force [N], indentation [mm], step
  std::vector<Force> at_depth;               ///< at those that were asked for
  bool picture = false, report = false;      ///< overview.png and report.html are there
};

/// Reads each run's summary.json, and its force.csv if there are `depths_mm`, where the force is interpolated
/// linearly. Runs are the folders in `out` that a run has left anything in, and those called as `expected`
/// says; by id. A folder that cannot be read is a case with that failure. Throws InputError: no such folder,
/// or no run in it.
std::vector<CollectedCase> collect(const std::filesystem::path& out, const std::vector<double>& depths_mm,
                                   const std::vector<std::string>& expected = {});

}  // namespace dimple
