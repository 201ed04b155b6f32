#include <fmt/format.h>

#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"
#include "apps/studies/accuracy_chart.hpp"

namespace dimple {
namespace {

struct ChartArguments {
  Flags flags;
  AccuracyOptions compared;
  std::string peer_limit;
};

}  // namespace

Command add_chart(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<ChartArguments>();
  AccuracyOptions& compared = options->compared;
  CLI::App* command = app.add_subcommand(
      "chart",
      "draw error against wall time: two scenes whose force is known, an image of yours, and other "
      "programs where they are installed (apt install calculix-ccx)");
  command->add_option("IMAGE", shared.image,
                      "label image of a third scene; --set and --config are about it alone");
  command->add_option("-o,--out,--output", shared.out, "folder for chart.csv, chart.png, chart.svg")
      ->required();
  command->add_option("--only", compared.only, "scenes: a, b, image [all]")->delimiter(',');
  command->add_option("--reference", compared.reference,
                      "CSV with columns indentation_mm, force_N of the image: its depths are run");
  command->add_option("--nodes", compared.nodes, "numbers of nodes")->delimiter(',')->capture_default_str();
  command->add_option("--goals", compared.goals, "accuracies to ask for, or none")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--schemes", compared.schemes, "converging, horton2007 (dynamic only)")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--time", compared.times, "quasi-static, dynamic")
      ->delimiter(',')
      ->capture_default_str();
  command
      ->add_option("--dynamic-nodes", compared.dynamic_nodes, "of dynamic runs [those of --nodes up to 4250]")
      ->delimiter(',');
  command
      ->add_option("--repeat", compared.repeat, "clouds of each size: times are medians, errors the largest")
      ->capture_default_str();
  command->add_option("--calculix", compared.calculix, "CalculiX, if not as ccx on PATH; none: leave it out")
      ->type_name("PATH");
  command->add_option("--febio", compared.febio, "FEBio 4, to run it too")->type_name("PATH");
  command->add_option("--elements", compared.peer_elements, "of their meshes: hexahedra, tetrahedra")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--peer-nodes", compared.peer_nodes, "nodes of their meshes, about")
      ->delimiter(',')
      ->capture_default_str();
  command
      ->add_option("--peer-limit", options->peer_limit,
                   fmt::format("for each run of theirs [{:g} s]", compared.peer_limit_s))
      ->type_name("TIME");
  options->flags.add(*command, "none of them");  // --config and --set only
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            const Config config = options->flags.config(*command, shared.image);
            const std::string& limit = options->peer_limit;
            if (!limit.empty())
              options->compared.peer_limit_s =
                  quantity(limit, "--peer-limit", "s", "time for each run of theirs");
            into_folder(shared, config.image.file);
            if (!shared.verbose) start_log(Verbosity::quiet);
            std::erase(options->compared.goals, "none");
            return finish(shared, accuracy_chart(config, options->compared, shared.out, progress_of(shared)));
          }};
}

}  // namespace dimple
