#pragma once

#include <string>
#include <utility>
#include <vector>

#include "apps/run/record.hpp"

namespace dimple {

enum class Verbosity { quiet, normal, verbose };

/// Starts the log. All messages go to stderr; stdout is only for the result. `slicer`: the progress also goes
/// to stdout, in the tags that 3D Slicer reads.
void start_log(Verbosity verbosity, bool slicer = false);
/// Ends the log after its last line.
void end_log();
void say(const std::string& line);     ///< current action and its reason
void detail(const std::string& line);  ///< with -v only
void warn(const std::string& line);

/// Texts given to warn(), printed or not.
std::vector<std::string> warnings_so_far();

/// Observer that prints the progress of a run to stderr. On a terminal, the bottom line shows the current
/// stage and the remaining time; elsewhere a line is printed at half of the march, or at every tenth with -v
/// and for long runs.
RecordObserver to_log();

/// Clears the bottom line before other output, such as an error.
void clear_stage_line();

/// "4.2 s: 0.1 reading, 2.3 solving, ...", with the rest of `total_s`, so that the parts add up to it.
std::string times_in_words(double total_s, std::vector<std::pair<std::string, double>> parts);

}  // namespace dimple
