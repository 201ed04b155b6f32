#pragma once

#include <string>
#include <utility>
#include <vector>

#include "apps/run/record.hpp"

namespace dimple {

enum class Verbosity { quiet, normal, verbose };

/// Everything a person reads while the program works goes to stderr; stdout is for the result alone.
/// `slicer`: the progress goes to stdout as well, between the tags that 3D Slicer reads.
void start_log(Verbosity verbosity, bool slicer = false);
/// After the last line.
void end_log();
void say(const std::string& line);     ///< what is being done, and why so
void detail(const std::string& line);  ///< with -v only
void warn(const std::string& line);

/// What warn() was given, printed or not.
std::vector<std::string> warnings_so_far();

/// What a run tells, on stderr. On a terminal a line at the bottom says what is being done and how much time
/// is left; elsewhere there is a line at half of the march, or at every tenth with -v and where it is long.
RecordObserver to_log();

/// Clears the line at the bottom: another program's words, or an error, come next.
void clear_stage_line();

/// "4.2 s: 0.1 reading, 2.3 solving, ...", and what the parts leave of `total_s`, so that the sum is that.
std::string times_in_words(double total_s, std::vector<std::pair<std::string, double>> parts);

}  // namespace dimple
