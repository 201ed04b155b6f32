#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "apps/ending.hpp"
#include "apps/run/record.hpp"
#include "apps/scene/description.hpp"

namespace dimple {

/// Options and state common to all commands, as the command line gave them.
struct Invocation {
  Ending& ending;
  bool quiet = false, verbose = false, json = false, force = false, resume = false;
  bool slicer = false;  ///< started by 3D Slicer, which gives all options and reads the progress on stdout
  int threads = 0;
  std::string command = {}, image = {}, out = {}, time_limit = {};
  std::vector<std::string> words = {};  ///< command line without the program's name
  /// True if a failure is also recorded in the folder of the results, once the command line is understood.
  bool leaves_word = false;
  /// Function of `run --explain`, called after the run; null in a program without it.
  Outcome (*explain)(const Scene&, const Invocation&, Outcome) = nullptr;

  Existing existing() const {
    return force ? Existing::replace : resume ? Existing::resume : Existing::refuse;
  }
};

/// Subcommand and its function, which returns the exit code and throws Error.
struct Command {
  CLI::App* app;
  std::function<int()> perform;
};

/// Flags made from the option table. Their text is kept for set_option(), which checks units and ranges.
struct Flags {
  std::vector<std::pair<std::string, std::unique_ptr<std::string>>> given;  // key, text
  std::string config_file;
  std::vector<std::string> sets;
  bool defaults_are_unsaid = false;  ///< a flag with the default value counts as not given

  /// Adds the flags of a command, see has_flag(); "": those of the stages model and solve; "none": only
  /// --config and --set. `defaults`: key -> default shown in the help.
  void add(CLI::App& command, const std::string& stage,
           const std::map<std::string, std::string>& defaults = {});
  /// Options before complete(): defaults, then the file, then --set, then flags.
  Description stated(const CLI::App& command) const;
  Description described(const CLI::App& command) const;
  /// Variant for a command that takes an image.
  Description described(const CLI::App& command, const std::string& image) const;
};

/// Value above 0 of an option outside the table, with or without a unit. Throws UsageError.
double quantity(const std::string& text, const std::string& flag, const std::string& unit,
                const std::string& help);

/// Adds --quiet, --verbose, --json, --threads, --time-limit.
void add_common(CLI::App& command, Invocation& shared);
/// Adds only --time-limit.
void add_time_limit(CLI::App& command, Invocation& shared);
/// Adds --force and, if runs can be resumed, --resume.
void add_over_results(CLI::App& command, Invocation& shared, bool resumable);

/// From here on, failures are also recorded in the folder of the results of `input`.
void into_folder(Invocation& shared, const std::string& input);
/// Prints the result to stdout, and the times and the files to open to stderr. Returns the exit code.
int finish(const Invocation& shared, const Outcome& outcome);
/// Prints progress of a long study to stderr, unless --quiet.
std::function<void(const std::string&)> progress_of(const Invocation& shared);

}  // namespace dimple
