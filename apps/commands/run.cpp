#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"

namespace dimple {
namespace {

struct Options {
  Flags flags;
};

}  // namespace

Command add_run(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = app.add_subcommand("run", "both: from the image to the force curve");
  command->add_option("IMAGE", shared.image, "label image");
  command->add_option("-o,--out,--output", shared.out, "folder for the results")->required();
  add_over_results(*command, shared, true);
  options->flags.add(*command, "run");
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            const Config config = options->flags.config(*command, shared.image);
            into_folder(shared, config.image.file);
            return finish(shared, record_run(config, shared.out, shared.existing(), to_log()));
          }};
}

}  // namespace dimple
