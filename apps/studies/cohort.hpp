#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "apps/run/record.hpp"
#include "apps/scene/description.hpp"
#include "io/error.hpp"
#include "io/table.hpp"

namespace dimple {

/// Table of cases: one row each, with the columns `id`, `image` and any option.
struct Cohort {
  std::filesystem::path file;
  TextTable table;
  std::vector<std::string> key;  ///< of each column: "id", or the key of an option
  std::size_t size() const { return table.row.size(); }
  const std::string& id(std::size_t row) const { return table.row[row].field[id_column]; }
  std::size_t id_column = 0;
};

/// Reads the table and checks what concerns all rows. Throws InputError: no such file, no table, no column id
/// or image, an id that is empty, repeated or no name for a folder; UsageError: a column that names no
/// option, or two that name the same.
Cohort read_cohort(const std::filesystem::path& file);

/// Path of a row's image; empty if it has none.
std::string image_of(const Cohort& cohort, std::size_t row);

/// Options of one row, which override those of all rows. Empty fields are ignored; paths are relative to the
/// table. They are checked as far as possible without the image. Throws UsageError, InputError.
Description case_of(const Cohort& cohort, std::size_t row, Description of_all_rows);

/// Options that have changed since the run in the folder: "material.mu_Pa is 2000.0 now, and was 1000.0".
/// Empty: none, or not available.
std::string changed_since(const Cohort& cohort, std::size_t row, const std::filesystem::path& folder);

/// Runs one row in the folder named by its id, as record_run() does: resumes a stopped run and returns at
/// once if the same run is finished. A run of other options or another image is refused, or replaced with
/// `rerun`. A failure is recorded in the folder unless that holds other files. Throws Error.
Outcome run_case(const Cohort& cohort, std::size_t row, const Description& of_all_rows,
                 const std::filesystem::path& out, bool rerun, const RecordObserver& observer);

/// State of a row at the end.
struct CaseEnd {
  enum class How { not_begun, finished, skipped, failed, interrupted };
  How how = How::not_begun;
  std::string headline = {};     ///< of the finished run, now or before
  Report reason = {};            ///< of a failure
  ExitCode code = ExitCode::ok;  ///< of the row's run
  double seconds = 0.0;
};

struct CohortOptions {
  std::size_t jobs = 1;
  bool rerun = false;
  std::vector<std::string> program;  ///< program with its arguments; the row's number, from 1, is appended
};

/// Runs all rows, each in its own process so that a crash ends only that row. Invalid rows are found before
/// the first run and recorded in their folders. The output of a failed process is in ID.log next to the
/// folder. Throws OutputError: `out` cannot be made. A stop request (io/stop.hpp) starts no further rows and
/// ends the running ones.
std::vector<CaseEnd> run_cohort(const Cohort& cohort, const Description& of_all_rows,
                                const std::filesystem::path& out, const CohortOptions& options,
                                const std::function<void(const std::string&)>& progress);

}  // namespace dimple
