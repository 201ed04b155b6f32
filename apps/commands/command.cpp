#include "apps/commands/command.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <sstream>

#include "apps/commands/log.hpp"
#include "io/error.hpp"

namespace dimple {

namespace {

// "run" has all flags, "" all that decide a result, "solve" those of the simulation and of its files.
bool has_flag(const std::string& command, const std::string& option) {
  if (option == "files") return command == "run" || command == "solve";
  if (option == "run") return command == "run";
  return command.empty() || command == "run" || option == command;
}

}  // namespace

void Flags::add(CLI::App& command, const std::string& stage) {
  Config defaults;
  for (const Option& option : options_of(defaults)) {
    if (option.flag.empty() || !has_flag(stage, option.stage)) continue;
    given.emplace_back(option.key, std::make_unique<std::string>());
    std::string help = option.help;
    if (!option.choices.empty()) {
      help += " (";
      for (const std::string& choice : option.choices)
        help += choice + (&choice == &option.choices.back() ? ")" : " | ");
    }
    std::string standard;
    if (auto* real = std::get_if<double*>(&option.value)) standard = fmt::format("{}", **real);
    if (auto* whole = std::get_if<std::int64_t*>(&option.value)) standard = fmt::format("{}", **whole);
    if (auto* word = std::get_if<std::string*>(&option.value)) standard = **word;
    if (auto* list = std::get_if<std::vector<std::string>*>(&option.value))
      standard = fmt::format("{}", fmt::join(**list, ","));
    if (!standard.empty())
      help += fmt::format(" [{}{}{}]", standard, option.unit.empty() ? "" : " ", option.unit);
    command.add_option(option.flag, *given.back().second, help)
        ->group(option.stage == "model"   ? "Model"
                : option.stage == "files" ? "Files"
                : option.stage == "run"   ? "Accuracy"
                                          : "Simulation")
        ->type_name(option.unit.empty() ? "" : option.unit);
  }
  command.add_option("--config", config_file, "TOML file with options; see `dimple options`")
      ->type_name("FILE");
  command.add_option("--set", sets, "any option, as section.key=value")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
}

Config Flags::config(const CLI::App& command) const {
  Config result;
  if (!config_file.empty()) read_config(result, config_file);
  for (const std::string& pair : sets) {
    const auto equals = pair.find('=');
    if (equals == std::string::npos)
      throw UsageError({.fact = fmt::format("'{}' is not key=value", pair),
                        .where = "--set",
                        .why = "there is no =",
                        .remedy = "for instance --set material.mu=300Pa"});
    set_option(result, pair.substr(0, equals), pair.substr(equals + 1), "--set");
  }
  Config defaults;
  for (const Option& option : options_of(defaults))
    for (const auto& [key, text] : given)
      if (key == option.key && command.count(option.flag) > 0) set_option(result, key, *text, option.flag);
  resolve_young(result);
  return result;
}

Config Flags::config(const CLI::App& command, const std::string& image) const {
  Config result = config(command);
  if (!image.empty()) set_option(result, "image.file", image, "command line");
  return result;
}

void add_common(CLI::App& command, Invocation& shared) {
  command.add_flag("-q,--quiet", shared.quiet, "errors only");
  command.add_flag("-v,--verbose", shared.verbose, "more detail");
  command.add_flag("--json", shared.json, "print the result as JSON on stdout");
  command.add_option("--threads", shared.threads, "at most this many; results do not depend on it [all]")
      ->check(CLI::Range(1, 1024));
  command
      .add_option("--time-limit", shared.time_limit,
                  "end after this long as Ctrl-C does, with the best state so far and exit code 130, for "
                  "instance 60s, 5min, 2h [none]")
      ->type_name("TIME");
}

void add_over_results(CLI::App& command, Invocation& shared, bool resumable) {
  CLI::Option* anew =
      command.add_flag("--force", shared.force, "replace what an earlier run left in the folder");
  if (resumable)
    command
        .add_flag("--resume", shared.resume, "go on with a run that was stopped, from its last checkpoint")
        ->excludes(anew);
}

void into_folder(Invocation& shared, const std::string& input) {
  shared.leaves_word = true;
  if (shared.image.empty()) shared.image = input;
  shared.ending.last_words(
      [folder = shared.out, command = shared.command, input = shared.image](const Stopped& why) {
        leave_word(folder, command, input, why, warnings_so_far());
      });
}

int finish(const Invocation& shared, const Outcome& outcome) {
  if (shared.json)
    fmt::print("{}", outcome.summary_json);
  else
    fmt::print("{}\t{}\n", outcome.headline, shared.out);
  if (!outcome.ended_by.empty()) std::fputs(fmt::format("dimple: {}\n", outcome.ended_by).c_str(), stderr);
  return static_cast<int>(outcome.interrupted ? ExitCode::interrupted : ExitCode::ok);
}

std::function<void(const std::string&)> progress_of(const Invocation& shared) {
  return [&shared](const std::string& line) {
    if (!shared.quiet) fmt::print(stderr, "{}\n", line);
  };
}

std::string wrapped(const std::string& text, std::size_t column) {
  constexpr std::size_t width = 100;
  std::string result;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t begin = std::min(line.find_first_not_of(' '), line.size());
    const bool listed = begin > 0 && line.size() > column && line[column - 1] == ' ';
    const std::size_t indent = listed ? column : begin;
    while (line.size() > width) {
      const std::size_t blank = line.rfind(' ', width);
      if (blank == std::string::npos || blank <= indent) break;
      result += line.substr(0, blank) + '\n';
      line = std::string(indent, ' ') + line.substr(blank + 1);
    }
    result += line + '\n';
  }
  return result;
}

}  // namespace dimple
