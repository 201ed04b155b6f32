#include "preprocess/image/phantom.hpp"

#include <fmt/format.h>

#include "apps/commands/command.hpp"
#include "apps/commands/describe.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/scene/option_word.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/text.hpp"

namespace dimple {
namespace {

struct PhantomArguments {
  PhantomOptions body;
  std::string size, voxel;
};

// Three lengths in mm: "60,60,30", "6cm,6cm,30mm".
Vec3 lengths(const std::string& text, const std::string& flag) {
  const auto length = [](const char* name) { return length_number(name, 1.0, 1e9); };
  return parse_word({"the size", {{"", {length("x"), length("y"), length("z")}, "60,60,30, or 6cm,6cm,3cm"}}},
                    text, flag)
      .three();
}

}  // namespace

Command add_phantom(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<PhantomArguments>();
  CLI::App* command = app.add_subcommand("phantom", "create a synthetic test image");
  command->add_option("OUT", shared.out, "image to write: .nrrd, .seg.nrrd, .nii, .nii.gz, .mha")->required();
  command->add_option("--shape", options->body.shape, "shape of the phantom")
      ->type_name("brain|block|cut-ellipsoid|cylinder")
      ->capture_default_str();
  command
      ->add_option("--size", options->size,
                   "extent along L, P, S [brain: the swine's, 62.5,92.5,28.5 mm; else 92.5,62.5,28.5 mm]")
      ->type_name("X,Y,Z");
  command->add_option("--spacing", options->voxel, "voxel edge [1 mm]")->type_name("mm");
  command->add_flag("--two-labels", options->body.two_labels, "with a second tissue inside");
  add_common(*command, shared);
  return {
      command, [&shared, options] {
        PhantomOptions& body = options->body;
        if (!options->size.empty()) body.size_mm = lengths(options->size, "--size");
        if (!options->size.empty() && body.shape == "brain")  // whose first length is that from front to back
          std::swap(body.size_mm.x(), body.size_mm.y());
        if (!options->size.empty() && body.shape == "cylinder" && body.size_mm.x() != body.size_mm.y())
          throw UsageError({.fact = fmt::format("a cylinder is {:g} mm wide and {:g} mm deep",
                                                body.size_mm.x(), body.size_mm.y()),
                            .where = "--size",
                            .why = "its axis is along S, and its section is circular",
                            .remedy = fmt::format("for instance --size {0:g},{0:g},{1:g}", body.size_mm.x(),
                                                  body.size_mm.z())});
        if (!options->voxel.empty())
          body.spacing_mm = quantity(options->voxel, "--spacing", "mm", "voxel edge");
        try_file(shared.out);
        remove_temporaries_of(shared.out);
        const LabelImage image = make_phantom(body);
        write_label_image(shared.out, image);
        for (const std::string& warning : image.warnings) warn(warning);
        if (shared.json)
          print_json(image_as_json(shared.out, image));
        else
          print(printable(shared.out) + "\n");
        return 0;
      }};
}

}  // namespace dimple
