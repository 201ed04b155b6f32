#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "io/table.hpp"

namespace dimple {

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

/// One row a case.
TextTable table_of(const std::vector<CollectedCase>& cases, const std::vector<double>& depths_mm);

/// One HTML page with a picture a case, failures first. The pictures stay where they are, `to_cases` away,
/// and are marked to be loaded when they come in sight.
std::string page_of(const std::vector<CollectedCase>& cases, const std::string& to_cases);

/// Force curves and pictures once more, in `dataset`, under the names of BIDS derivatives:
/// sub-01/sub-01_desc-indentation_force.tsv. Returns how many cases have one. Throws UsageError: an id is not
/// made of BIDS entities (sub-01, sub-01_ses-02); OutputError.
std::size_t write_bids(const std::vector<CollectedCase>& cases, const std::filesystem::path& out,
                       const std::filesystem::path& dataset);

}  // namespace dimple
