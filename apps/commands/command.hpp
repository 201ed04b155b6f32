#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "apps/ending.hpp"
#include "apps/run/config.hpp"
#include "apps/run/record.hpp"

namespace dimple {

/// What all commands have in common, as the command line gave it.
struct Invocation {
  Ending& ending;
  bool quiet = false, verbose = false, json = false, force = false, resume = false;
  int threads = 0;
  std::string command, image, out, time_limit;
  /// A failure is put down in the folder, besides the terminal: of commands that write results, once the
  /// command line is understood.
  bool leaves_word = false;

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

  /// Those of one stage; "": all but of files; "run": those too; "none": --config and --set alone.
  void add(CLI::App& command, const std::string& stage);
  /// Defaults, then the file, then --set, then flags.
  Config config(const CLI::App& command) const;
  /// The same of a command that takes an image.
  Config config(const CLI::App& command, const std::string& image) const;
};

/// --quiet, --verbose, --json, --threads, --time-limit.
void add_common(CLI::App& command, Invocation& shared);
/// --force and, if there is something to go on with, --resume.
void add_over_results(CLI::App& command, Invocation& shared, bool resumable);

/// From here on a failure is put down where the results of `input` would be.
void into_folder(Invocation& shared, const std::string& input);
/// Prints what a command has come to.
int finish(const Invocation& shared, const Outcome& outcome);
/// A line of a long study, on stderr unless --quiet.
std::function<void(const std::string&)> progress_of(const Invocation& shared);

/// At most 100 characters a line; the rest of a longer one goes below its description, which begins at
/// `column` if the line is one of a list. CLI11 leaves lines as long as they are.
std::string wrapped(const std::string& text, std::size_t column);

}  // namespace dimple
