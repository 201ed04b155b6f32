#include "apps/commands/command_line.hpp"

#include <fmt/format.h>
#include <tbb/global_control.h>

#include <csignal>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {

// Every subcommand, each in a file of its name, in the order of the help.
Command add_phantom(CLI::App& app, Invocation& shared);
Command add_info(CLI::App& app, Invocation& shared);
Command add_model(CLI::App& app, Invocation& shared);
Command add_solve(CLI::App& app, Invocation& shared);
Command add_run(CLI::App& app, Invocation& shared);
Command add_converge(CLI::App& app, Invocation& shared);
Command add_fit(CLI::App& app, Invocation& shared);
Command add_chart(CLI::App& app, Invocation& shared);
Command add_stress(CLI::App& app, Invocation& shared);
Command add_export(CLI::App& app, Invocation& shared);
Command add_options(CLI::App& app, Invocation& shared);
Command add_verify(CLI::App& app, Invocation& shared);

namespace {

constexpr Command (*subcommands[])(CLI::App&, Invocation&) = {
    add_phantom, add_info,  add_model,  add_solve,  add_run,     add_converge,
    add_fit,     add_chart, add_stress, add_export, add_options, add_verify};

constexpr const char* footer = R"(Examples:
  dimple phantom brain.nrrd                  make a swine-brain-sized label image
  dimple run brain.nrrd -o out               from the image to the force curve
  dimple run patient.seg.nrrd -o out --label Brain --indent-at left --depth 5mm
  dimple run brain.nrrd -o out --resume      go on with that run if it was stopped
  dimple fit brain.nrrd --curve measured.csv -o out   the modulus from a measured curve
  dimple verify -o out                       compare with closed forms and finite elements
Lengths are in mm, stresses in Pa, unless the number says otherwise (0.3kPa, 1cm). Positions are LPS.
Ctrl-C ends any command within 2 s, and so does --time-limit: what is on disk then is valid.
Exit codes: 0 ok, 1 internal error, 2 command line or configuration, 3 input unreadable or unusable,
4 model could not be built, 5 solution failed, 6 results could not be written, 130 interrupted, or out
of the time given by --time-limit.)";

class WrappedHelp : public CLI::Formatter {
 public:
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
    return wrapped(CLI::Formatter::make_help(app, std::move(name), mode), get_column_width());
  }
};

int report(const Error& error, bool json) {
  const Report& r = error.report;
  std::string text = fmt::format("dimple: {}\n", r.fact);
  if (!r.where.empty()) text += fmt::format("  where: {}\n", r.where);
  if (!r.why.empty()) text += fmt::format("  why:   {}\n", r.why);
  if (!r.remedy.empty()) text += fmt::format("  try:   {}\n", r.remedy);
  text += fmt::format("  code:  {}\n", r.code);
  std::fputs(text.c_str(), stderr);  // fmt::print throws where stderr is a full disk
  if (json)
    fmt::print("{}\n", nlohmann::ordered_json(
                           {{"status", error.code == ExitCode::interrupted ? "interrupted" : "failed"},
                            {"exit_code", static_cast<int>(error.code)},
                            {"failure",
                             {{"code", r.code},
                              {"fact", r.fact},
                              {"where", r.where},
                              {"why", r.why},
                              {"remedy", r.remedy}}}})
                           .dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace));
  return static_cast<int>(error.code);
}

[[noreturn]] void usage_error(const CLI::App& app, const CLI::ParseError& error,
                              const std::vector<std::string>& words) {
  std::vector<std::string> commands, flags;
  for (const CLI::App* command : app.get_subcommands({})) {
    commands.push_back(command->get_name());
    for (const CLI::Option* option : command->get_options())
      for (const std::string& name : option->get_lnames()) flags.push_back("--" + name);
  }
  std::string fact = error.what();
  if (!words.empty() && words[0].rfind("-", 0) != 0 &&
      std::find(commands.begin(), commands.end(), words[0]) == commands.end())
    fact = fmt::format("there is no command '{}'{}", words[0], did_you_mean(words[0], commands));
  else
    for (const std::string& word : words) {
      const std::string flag = word.substr(0, word.find('='));
      if (flag.rfind("--", 0) == 0 && std::find(flags.begin(), flags.end(), flag) == flags.end() &&
          flag != "--help" && flag != "--version")
        fact = fmt::format("there is no option {}{}", flag, did_you_mean(flag, flags));
    }
  throw UsageError({.fact = fact,
                    .where = "command line",
                    .why = "it does not follow the usage of the command",
                    .remedy = "see `dimple --help`, or `dimple COMMAND --help`"});
}

// The command that was asked for.
int perform(int argc, char** argv, Invocation& shared) {
  CLI::App app{
      "From a label image to a force: meshless soft-tissue indentation, without a mesh and by one command.",
      "dimple"};
  app.formatter(std::make_shared<WrappedHelp>());
  app.footer(footer);
  app.set_version_flag("--version", "dimple " DIMPLE_VERSION);
  app.require_subcommand(0, 1);
  std::vector<Command> commands;
  for (const auto add : subcommands) commands.push_back(add(app, shared));

  const std::vector<std::string> words(argv + 1, argv + argc);
  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp& e) {
    return app.exit(e);
  } catch (const CLI::CallForAllHelp& e) {
    return app.exit(e);
  } catch (const CLI::CallForVersion& e) {
    return app.exit(e);
  } catch (const CLI::ParseError& e) {
    usage_error(app, e, words);
  }
  start_log(shared.quiet ? Verbosity::quiet : shared.verbose ? Verbosity::verbose : Verbosity::normal);
  std::optional<tbb::global_control> limit;
  if (shared.threads > 0)
    limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(shared.threads));
  if (!shared.time_limit.empty()) {
    double seconds = 0.0;
    const std::string flag = "--time-limit";
    set_value({flag, flag, "s", "the time after which to end", &seconds, 0, 1e9, true, {}, ""},
              shared.time_limit, flag);
    shared.ending.limit(seconds);
  }
  std::signal(SIGXFSZ, SIG_IGN);  // a limit on the size of files is to be met as a full disk is

  for (const Command& command : commands)
    if (*command.app) {
      shared.command = command.app->get_name();
      return command.perform();
    }
  fmt::print("{}", app.help());
  return 0;
}

int answered(int argc, char** argv, Invocation& shared) {
  const auto fail = [&](const Error& error) {
    // Whatever goes wrong while everything is being stopped is a consequence of that.
    const auto tell = [&](const Error& reason) {
      if (shared.leaves_word) leave_word(shared.out, shared.command, shared.image, reason, warnings_so_far());
      return report(reason, shared.json);
    };
    const StopReason why = stop_asked();
    return why == StopReason::none ? tell(error) : tell(Stopped(why));
  };
  try {
    return perform(argc, argv, shared);
  } catch (const Error& error) {
    return fail(error);
  } catch (const std::bad_alloc&) {
    return fail(ModelError({.fact = "not enough memory",
                            .where = "",
                            .why = "the image or the model is too large for this machine",
                            .remedy = "use fewer nodes (--nodes) or crop the image"}));
  } catch (const std::exception& error) {
    if (std::ferror(stdout)) return static_cast<int>(ExitCode::output);  // command_line() says so
    return fail(Error(ExitCode::internal, {.fact = error.what(),
                                           .where = "",
                                           .why = "this is a mistake of ours",
                                           .remedy = "please report it with the command that you used"}));
  }
}

}  // namespace

int command_line(int argc, char** argv) {
  Ending ending;  // first of all: a signal is answered from here on
  Invocation shared{.ending = ending};
  const int code = answered(argc, argv, shared);
  if (std::fflush(stdout) == 0 && !std::ferror(stdout)) return code;
  return report(OutputError({.fact = "the result could not be printed",
                             .where = "standard output",
                             .why = "what it goes to takes no more: a full disk, for instance",
                             .remedy = "make room there; files in the output folder are complete"}),
                false);
}

}  // namespace dimple
