#include "apps/command_line.hpp"

#include <fmt/format.h>
#include <tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/accuracy_chart.hpp"
#include "apps/config.hpp"
#include "apps/converge.hpp"
#include "apps/export.hpp"
#include "apps/log.hpp"
#include "apps/pipeline.hpp"
#include "apps/stress.hpp"
#include "apps/verify.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "preprocess/phantom.hpp"

namespace dimple {
namespace {

std::atomic<bool> stop{false};

// The first Ctrl-C asks the solver to finish what it has; the second one kills.
extern "C" void on_interrupt(int) {
  stop = true;
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

constexpr const char* footer = R"(Examples:
  dimple phantom brain.nrrd                  make a swine-brain-sized label image
  dimple run brain.nrrd -o out               from the image to the force curve
  dimple run patient.seg.nrrd -o out --label Brain --indent-at left --depth 5mm
  dimple run brain.nrrd -o out --resume      go on with that run if it was stopped
  dimple verify -o out                       compare with closed forms and finite elements
Lengths are in mm, stresses in Pa, unless the number says otherwise (0.3kPa, 1cm). Positions are LPS.
Exit codes: 0 ok, 1 internal error, 2 command line or configuration, 3 input unreadable or unusable,
4 model could not be built, 5 solution failed, 6 results could not be written, 130 interrupted.)";

int report(const Error& error, bool json) {
  const Report& r = error.report;
  std::string text = fmt::format("dimple: {}\n", r.fact);
  if (!r.where.empty()) text += fmt::format("  where: {}\n", r.where);
  if (!r.why.empty()) text += fmt::format("  why:   {}\n", r.why);
  if (!r.remedy.empty()) text += fmt::format("  try:   {}\n", r.remedy);
  text += fmt::format("  code:  {}\n", r.code);
  std::fputs(text.c_str(), stderr);  // fmt::print throws where stderr is a full disk
  if (json)
    fmt::print("{}\n", nlohmann::ordered_json({{"status", "failed"},
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

// Flags made from the option table: their text is kept and given to set_option(), which knows units and
// ranges.
struct Flags {
  std::vector<std::pair<std::string, std::unique_ptr<std::string>>> given;  // key, text
  std::string config_file;
  std::vector<std::string> sets;

  void add(CLI::App& command, const std::string& stage) {
    Config defaults;
    for (const Option& option : options_of(defaults)) {
      if (option.flag.empty() || (!stage.empty() && option.stage != stage)) continue;
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
      if (!standard.empty())
        help += fmt::format(" [{}{}{}]", standard, option.unit.empty() ? "" : " ", option.unit);
      command.add_option(option.flag, *given.back().second, help)
          ->group(option.stage == "model" ? "Model" : "Simulation")
          ->type_name(option.unit.empty() ? "" : option.unit);
    }
    command.add_option("--config", config_file, "TOML file with options; see `dimple options`")
        ->type_name("FILE");
    command.add_option("--set", sets, "any option, as section.key=value")
        ->type_name("KEY=VALUE")
        ->allow_extra_args(false);
  }

  // Defaults, then the file, then --set, then flags.
  Config config(const CLI::App& command) const {
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
    return result;
  }
};

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

int perform(int argc, char** argv) {
  CLI::App app{
      "From a label image to a force: meshless soft-tissue indentation, without a mesh and by one command.",
      "dimple"};
  app.footer(footer);
  app.set_version_flag("--version", "dimple " DIMPLE_VERSION);
  app.require_subcommand(0, 1);

  bool quiet = false, verbose = false, json = false, force = false, resume = false;
  int threads = 0;
  std::string image, label_names, out, model;
  const auto common = [&](CLI::App* command) {
    command->add_flag("-q,--quiet", quiet, "errors only");
    command->add_flag("-v,--verbose", verbose, "more detail");
    command->add_flag("--json", json, "print the result as JSON on stdout");
    command->add_option("--threads", threads, "at most this many; results do not depend on it [all]")
        ->check(CLI::Range(1, 1024));
  };

  const auto over_results = [&](CLI::App* command, bool resumable) {
    CLI::Option* anew = command->add_flag("--force", force, "replace what an earlier run left in the folder");
    if (resumable)
      command->add_flag("--resume", resume, "go on with a run that was stopped, from its last checkpoint")
          ->excludes(anew);
  };

  CLI::App* phantom = app.add_subcommand("phantom", "make a label image that needs no download");
  PhantomOptions body;
  std::string size;
  phantom->add_option("OUT", out, "image to write: .nrrd, .seg.nrrd, .nii, .nii.gz, .mha")->required();
  phantom->add_option("--shape", body.shape, "brain, block, cut-ellipsoid, cylinder")->capture_default_str();
  phantom->add_option("--size", size, "extent along L, P, S [mm] (default: the swine brain's)")
      ->type_name("X,Y,Z");
  phantom->add_option("--spacing", body.spacing_mm, "voxel edge [mm]")->capture_default_str();
  phantom->add_flag("--two-labels", body.two_labels, "with a second tissue inside");
  common(phantom);

  CLI::App* info = app.add_subcommand("info", "say what an image holds");
  info->add_option("IMAGE", image, "label image")->required();
  info->add_option("--label-names", label_names,
                   "table of label names (ITK-SNAP or colour table), or totalsegmentator");
  common(info);

  Flags model_flags, solve_flags, run_flags;
  CLI::App* make =
      app.add_subcommand("model", "generate the model of an image: nodes, integration points, base, circle");
  make->add_option("IMAGE", image, "label image");
  make->add_option("-o,--out,--output", out, "folder for the model")->required();
  over_results(make, false);
  model_flags.add(*make, "model");
  common(make);

  CLI::App* solve = app.add_subcommand("solve", "indent a model");
  solve->add_option("MODEL", model, "folder made by `dimple model`, or its model.toml")->required();
  solve->add_option("-o,--out,--output", out, "folder for the results")->required();
  over_results(solve, true);
  solve_flags.add(*solve, "solve");
  common(solve);

  CLI::App* whole = app.add_subcommand("run", "both: from the image to the force curve");
  whole->add_option("IMAGE", image, "label image");
  whole->add_option("-o,--out,--output", out, "folder for the results")->required();
  over_results(whole, true);
  run_flags.add(*whole, "");
  common(whole);

  Flags study_flags;
  ConvergenceOptions study;
  std::string reference;
  CLI::App* several =
      app.add_subcommand("converge", "run one scene with several clouds: how far its force can be trusted");
  several->add_option("IMAGE", image, "label image");
  several->add_option("-o,--out,--output", out, "folder for convergence.csv, .md, .png, .svg")->required();
  several->add_option("--sizes", study.nodes, "numbers of nodes")->delimiter(',')->capture_default_str();
  several->add_option("--densities", study.densities, "of points, as multiples of the usual")
      ->delimiter(',')
      ->capture_default_str();
  several->add_option("--seeds", study.seeds, "clouds of each size")->capture_default_str();
  several->add_option("--reference", reference, "CSV with indentation_mm and force_N to compare with");
  study_flags.add(*several, "");
  common(several);

  Flags chart_flags;
  AccuracyOptions compared;
  CLI::App* chart = app.add_subcommand(
      "chart",
      "draw error against wall time: two scenes whose force is known, an image of yours, and other "
      "programs where they are installed (apt install calculix-ccx)");
  chart->add_option("IMAGE", image, "label image of a third scene; --set and --config are about it alone");
  chart->add_option("-o,--out,--output", out, "folder for chart.csv, chart.png, chart.svg")->required();
  chart->add_option("--only", compared.only, "scenes: a, b, image [all]")->delimiter(',');
  chart->add_option("--nodes", compared.nodes, "numbers of nodes")->delimiter(',')->capture_default_str();
  chart->add_option("--schemes", compared.schemes, "converging, horton2007 (dynamic only)")
      ->delimiter(',')
      ->capture_default_str();
  chart->add_option("--time", compared.times, "quasi-static, dynamic")->delimiter(',')->capture_default_str();
  chart
      ->add_option("--dynamic-nodes", compared.dynamic_nodes, "of dynamic runs [those of --nodes up to 4250]")
      ->delimiter(',');
  chart->add_option("--repeat", compared.repeat, "clouds of each size: times are medians, errors the largest")
      ->capture_default_str();
  chart->add_option("--calculix", compared.calculix, "CalculiX, if not as ccx on PATH; none: leave it out")
      ->type_name("PATH");
  chart->add_option("--febio", compared.febio, "FEBio 4, to run it too")->type_name("PATH");
  chart->add_option("--elements", compared.peer_elements, "of their meshes: hexahedra, tetrahedra")
      ->delimiter(',')
      ->capture_default_str();
  chart->add_option("--peer-nodes", compared.peer_nodes, "nodes of their meshes, about")
      ->delimiter(',')
      ->capture_default_str();
  chart->add_option("--peer-limit", compared.peer_limit_s, "for each run of theirs [s]")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  chart_flags.add(*chart, "none of them");  // --config and --set only
  common(chart);

  Flags stress_flags;
  StressOptions stressed;
  bool list_maps = false;
  CLI::App* atlas = app.add_subcommand(
      "stress",
      "draw where a scene survives and why not: maps over two options each, both schemes side by side");
  atlas->add_option("IMAGE", image, "label image of a scene of yours, with --x and --y [a block made here]");
  atlas->add_option("-o,--out,--output", out, "folder for stress_NAME.csv, .png, .svg; what is done is kept");
  atlas->add_option("--map", stressed.maps, "only these, by name; see --list")->delimiter(',');
  atlas->add_flag("--list", list_maps, "list the maps and stop");
  atlas->add_option("--x", stressed.x, "a map of your own: an option and its values across")
      ->type_name("KEY=V1,V2,...");
  atlas->add_option("--y", stressed.y, "and down; load.depth: all depths from one run")
      ->type_name("KEY=V1,V2,...");
  atlas->add_option("--schemes", stressed.schemes, "converging, horton2007")
      ->delimiter(',')
      ->capture_default_str();
  atlas
      ->add_option("--finest", stressed.finest,
                   "nodes of the runs to compare with; the next where one is not stable")
      ->delimiter(',')
      ->capture_default_str();
  atlas->add_option("--limit", stressed.limit_s, "for each run [s]")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  stress_flags.add(*atlas, "none of them");  // --config and --set only
  common(atlas);

  Flags export_flags;
  std::string format, elements = "hexahedra";
  CLI::App* other = app.add_subcommand(
      "export",
      "write the scene for another program, as a mesh: CalculiX or FEBio; --nodes or --spacing say how "
      "fine");
  other->add_option("IMAGE", image, "label image");
  other->add_option("-o,--out,--output", out, "file to write: .inp (CalculiX) or .feb (FEBio)")->required();
  other->add_option("--format", format, "calculix, febio [from the file's name]");
  other->add_option("--elements", elements, "hexahedra (columns along the push) or tetrahedra (CGAL's)")
      ->capture_default_str();
  export_flags.add(*other, "");
  common(other);

  CLI::App* options =
      app.add_subcommand("options", "list every option with its unit, default, range and meaning");

  CLI::App* check =
      app.add_subcommand("verify", "compute what is known in closed form or by other methods, and compare");
  std::vector<std::string> cases;
  bool list_cases = false;
  Index verify_nodes = 4250;
  check->add_option("--case", cases, "only this one; may be given several times")
      ->type_name("NAME")
      ->allow_extra_args(false);
  check->add_flag("--list", list_cases, "list the cases and stop");
  check->add_option("--nodes", verify_nodes, "of the indented bodies")
      ->check(CLI::Range(200, 1000000))
      ->capture_default_str();
  check->add_option("-o,--out,--output", out, "folder for verify.csv and verify.md");
  common(check);

  const std::vector<std::string> words(argv + 1, argv + argc);
  try {
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
    start_log(quiet ? Verbosity::quiet : verbose ? Verbosity::verbose : Verbosity::normal);
    std::optional<tbb::global_control> limit;
    if (threads > 0)
      limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    std::signal(SIGINT, on_interrupt);
    std::signal(SIGTERM, on_interrupt);
    std::signal(SIGXFSZ, SIG_IGN);  // a limit on the size of files is to be met as a full disk is
    const auto stop_requested = [] { return stop.load(); };

    const auto finish = [&](const Outcome& outcome) {
      if (json)
        fmt::print("{}", outcome.summary_json);
      else
        fmt::print("{}\t{}\n", outcome.headline, out);
      return static_cast<int>(outcome.interrupted ? ExitCode::interrupted : ExitCode::ok);
    };
    const auto with_image = [&](Config config) {
      if (!image.empty()) set_option(config, "image.file", image, "command line");
      return config;
    };

    if (*phantom) {
      if (!size.empty()) {
        const auto three = parse_vector(size);
        if (!three)
          throw UsageError({.fact = fmt::format("'{}' is not a size", size),
                            .where = "--size",
                            .why = "a size is three numbers x,y,z in mm",
                            .remedy = "for instance --size 60,60,30"});
        body.size_mm = *three;
      }
      remove_temporaries_of(out);
      write_label_image(out, make_phantom(body));
      fmt::print("{}\n", out);
      return 0;
    }
    if (*info) {
      describe_image(image, label_names, json);
      return 0;
    }
    const Existing existing = force ? Existing::replace : resume ? Existing::resume : Existing::refuse;
    if (*make) return finish(make_model(with_image(model_flags.config(*make)), out, existing));
    if (*solve) return finish(solve_model(solve_flags.config(*solve), model, out, stop_requested, existing));
    if (*whole) return finish(run(with_image(run_flags.config(*whole)), out, stop_requested, existing));
    if (*several) {
      study.reference = reference;
      // What each of two dozen runs says of itself would hide what the study says.
      if (!verbose) start_log(Verbosity::quiet);
      return finish(
          converge(with_image(study_flags.config(*several)), study, out, [&](const std::string& line) {
            if (!quiet) fmt::print(stderr, "{}\n", line);
          }));
    }
    if (*chart) {
      if (!verbose) start_log(Verbosity::quiet);
      return finish(accuracy_chart(
          with_image(chart_flags.config(*chart)), compared, out,
          [&](const std::string& line) {
            if (!quiet) fmt::print(stderr, "{}\n", line);
          },
          stop_requested));
    }
    if (*atlas) {
      if (list_maps) {
        for (const StressMap& map : stress_maps())
          fmt::print("{:<14} {} x {}\n", map.name, map.x.key, map.y.key);
        return 0;
      }
      if (out.empty())
        throw UsageError({.fact = "no folder for the maps was given",
                          .where = "-o",
                          .why = "there is nowhere to put them",
                          .remedy = "for instance dimple stress -o out, or --list"});
      return finish(stress(
          with_image(stress_flags.config(*atlas)), stressed, out,
          [&](const std::string& line) {
            if (!quiet) fmt::print(stderr, "{}\n", line);
          },
          stop_requested));
    }
    if (*other) return finish(export_model(with_image(export_flags.config(*other)), format, elements, out));
    if (*options) {
      fmt::print("{}", option_reference());
      return 0;
    }
    if (*check) {
      if (list_cases) {
        for (const VerifyGroup& group : verify_groups()) fmt::print("{:<16} {}\n", group.name, group.what);
        return 0;
      }
      const auto rows = verify(cases, verify_nodes, [&](const std::string& group) {
        say(fmt::format("verify   {}", group));
        return !stop_requested();
      });
      if (!out.empty()) {
        make_folder(out);
        for (const auto& [name, text] :
             {std::pair{"verify.csv", verify_csv(rows)}, std::pair{"verify.md", verify_markdown(rows)}}) {
          const std::filesystem::path file = std::filesystem::path(out) / name;
          remove_temporaries_of(file);
          write_file(file, text);
        }
      }
      fmt::print("{}", json ? verify_json(rows) : verify_table(rows));
      if (stop_requested()) return static_cast<int>(ExitCode::interrupted);
      // With --json the failing rows are in what was printed; the error goes to stderr alone.
      json = false;
      require_passed(rows);
      return 0;
    }
    fmt::print("{}", app.help());
    return 0;
  } catch (const Error& error) {
    return report(error, json);
  } catch (const std::bad_alloc&) {
    return report(ModelError({.fact = "not enough memory",
                              .where = "",
                              .why = "the image or the model is too large for this machine",
                              .remedy = "use fewer nodes (--nodes) or crop the image"}),
                  json);
  } catch (const std::exception& error) {
    if (std::ferror(stdout)) return static_cast<int>(ExitCode::output);  // command_line() says so
    return report(Error(ExitCode::internal, {.fact = error.what(),
                                             .where = "",
                                             .why = "this is a mistake of ours",
                                             .remedy = "please report it with the command that you used"}),
                  json);
  }
}

}  // namespace

int command_line(int argc, char** argv) {
  const int code = perform(argc, argv);
  if (std::fflush(stdout) == 0 && !std::ferror(stdout)) return code;
  return report(OutputError({.fact = "the result could not be printed",
                             .where = "standard output",
                             .why = "what it goes to takes no more: a full disk, for instance",
                             .remedy = "make room there; files in the output folder are complete"}),
                false);
}

}  // namespace dimple
