#pragma once

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "apps/run/record.hpp"

namespace dimple {

enum class Verbosity { quiet, normal, verbose };

/// Everything a person reads while the program works goes to stderr; stdout is for the result alone.
void start_log(Verbosity verbosity);
void say(const std::string& line);     ///< what is being done, and why so
void detail(const std::string& line);  ///< with -v only
void warn(const std::string& line);

/// What warn() was given, printed or not.
std::vector<std::string> warnings_so_far();

/// On a terminal, what is being done now, until the next line; elsewhere nothing.
void doing(const std::string& what);

/// Progress of long work: a line that renews itself on a terminal, else one line about every tenth. No
/// packaged progress bar is in Debian 12.
class Progress {
 public:
  explicit Progress(std::string what);
  /// `share` in [0, 1]; `state` is a few words after it.
  void update(double share, const std::string& state);
  void finish();

 private:
  std::string what_;
  std::chrono::steady_clock::time_point start_, last_;
  int tenths_ = 0;
  bool terminal_ = false, open_ = false;
};

/// What a run tells, on stderr.
RecordObserver to_log();

}  // namespace dimple
