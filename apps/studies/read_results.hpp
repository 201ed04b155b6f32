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

// Reader of the folders of runs, for compare, collect and batch.

namespace dimple {

/// Part of a summary under nested names; nullptr if it is absent.
const Json* part_of(const Json& summary, std::initializer_list<const char*> names);

/// Failure in the summary.json of a run that ended with that code; nothing if none can be read.
std::optional<Report> failure_in(const std::filesystem::path& folder, int exit_code);

/// Content of a file of a run. Throws InputError: it is absent, larger than most_bytes_of_text, a pipe or a
/// device.
std::string read_small_file(const std::filesystem::path& file);

/// Table force.csv of a run's folder. Throws InputError as read_csv() does, and for a pipe or a device.
Table force_table_in(const std::filesystem::path& folder);

/// Finished run: its options, and its force curve in SI units without the row at rest.
struct FinishedRun {
  std::string folder;  ///< as it was given, for messages
  Json summary;
  std::map<std::string, std::string> options;  ///< of config.resolved.toml
  std::vector<ForceSample> curve;              ///< at depths that increase
  std::vector<double> half;     ///< half-width of the error bounds at each of them [N], or none
  std::string no_error_bounds;  ///< why there are none
  bool contacting = false;      ///< a contacting tool
  std::string image_sha256;     ///< empty if not known
  double cut_area = 0.0;        ///< of all its cuts [m^2]
  double stored = 0.0;          ///< energy at the end [J]
};

/// Reads the folder of a finished run. Throws InputError: no such folder, no run in it, an unfinished run, a
/// scene of steps, or files of different runs.
FinishedRun read_finished_run(const std::string& folder);

/// Content of the folder of one run, as text for a table; empty where the folder has none.
struct CollectedCase {
  std::string id;
  std::string status;  ///< of summary.json: finished, failed, interrupted; unfinished: no summary; missing:
                       ///< no folder; changed: finished with options other than its row's
  std::string code, fact, where, remedy;  ///< of a failure
  std::string image, labels, volume_mm3, mu_Pa, indentation_mm, total_s, nodes, warnings, version, tool;
  using Force = std::array<std::string, 3>;  ///< with its lower and upper error bound [N]
  Force force;                               ///< at the end
  std::array<std::string, 3> largest;        ///< of a scene of steps: force [N], indentation [mm], step
  std::vector<Force> at_depth;               ///< at the requested depths
  bool picture = false, report = false;      ///< overview.png and report.html are there
};

/// Reads summary.json of each run, and its force.csv if there are `depths_mm`, at which the force is
/// interpolated linearly. Runs are the folders in `out` with files of a run and those named in `expected`,
/// sorted by id. A folder that cannot be read is a case with that failure. Throws InputError: no such folder,
/// or no run in it.
std::vector<CollectedCase> collect(const std::filesystem::path& out, const std::vector<double>& depths_mm,
                                   const std::vector<std::string>& expected = {});

}  // namespace dimple
