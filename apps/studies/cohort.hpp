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

/// A table of cases: a row each, the columns `id`, `image` and any option.
struct Cohort {
  std::filesystem::path file;
  TextTable table;
  std::vector<std::string> key;  ///< of each column: "id", or the key of an option
  std::size_t size() const { return table.row.size(); }
  const std::string& id(std::size_t row) const { return table.row[row].field[id_column]; }
  std::size_t id_column = 0;
};

/// Reads what holds for all rows. Throws InputError: no such file, no table, no column id or image, an id
/// that is empty, there twice, or no name for a folder; UsageError: a column that is headed by no option, or
/// two by one.
Cohort read_cohort(const std::filesystem::path& file);

/// The path of a row's image as it is opened; empty if it has none.
std::string image_of(const Cohort& cohort, std::size_t row);

/// The options of one row, over those of all rows; an empty field says nothing, and paths begin where the
/// table is. Checked as far as they can be before the image is read. Throws UsageError, InputError.
Description case_of(const Cohort& cohort, std::size_t row, Description of_all_rows);

/// What a row says now that the run in the folder was not made with: "material.mu_Pa is 2000.0 now, and
/// was 1000.0". Empty: nothing, or it cannot be known.
std::string changed_since(const Cohort& cohort, std::size_t row, const std::filesystem::path& folder);

/// Runs one row in the folder that is called by its id, as record_run() does there: it goes on with what was
/// stopped, and returns at once where the same run is finished. A run of other options or another image is
/// refused, or, with `anew`, replaced. Why it failed is put down in the folder, unless that holds something
/// else. Throws Error.
Outcome run_case(const Cohort& cohort, std::size_t row, const Description& of_all_rows,
                 const std::filesystem::path& out, bool anew, const RecordObserver& observer);

/// What has become of a row.
struct CaseEnd {
  enum class How { not_begun, finished, skipped, failed, interrupted };
  How how = How::not_begun;
  std::string headline = {};     ///< of what is finished, now or before
  Report reason = {};            ///< of a failure
  ExitCode code = ExitCode::ok;  ///< of the row's run
  double seconds = 0.0;
};

struct CohortOptions {
  std::size_t jobs = 1;
  bool anew = false;
  std::vector<std::string>
      program;  ///< with its arguments: runs the row whose number, from 1 on, is put behind them
};

/// Runs all rows, each in a process of its own, so that none takes others with it. What cannot run is known
/// before the first begins, and put down in its folder. A process that fails leaves its words in ID.log
/// beside the folder. Throws OutputError: `out` cannot be made. When asked to stop (io/stop.hpp) it begins no
/// further rows and ends the running ones.
std::vector<CaseEnd> run_cohort(const Cohort& cohort, const Description& of_all_rows,
                                const std::filesystem::path& out, const CohortOptions& options,
                                const std::function<void(const std::string&)>& progress);

}  // namespace dimple
