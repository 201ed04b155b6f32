#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace dimple {

/// How another program ended.
struct ProgramRun {
  int code = -1;  ///< what it returned; 128 + signal if it died of one
  bool interrupted = false;
};

/// Runs a program in `folder` to its end, or ends it and what it started when `stop_requested`: then it has
/// `grace_s` to end by itself. Its words go to `log` in the folder. By posix_spawn: no shell between that
/// would read the arguments, and no other library here starts programs. Throws UsageError if it cannot be
/// started.
ProgramRun run_program(const std::vector<std::string>& arguments, const std::filesystem::path& folder,
                       const std::string& log, const std::function<bool()>& stop_requested = {},
                       double grace_s = 0.0);

}  // namespace dimple
