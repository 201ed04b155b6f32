#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace dimple {

/// End of another program.
struct ProgramRun {
  int code = -1;  ///< its exit code; 128 + signal if a signal ended it
  bool interrupted = false;
};

/// Runs a program in `folder` to its end. If `stop_requested`, ends it and its children after at most
/// `grace_s`. Its output goes to `log` in the folder. Uses posix_spawn, so that no shell reads the arguments;
/// no other library here starts programs. Throws UsageError: it cannot be started.
ProgramRun run_program(const std::vector<std::string>& arguments, const std::filesystem::path& folder,
                       const std::string& log, const std::function<bool()>& stop_requested = {},
                       double grace_s = 0.0);

}  // namespace dimple
