#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/slicer.hpp"
#include "apps/commands/whole_program.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/scene/resolve.hpp"

namespace dimple {
namespace {

struct RunArguments {
  Flags flags;
  bool explain = false;
  std::string return_parameters;
};

}  // namespace

Command add_run(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<RunArguments>();
  CLI::App* command = app.add_subcommand("run", "model and solve in one: from the image to the force curve");
  command->add_option("IMAGE", shared.image, "label image");
  command->add_option("-o,--out,--output", shared.out, "folder for the results")->required();
  add_over_results(*command, shared, true);
  command->add_flag("--explain", options->explain, "then show what the force depends on, choice by choice");
  command->add_flag(slicer_flag, shared.slicer, "as 3D Slicer gives options and reads progress")->group("");
  command->add_option("--returnparameterfile", options->return_parameters)->group("");
  options->flags.add(*command, "run");
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            options->flags.defaults_are_unsaid = shared.slicer;
            if (options->explain && shared.explain == nullptr) refuse_without_whole_program("run --explain");
            const Description described = options->flags.described(*command, shared.image);
            into_folder(shared, image_file(described));
            if (options->explain) check_pairs(resolve(described), Feature::explain);
            Outcome outcome = record_run(described, shared.out, shared.existing(), to_log());
            if (options->explain && !outcome.interrupted)
              outcome = shared.explain(resolve(described), shared, std::move(outcome));
            if (!options->return_parameters.empty())
              write_return_parameters(options->return_parameters, outcome.summary_json);
            return finish(shared, outcome);
          }};
}

}  // namespace dimple
