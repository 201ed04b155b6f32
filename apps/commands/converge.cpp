#include "apps/studies/converge.hpp"

#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"

namespace dimple {
namespace {

struct ConvergeArguments {
  Flags flags;
  ConvergenceOptions study;
  std::string reference;
};

}  // namespace

Command add_converge(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<ConvergeArguments>();
  ConvergenceOptions& study = options->study;
  CLI::App* command =
      app.add_subcommand("converge", "run one scene with several clouds: how far its force can be trusted");
  command->add_option("IMAGE", shared.image, "label image");
  command->add_option("-o,--out,--output", shared.out, "folder for convergence.csv, .md, .png, .svg")
      ->required();
  command->add_option("--sizes", study.nodes, "numbers of nodes")->delimiter(',')->capture_default_str();
  command->add_option("--densities", study.densities, "of points, as multiples of the usual")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--seeds", study.seeds, "clouds of each size")->capture_default_str();
  command->add_option("--reference", options->reference,
                      "CSV with indentation_mm and force_N to compare with");
  options->flags.add(*command, "");
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            const Config config = options->flags.config(*command, shared.image);
            into_folder(shared, config.image.file);
            options->study.reference = options->reference;
            // What each of two dozen runs says of itself would hide what the study says.
            if (!shared.verbose) start_log(Verbosity::quiet);
            return finish(shared, converge(config, options->study, shared.out, progress_of(shared)));
          }};
}

}  // namespace dimple
