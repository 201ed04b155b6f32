#include "apps/studies/shift.hpp"

#include <filesystem>

#include "apps/commands/all_commands.hpp"
#include "apps/commands/log.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/scene/resolve.hpp"
#include "apps/studies/explain_shift.hpp"

namespace dimple {
namespace {

struct ShiftArguments {
  Flags flags;
  ShiftOptions shift;
  bool explain = false;
};

// Measures the dependence of a shift on its choices, after it.
Outcome explained(const Scene& scene, const ShiftOptions& options, const Invocation& shared,
                  Outcome outcome) {
  const Stopwatch comparing;
  const ShiftExplanation explanation = explain_shift(
      scene, options, [](const std::string& line) { to_log().line(RunObserver::Line::said, line); });
  const std::filesystem::path out = shared.out;
  const FileList list(out);
  write_explanation(out, explanation, std::filesystem::path(scene.image.file).filename().string());
  add_explained(outcome, out, comparing.seconds(), explanation.ended_by);
  return outcome;
}

}  // namespace

Command add_shift(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<ShiftArguments>();
  ShiftOptions& shift_options = options->shift;
  CLI::App* command = add_to(app, whole::shift);
  command->add_option("IMAGE", shared.image, "label image");
  command->add_option("-o,--out,--output", shared.out, "folder for the results")->required();
  add_over_results(*command, shared, false);
  command->add_option("--brain,--label", shift_options.brain,
                      "labels of the brain, comma-separated; else all are");
  command
      ->add_option("--skull", shift_options.skull,
                   "label of the skull, or several, comma-separated; or derived: the outer hull of the "
                   "brain, at --gap")
      ->capture_default_str();
  command->add_option("--opening", shift_options.opening, "where the skull is open: x,y,z,radius in LPS mm")
      ->required();
  command->add_option("--up", shift_options.up, "against gravity: a side of the patient, or x,y,z in LPS")
      ->required();
  command
      ->add_option("--fluid-lost", shift_options.fluid_lost,
                   "fraction of the brain's height above the fluid level")
      ->capture_default_str();
  command->add_option(
      "--gap", shift_options.gap,
      "of a label: between brain and skull at the nearest place, else as the image has it; of a "
      "derived skull: in front of the brain's outer hull, else 2 mm");
  command
      ->add_option("--target", shift_options.target,
                   "a place x,y,z in LPS mm at which to report the shift, or a file of 3D Slicer's markups "
                   "(.mrk.json, .fcsv); several")
      ->expected(1)
      ->take_all();
  command->add_flag("--tables", shift_options.tables_alone,
                    "only tables and summary, without images, pictures and page");
  command->add_flag("--explain", options->explain,
                    "then repeat the shift with one choice changed at a time, to show what it depends on");
  options->flags.add(*command, "shift", defaults_of_shift());
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            const Description described =
                describe_shift(options->flags.described(*command, shared.image), options->shift);
            into_folder(shared, image_file(described));
            Outcome outcome = shift(described, options->shift, shared.out, shared.existing(), to_log());
            if (options->explain && !outcome.interrupted)
              outcome = explained(resolve(described), options->shift, shared, std::move(outcome));
            return finish(shared, outcome);
          }};
}

}  // namespace dimple
