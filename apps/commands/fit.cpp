#include "apps/studies/fit.hpp"

#include "apps/commands/all_commands.hpp"
#include "apps/commands/log.hpp"

namespace dimple {
namespace {

struct FitArguments {
  Flags flags;
  FitOptions fit;
  std::string curve;
};

}  // namespace

Command add_fit(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<FitArguments>();
  CLI::App* command = add_to(app, whole::fit);
  command->add_option("IMAGE", shared.image, "label image");
  command
      ->add_option("-o,--out,--output", shared.out,
                   "folder for fit.csv, .png, .svg, fitted.toml, summary.json")
      ->required();
  add_over_results(*command, shared, false);
  command
      ->add_option(
          "--curve", options->curve,
          "CSV with indentation_mm (or _um) and force_N (or _mN, _uN, _nN), and time_s if known: one "
          "loading, from contact; with a column sample: many curves of one scene, each fitted")
      ->required();
  command
      ->add_option("--of", options->fit.of,
                   "unknowns: mu (one run); mu,touch: also the first contact (the same run); mu,alpha: also "
                   "Ogden's exponent; mu,limit: also the limit of Gent's law; mu,g,tau: also one Prony term")
      ->capture_default_str();
  options->flags.add(*command, "fit");
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            const Description described = options->flags.described(*command, shared.image);
            into_folder(shared, image_file(described));
            options->fit.curve = options->curve;
            // A fit makes many runs; their messages would hide its own.
            if (!shared.verbose) start_log(Verbosity::quiet);
            return finish(shared,
                          fit(described, options->fit, shared.out, shared.existing(), progress_of(shared)));
          }};
}

}  // namespace dimple
