#include "apps/studies/stress.hpp"

#include <fmt/format.h>

#include "apps/commands/command.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/studies/stress_maps.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

struct StressArguments {
  Flags flags;
  StressOptions stressed;
  bool list = false;
  std::string limit;
};

}  // namespace

Command add_stress(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<StressArguments>();
  StressOptions& stressed = options->stressed;
  CLI::App* command = app.add_subcommand(
      "stress",
      "draw where a scene survives and why not: maps over two options each, both schemes side by side");
  command->add_option("IMAGE", shared.image,
                      "label image of a scene of yours, with --x and --y [a block made here]");
  command->add_option("-o,--out,--output", shared.out,
                      "folder for stress_NAME.csv, .png, .svg; what is done is kept");
  command->add_option("--map", stressed.maps, "only these, by name; see --list")->delimiter(',');
  command->add_flag("--list", options->list, "list the maps and stop");
  command->add_option("--x", stressed.x, "a map of your own: an option and its values across")
      ->type_name("KEY=V1,V2,...");
  command->add_option("--y", stressed.y, "and down; load.depth: all depths from one run")
      ->type_name("KEY=V1,V2,...");
  command->add_option("--schemes", stressed.schemes, "converging, horton2007")
      ->delimiter(',')
      ->capture_default_str();
  command
      ->add_option("--finest", stressed.finest,
                   "nodes of the runs to compare with; the next where one is not stable")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--limit", options->limit, fmt::format("for each run [{:g} s]", stressed.limit_s))
      ->type_name("TIME");
  options->flags.add(*command, "none of them");  // --config and --set only
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            if (options->list) {
              for (const StressMap& map : stress_maps())
                print(fmt::format("{:<14} {} x {}\n", map.name, map.x.key, map.y.key));
              return 0;
            }
            if (shared.out.empty())
              throw UsageError({.fact = "no folder for the maps was given",
                                .where = "-o",
                                .why = "there is nowhere to put them",
                                .remedy = "for instance dimple stress -o out, or --list"});
            const Config config = options->flags.config(*command, shared.image);
            if (!options->limit.empty())
              options->stressed.limit_s = quantity(options->limit, "--limit", "s", "time for each run");
            into_folder(shared, config.image.file);
            return finish(shared, stress(config, options->stressed, shared.out, progress_of(shared)));
          }};
}

}  // namespace dimple
