#include "apps/commands/command_line.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <csignal>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/slicer.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/commands/whole_program.hpp"
#include "apps/run/result_folder.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/unless_stopped.hpp"
#include "apps/scene/tool_words.hpp"
#include "io/error.hpp"
#include "io/text.hpp"

namespace dimple {

namespace {

constexpr const char* footer = R"(Examples:
  dimple phantom brain.nrrd                make a swine-brain-sized image
  dimple run brain.nrrd -o out             from the image to the force curve
  dimple run brain.nrrd -o out --label left_hemisphere --depth 5mm
  dimple run brain.nrrd -o out --resume    continue a stopped run
  dimple fit brain.nrrd --curve a.csv -o out   the modulus of a measured curve
  dimple batch cases.csv -o out            one run for each row of a table
Lengths are in mm, stresses in Pa, unless the number says otherwise (0.3kPa, 1cm). Positions are LPS.
Arguments after -- are not read as options: dimple info -- -odd.nrrd
Ctrl-C ends any command within 2 s, and so does --time-limit: files on disk are then valid.
Exit codes: 0 ok, 1 internal error, 2 command line or configuration, 3 input unreadable or unusable, 4 model could not be built, 5 solution failed, 6 results could not be written, 130 interrupted, or out of the time given by --time-limit.)";

// Help as wide as the terminal, with only the common options unless all are requested.
class WrappedHelp : public CLI::Formatter {
 public:
  WrappedHelp() {
    width_ = terminal_width(STDOUT_FILENO);
    constexpr std::size_t narrow = 80;
    if (width_ < narrow) column_width(24);
  }
  std::string make_help(const CLI::App* app, std::string name, CLI::AppFormatMode mode) const override {
    const std::string text = mode == CLI::AppFormatMode::Normal
                                 ? make_description(app) + make_usage(app, name) + make_positionals(app) +
                                       common_options(app) + make_subcommands(app, mode) +
                                       (app->get_parent() ? "" : '\n' + make_footer(app))
                                 : CLI::Formatter::make_help(app, name, mode);
    return wrapped(text, get_column_width(), width_);
  }

 private:
  std::string common_options(const CLI::App* app) const {
    const std::string common = "Options";
    std::vector<std::string> others;
    for (const std::string& group : app->get_groups())
      if (!group.empty() && group != common) others.push_back(group);
    std::string text = make_group(common, false, app->get_options([&](const CLI::Option* option) {
      return option->get_group() == common && option->nonpositional();
    }));
    if (!others.empty())
      text += fmt::format("\n--help-all lists more options, in the groups {}.\n", fmt::join(others, ", "));
    return text;
  }

  std::size_t width_ = 80;
};

int report(const Error& error, bool json) {
  const Report& r = error.report;
  std::string text = fmt::format("dimple: {}\n", printable(r.fact));
  if (!r.where.empty()) text += fmt::format("  where: {}\n", printable(r.where));
  if (!r.why.empty()) text += fmt::format("  why:   {}\n", printable(r.why));
  if (!r.remedy.empty()) text += fmt::format("  try:   {}\n", printable(r.remedy));
  text += fmt::format("  code:  {}\n", printable(r.code));
  clear_stage_line();
  print_error(text);
  if (json) {
    Json ended;
    end_otherwise(ended, error);
    print_json(as_text(ended));
  }
  return static_cast<int>(error.code);
}

// Physics that is not modelled, with the option names that a user might try.
struct NotModelled {
  std::vector<std::string> flags;
  std::string what, closest;
};

const std::vector<NotModelled>& not_modelled() {
  static const std::vector<NotModelled> list = {
      {{"--body-force", "--acceleration"},
       "a body force other than gravity has no flag of its own",
       "--gravity inferior, --gravity x,y,z in m/s2, or --set load.body_force.NAME.force=x,y,z in N/m3"},
      {{"--load"},
       "a force cannot be prescribed: the tool is pressed to a depth, and the force is computed",
       "--depth 2mm; read the depth at that force off force.csv"},
      {{"--tool", "--sphere", "--cone", "--indenter", "--indenter-shape", "--tool-shape"},
       "only `dimple run`, `fit`, `places` and `poke` have a tool of another shape: --tool",
       fmt::format("dimple run IMAGE --tool {} or probe.stl", fmt::join(tool_examples(), ", "))},
      {{"--unload", "--unloading", "--retract", "--relax", "--hold"},
       "steps of a scene hold and lift a tool, in equilibrium",
       "--set step.press.move=4mm --set step.hold.time=5s --set step.lift.move=-2mm, or `dimple poke IMAGE "
       "--script PATH`, which moves a tool in and out"},
      {{"--adhesion", "--adhesive", "--stick", "--cohesion"},
       "adhesion is not modelled: a contacting tool never pulls",
       "--tool with --friction stick; or the bonded indenter, which pulls"},
      {{"--landmarks", "--targets", "--stress-at", "--probe"},
       "results at named points are written only for a brain shift (dimple shift --target)",
       "--quantity displacement@x,y,z for one point with its error bounds; nodes/*.vtu and ParaView's probe "
       "for stress"},
      {{"--friction", "--mu-friction", "--friction-coefficient"},
       "only `dimple run` and `dimple fit` have friction, under a contacting tool: --friction",
       "dimple run IMAGE --tool sphere:5mm --friction 0.3; the bonded indenter has --contact bonded or "
       "frictionless"},
      {{"--cut", "--cutting", "--incision", "--tear", "--fracture"},
       "cuts are made before the load (--cut) or in a step of a scene; tearing is not modelled",
       "dimple run IMAGE --cut line:x,y,z,x,y,z,depth=15mm, plane:x,y,z,nx,ny,nz, sheet.stl or label:NAME"},
      {{"--skin", "--pia", "--shell", "--capsule"},
       "bending shells are not modelled: a film on the organ resists only stretching",
       "--membrane 0.1mm:400kPa, or a label for its layer with its own stiffness, --set "
       "tissue.LABEL.mu=3kPa"}};
  return list;
}

bool has_option(const CLI::App& app, const std::vector<std::string>& words, const std::string& flag) {
  for (const CLI::App* command : app.get_subcommands({}))
    if (!words.empty() && command->get_name() == words[0]) return command->get_option_no_throw(flag);
  return false;
}

// Throws UsageError if a word is an option for physics that the command does not model.
void refuse_what_is_not_modelled(const CLI::App& app, const std::vector<std::string>& words) {
  for (const std::string& word : words)
    for (const NotModelled& one : not_modelled())
      if (const std::string flag = word.substr(0, word.find('='));
          std::find(one.flags.begin(), one.flags.end(), flag) != one.flags.end() &&
          !has_option(app, words, flag))
        throw UsageError(
            {.fact = one.what,
             .where = flag,
             .why = "the model covers quasi-static and dynamic indentation with a flat circular patch, "
                    "bonded or frictionless, and quasi-static contact with other tools, with or without "
                    "friction, of elastic and viscoelastic tissue on a fixed base",
             .remedy = fmt::format("closest: {}", one.closest),
             .code = "not-modelled"});
}

// Key of a flag as --set accepts it, "load.depth" for "--depth"; empty: not in the table.
std::string key_of(const std::string& flag) {
  for (const Option& option : usual_options())
    if (option.flag == flag) return without_unit(option);
  return {};
}

[[noreturn]] void usage_error(const CLI::App& app, const CLI::ParseError& error,
                              const std::vector<std::string>& words) {
  refuse_what_is_not_modelled(app, words);
  std::vector<std::string> commands, flags;
  for (const CLI::App* command : app.get_subcommands({})) {
    commands.push_back(command->get_name());
    for (const CLI::Option* option : command->get_options())
      for (const std::string& name : option->get_lnames()) flags.push_back("--" + name);
  }
  std::string fact = error.what(), remedy = "see `dimple --help`, or `dimple COMMAND --help`",
              why = "it does not follow the usage of the command";
  // Message of CLI11: "--depth: At Most 1 required but received 2"
  if (const std::size_t twice = fact.find(": At Most 1 required but received "); twice != std::string::npos) {
    fact = fmt::format("{} is given {} times", fact.substr(0, twice), fact.substr(fact.rfind(' ') + 1));
    why = "an option has one value";
    remedy = "leave all but one of them out";
  }
  // Message of CLI11: "--gravity: 1 required TEXT missing"
  if (const std::size_t missing = fact.find(": 1 required"); missing != std::string::npos)
    fact = fmt::format("{} has no value", fact.substr(0, missing));
  if (!words.empty() && words[0].rfind("-", 0) != 0 &&
      std::find(commands.begin(), commands.end(), words[0]) == commands.end()) {
    fact = fmt::format("there is no command '{}'{}", words[0], did_you_mean(words[0], commands));
    if (words[0] == "view") remedy = "open report.html or overview.png in the folder of a run";
  } else {
    for (const std::string& word : words) {
      if (word == "--") break;  // the rest are arguments
      const std::string flag = word.substr(0, word.find('='));
      if (flag.rfind("--", 0) == 0 && std::find(flags.begin(), flags.end(), flag) == flags.end() &&
          flag != "--help" && flag != "--help-all" && flag != "--version")
        fact = fmt::format("there is no option {}{}", flag, did_you_mean(flag, flags));
      else if (flag.rfind("--", 0) == 0 && !has_option(app, words, flag)) {
        fact = fmt::format("`dimple {}` has no option {}", words[0], flag);
        if (flag == "--wall" || flag == "--membrane")  // also refused as --set load.wall
          remedy = fmt::format("`dimple run` has {}", flag);
        else if (const std::string key = key_of(flag); !key.empty() && has_option(app, words, "--set"))
          remedy = fmt::format("give it as --set {}={}", key,
                               word.size() > flag.size() ? word.substr(flag.size() + 1) : "VALUE");
        break;
      }
    }
  }
  throw UsageError({.fact = fact, .where = "command line", .why = why, .remedy = remedy});
}

// 3D Slicer runs one program as one module and gives flags without a command.
std::vector<std::string> as_run(std::vector<std::string> words) {
  const std::vector<std::string> own = {"-h", "--help", "--help-all", "--version"};
  if (!words.empty() && words[0].starts_with("-") && std::find(own.begin(), own.end(), words[0]) == own.end())
    words.insert(words.begin(), "run");
  return words;
}

// Runs the requested command.
int perform(Invocation& shared, const ProgramParts& parts) {
  CLI::App app{"From a label image to a force: meshless soft-tissue indentation with one command.", "dimple"};
  app.formatter(std::make_shared<WrappedHelp>());
  app.footer(footer);
  app.set_help_all_flag("--help-all", "all options");
  app.set_version_flag("--version", "dimple " DIMPLE_VERSION);
  app.require_subcommand(0, 1);
  std::vector<Command> commands;
  for (const auto add : parts.commands) commands.push_back(add(app, shared));

  const std::vector<std::string>& words = shared.words = as_run(std::move(shared.words));
  if (std::find(words.begin(), words.end(), "--xml") != words.end() && words.front() == "run") {
    print(slicer_xml());
    return 0;
  }
  try {
    app.parse(std::vector<std::string>(words.rbegin(), words.rend()));  // parse() reads from the end
  } catch (const CLI::CallForHelp& e) {
    return app.exit(e);
  } catch (const CLI::CallForAllHelp& e) {
    return app.exit(e);
  } catch (const CLI::CallForVersion& e) {
    return app.exit(e);
  } catch (const CLI::ParseError& e) {
    if (!parts.whole) become_whole_program(words);  // it has the flags of all commands
    usage_error(app, e, words);
  }
  start_log(shared.quiet     ? Verbosity::quiet
            : shared.verbose ? Verbosity::verbose
                             : Verbosity::normal,
            shared.slicer);
  std::optional<tbb::global_control> limit;
  if (shared.threads > 0)
    limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(shared.threads));
  if (!shared.time_limit.empty())
    shared.ending.limit(quantity(shared.time_limit, "--time-limit", "s", "the time after which to end"));
  std::signal(SIGXFSZ, SIG_IGN);  // a limit on file sizes is handled like a full disk

  for (const Command& command : commands)
    if (*command.app) {
      shared.command = command.app->get_name();
      return command.perform();
    }
  print(app.help());
  return 0;
}

int answered(Invocation& shared, const ProgramParts& parts) {
  const auto fail = [&](const Error& error) {
    if (shared.leaves_word) write_status(shared.out, shared.command, shared.image, error, warnings_so_far());
    return report(error, shared.json);
  };
  try {
    return unless_stopped([&] { return perform(shared, parts); });
  } catch (const Error& error) {
    return fail(error);
  } catch (const std::bad_alloc&) {
    return fail(ModelError({.fact = "not enough memory",
                            .where = "",
                            .why = "the image or the model is too large for this machine",
                            .remedy = "use fewer nodes (--nodes) or crop the image"}));
  } catch (const std::exception& error) {
    if (std::ferror(stdout)) return static_cast<int>(ExitCode::output);  // command_line() reports it
    return fail(Error(ExitCode::internal, {.fact = error.what(),
                                           .where = "",
                                           .why = "this is an error in the program",
                                           .remedy = "please report it with the command that you used"}));
  }
}

}  // namespace

int command_line(int argc, char** argv, const ProgramParts& parts) {
  const std::vector<std::string> words(argv + (argc > 0 ? 1 : 0), argv + argc);
  if (!parts.whole && needs_whole_program(words)) become_whole_program(words);
  Ending ending;  // signals are handled from here on
  Invocation shared{.ending = ending, .words = words, .explain = parts.explain};
  const int code = answered(shared, parts);
  end_log();
  if (std::fflush(stdout) == 0 && !std::ferror(stdout)) return code;
  return report(OutputError({.fact = "the result could not be printed",
                             .where = "standard output",
                             .why = "the output accepts no more data: a full disk, for instance",
                             .remedy = "make room there; files in the output folder are complete"}),
                false);
}

}  // namespace dimple
