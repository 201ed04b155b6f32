#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"

namespace dimple {
namespace {

struct SolveArguments {
  Flags flags;
  std::string model;
};

}  // namespace

Command add_solve(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<SolveArguments>();
  CLI::App* command = app.add_subcommand("solve", "indent a model");
  command->add_option("MODEL", options->model, "folder made by `dimple model`, or its model.toml")
      ->required();
  command->add_option("-o,--out,--output", shared.out, "folder for the results")->required();
  add_over_results(*command, shared, true);
  options->flags.add(*command, "solve");
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            const Description described = options->flags.described(*command);
            into_folder(shared, options->model);
            return finish(shared,
                          record_solve(described, options->model, shared.out, shared.existing(), to_log()));
          }};
}

}  // namespace dimple
