#include "apps/commands/command.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "apps/commands/log.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/scene/given_once.hpp"
#include "io/error.hpp"
#include "io/text.hpp"

namespace dimple {

namespace {

// True if a command has the flag of an option: "run" all, "" those of the stages model and solve, "fit" the
// tool's in addition. "solve" has those of its stage and of files. "live", "places" and "shift" have those
// that they use.
bool has_flag(const std::string& command, const Option& of) {
  const std::string& option = of.stage;
  if (command == "live")
    return option == "model" || of.key.starts_with("material.") || of.key == "load.contact" ||
           of.key == "solver.precision" || of.key == "tool.shape";
  if (command == "places") return option == "model" || of.key == "tool.shape" || of.key == "load.depth_mm";
  if (command == "shift")
    return of.key.starts_with("material.") || of.key == "cloud.nodes" || of.key == "image.label_names" ||
           of.key == "image.close_mm" || of.key.starts_with("output.warp") || of.key == "load.self_contact" ||
           of.key.starts_with("boundary.base");
  if (option == "files") return command == "run" || command == "solve";
  if (option == "run") return command == "run" || (command == "fit" && of.key.starts_with("tool."));
  return command.empty() || command == "run" || command == "fit" || option == command;
}

std::string default_of(const Option& option) {
  if (const auto* real = std::get_if<double*>(&option.value)) return fmt::format("{}", **real);
  if (const auto* whole = std::get_if<std::int64_t*>(&option.value)) return fmt::format("{}", **whole);
  if (const auto* word = std::get_if<std::string*>(&option.value)) return **word;
  if (const auto* list = std::get_if<std::vector<std::string>*>(&option.value))
    return fmt::format("{}", fmt::join(**list, ","));
  return {};
}

// True for the default of an option, also in another form: "10.0" for 10.
bool is_default(const Option& option, const std::string& text) {
  if (text == default_of(option)) return true;
  const bool number =
      std::holds_alternative<double*>(option.value) || std::holds_alternative<std::int64_t*>(option.value);
  char* end = nullptr;
  return number && std::strtod(text.c_str(), &end) == std::stod(default_of(option)) && *end == '\0';
}

}  // namespace

void Flags::add(CLI::App& command, const std::string& stage,
                const std::map<std::string, std::string>& defaults) {
  for (const Option& option : usual_options()) {
    if (option.flag.empty() || !has_flag(stage, option)) continue;
    given.emplace_back(option.key, std::make_unique<std::string>());
    std::string help = option.help;
    if (!option.choices.empty()) {
      help += " (";
      for (const std::string& choice : option.choices)
        help += choice + (&choice == &option.choices.back() ? ")" : " | ");
    }
    const auto other = defaults.find(option.key);
    const std::string standard = other == defaults.end() ? default_of(option) : other->second;
    if (!standard.empty())
      help += fmt::format(" [{}{}{}]", standard, option.unit.empty() ? "" : " ", option.unit);
    command.add_option(option.flag, *given.back().second, help)
        ->group(option.common                         ? "Options"
                : option.stage == "model"             ? "Model"
                : option.stage == "files"             ? "Files"
                : option.key.starts_with("accuracy.") ? "Accuracy"
                                                      : "Simulation")
        ->type_name(option.unit.empty() ? "" : option.unit);
  }
  command.add_option("--config", config_file, "TOML file with options; see `dimple options`")
      ->type_name("FILE");
  command.add_option("--set", sets, "any option, as section.key=value")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
}

Description Flags::stated(const CLI::App& command) const {
  Description result;
  if (!config_file.empty()) read_config(result, config_file);
  GivenOnce once;
  for (const std::string& pair : sets) {
    const auto equals = pair.find('=');
    if (equals == std::string::npos)
      throw UsageError({.fact = fmt::format("'{}' is not key=value", pair),
                        .where = "--set",
                        .why = "there is no =",
                        .remedy = "for instance --set material.mu=300Pa"});
    once.add(pair.substr(0, equals), pair.substr(equals + 1), "--set");
    set_option(result, pair.substr(0, equals), pair.substr(equals + 1), "--set");
  }
  for (const Option& option : usual_options())
    for (const auto& [key, text] : given)
      if (key == option.key && command.count(option.flag) > 0 &&
          !(defaults_are_unsaid && is_default(option, *text))) {
        once.add(key, *text, option.flag);
        set_option(result, key, *text, option.flag);
      }
  return result;
}

Description Flags::described(const CLI::App& command) const {
  Description result = stated(command);
  complete(result);
  return result;
}

Description Flags::described(const CLI::App& command, const std::string& image) const {
  Description result = described(command);
  if (!image.empty()) set_option(result, "image.file", image, "command line");
  return result;
}

double quantity(const std::string& text, const std::string& flag, const std::string& unit,
                const std::string& help) {
  double value = 0.0;
  set_value({.key = flag,
             .flag = flag,
             .unit = unit,
             .value = &value,
             .most = 1e9,
             .least_excluded = true,
             .help = help},
            text, flag);
  return value;
}

void add_common(CLI::App& command, Invocation& shared) {
  command.add_flag("-q,--quiet", shared.quiet, "errors only");
  command.add_flag("-v,--verbose", shared.verbose, "more detail");
  command.add_flag("--json", shared.json, "print the result as JSON on stdout");
  command.add_option("--threads", shared.threads, "largest number; results are the same [all]")
      ->check(CLI::Range(1, 1024));
  add_time_limit(command, shared);
}

void add_time_limit(CLI::App& command, Invocation& shared) {
  command
      .add_option("--time-limit", shared.time_limit,
                  "end after this time, as Ctrl-C does, with exit code 130: 60s, 5min, 2h [none]")
      ->type_name("TIME");
}

void add_over_results(CLI::App& command, Invocation& shared, bool resumable) {
  CLI::Option* rerun = command.add_flag("--force", shared.force, "replace the results of an earlier run");
  if (resumable)
    command.add_flag("--resume", shared.resume, "continue a stopped run from its last checkpoint")
        ->excludes(rerun);
}

void into_folder(Invocation& shared, const std::string& input) {
  shared.leaves_word = true;
  if (shared.image.empty()) shared.image = input;
  shared.ending.last_words(
      [folder = shared.out, command = shared.command, input = shared.image](const Stopped& why) {
        write_status(folder, command, input, why, warnings_so_far());
      });
}

namespace {

// Commands and files that open the results in the folder, separated by commas.
std::string to_open(const std::filesystem::path& folder) {
  std::vector<std::string> words;
  for (const char* file : {"report.html", "overview.png"})
    if (words.empty() && std::filesystem::exists(folder / file))
      words.push_back((folder / file).string() + (std::string(file) == "report.html" ? " in a browser" : ""));
  if (std::filesystem::exists(folder / "view.py"))
    words.push_back("paraview --state=" + shell_word((folder / "view.py").string()));
  return fmt::format("{}", fmt::join(words, ", "));
}

}  // namespace

int finish(const Invocation& shared, const Outcome& outcome) {
  clear_stage_line();
  if (!outcome.times.empty()) say("time     " + times_in_words(seconds_since_start(), outcome.times));
  if (shared.json)
    print_json(outcome.summary_json);
  else
    print(fmt::format("{}\t{}\n{}{}", printable(outcome.headline), printable(shared.out),
                      printable(outcome.further), outcome.further.empty() ? "" : "\n"));
  std::fflush(stdout);
  if (!outcome.ended_by.empty())
    print_error(fmt::format("dimple: {}\n", printable(outcome.ended_by)));
  else if (const std::string open = to_open(shared.out); !open.empty())
    say("open     " + open);
  return static_cast<int>(outcome.interrupted ? ExitCode::interrupted : ExitCode::ok);
}

std::function<void(const std::string&)> progress_of(const Invocation& shared) {
  return [&shared](const std::string& line) {
    if (!shared.quiet) print_error(printable(line) + "\n");
  };
}

}  // namespace dimple
