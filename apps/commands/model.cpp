#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"

namespace dimple {
namespace {

struct ModelArguments {
  Flags flags;
};

}  // namespace

Command add_model(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<ModelArguments>();
  CLI::App* command = app.add_subcommand(
      "model", "generate the model of an image: nodes, integration points, base, contact patch");
  command->add_option("IMAGE", shared.image, "label image");
  command->add_option("-o,--out,--output", shared.out, "folder for the model")->required();
  add_over_results(*command, shared, false);
  options->flags.add(*command, "model");
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            const Description described = options->flags.described(*command, shared.image);
            into_folder(shared, image_file(described));
            return finish(shared, record_model(described, shared.out, shared.existing(), to_log()));
          }};
}

}  // namespace dimple
