#include "apps/studies/shift.hpp"

#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"

namespace dimple {
namespace {

struct ShiftArguments {
  Flags flags;
  ShiftOptions shift;
};

}  // namespace

Command add_shift(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<ShiftArguments>();
  ShiftOptions& shift_options = options->shift;
  CLI::App* command = app.add_subcommand(
      "shift", "brain shift after a craniotomy: where the skull is open and fluid is lost");
  command->add_option("IMAGE", shared.image, "label image");
  command->add_option("-o,--out,--output", shared.out, "folder for the results")->required();
  add_over_results(*command, shared, false);
  command->add_option("--brain", shift_options.brain, "labels of the brain, comma-separated; else all are");
  command
      ->add_option("--skull", shift_options.skull,
                   "label of the skull; or derived: the outer hull of the brain, at --gap")
      ->capture_default_str();
  command->add_option("--opening", shift_options.opening, "where the skull is open: x,y,z,radius in LPS mm")
      ->required();
  command->add_option("--up", shift_options.up, "against gravity: a side of the patient, or x,y,z in LPS")
      ->required();
  command
      ->add_option("--fluid-lost", shift_options.fluid_lost,
                   "share of the brain's height above the level to which the fluid has fallen")
      ->capture_default_str();
  command->add_option("--gap", shift_options.gap,
                      "between brain and skull at the nearest place; else 2 mm of a derived skull, and of a "
                      "label as the image has it");
  command
      ->add_option("--target", shift_options.target,
                   "a place x,y,z in LPS mm whose shift is asked for; several")
      ->expected(1)
      ->take_all();
  options->flags.add(*command, "shift");
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            const Config config =
                config_of_shift(options->flags.config(*command, shared.image), options->shift);
            into_folder(shared, config.image.file);
            return finish(shared, shift(config, options->shift, shared.out, shared.existing(), to_log()));
          }};
}

}  // namespace dimple
