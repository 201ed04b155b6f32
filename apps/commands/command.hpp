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

/// What all commands have in common, as the command line gave it.
struct Invocation {
  Ending& ending;
  bool quiet = false, verbose = false, json = false, force = false, resume = false;
  bool slicer = false;  ///< started by 3D Slicer, which gives all options and reads progress on stdout
  int threads = 0;
  std::string command = {}, image = {}, out = {}, time_limit = {};
  std::vector<std::string> words = {};  ///< of the command line, after the program's name
  /// A failure is put down in the folder, besides the terminal: of commands that write results, once the
  /// command line is understood.
  bool leaves_word = false;
  /// `run --explain`, after the run; null in a program without it.
  Outcome (*explain)(const Scene&, const Invocation&, Outcome) = nullptr;

  Existing existing() const {
    return force ? Existing::replace : resume ? Existing::resume : Existing::refuse;
  }
};

/// A subcommand as it was added to the program, and what it does: returns the exit code, throws Error.
struct Command {
  CLI::App* app;
  std::function<int()> perform;
};

/// Flags made from the option table: their text is kept and given to set_option(), which knows units and
/// ranges.
struct Flags {
  std::vector<std::pair<std::string, std::unique_ptr<std::string>>> given;  // key, text
  std::string config_file;
  std::vector<std::string> sets;
  bool defaults_are_unsaid = false;  ///< a flag with its default says no more than none

  /// Those of one stage; "": all but of files; "run": those too; "none": --config and --set alone.
  /// `defaults`: key -> text that the help gives in place of the usual value.
  void add(CLI::App& command, const std::string& stage,
           const std::map<std::string, std::string>& defaults = {});
  /// Defaults, then the file, then --set, then flags; before complete().
  Description stated(const CLI::App& command) const;
  Description described(const CLI::App& command) const;
  /// The same of a command that takes an image.
  Description described(const CLI::App& command, const std::string& image) const;
};

/// A number above 0 of an option that is not in the table, with or without a unit. Throws UsageError.
double quantity(const std::string& text, const std::string& flag, const std::string& unit,
                const std::string& help);

/// --quiet, --verbose, --json, --threads, --time-limit.
void add_common(CLI::App& command, Invocation& shared);
/// That alone, for commands that have nothing of the others.
void add_time_limit(CLI::App& command, Invocation& shared);
/// --force and, if there is something to go on with, --resume.
void add_over_results(CLI::App& command, Invocation& shared, bool resumable);

/// From here on a failure is put down where the results of `input` would be.
void into_folder(Invocation& shared, const std::string& input);
/// Prints what a command has come to: the result on stdout, then where the time went and what to open next on
/// stderr.
int finish(const Invocation& shared, const Outcome& outcome);
/// A line of a long study, on stderr unless --quiet.
std::function<void(const std::string&)> progress_of(const Invocation& shared);

}  // namespace dimple
