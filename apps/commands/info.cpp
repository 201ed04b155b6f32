#include <fmt/format.h>

#include <filesystem>

#include "apps/commands/command.hpp"
#include "apps/commands/describe.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/terminal.hpp"
#include "io/label_image.hpp"
#include "io/text.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

void describe_image(const std::filesystem::path& file, const std::filesystem::path& label_names,
                    bool as_json) {
  const LabelImage image = read_label_image(file, label_names);
  if (as_json) {
    print_json(image_as_json(file, image));
    return;
  }
  print(fmt::format(
      "{}\n  format       {}\n  size         {} x {} x {} voxels\n  spacing      {:.6g} x {:.6g} x {:.6g} "
      "mm\n  axes run to  {}\n\n",
      printable(file.string()), printable(image.format), image.stored_size[0], image.stored_size[1],
      image.stored_size[2], image.stored_spacing.x(), image.stored_spacing.y(), image.stored_spacing.z(),
      image.orientation));
  print(fmt::format("{:>6}  {:<28} {:>12} {:>14}  {:<24}  {:>6}  {}\n", "label", "name", "voxels", "volume",
                    "centre L, P, S [mm]", "pieces", "touches border"));
  for (const LabelMeasure& l : measure_labels(image))
    print(
        fmt::format("{:>6}  {:<28} {:>12} {:>14}  {:<24}  {:>6}  {}\n", l.value, printable(l.name), l.voxels,
                    volume_in_words(l.volume_mm3),
                    fmt::format("{:.1f}, {:.1f}, {:.1f}", l.centre_mm.x(), l.centre_mm.y(), l.centre_mm.z()),
                    l.pieces, l.meets_border ? "yes" : "no"));
  for (const std::string& warning : image.warnings) warn(warning);
}

}  // namespace

Command add_info(CLI::App& app, Invocation& shared) {
  const auto label_names = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("info", "print the contents of an image");
  command->add_option("IMAGE", shared.image, "label image")->required();
  command->add_option("--label-names", *label_names,
                      "table of label names (ITK-SNAP, a colour table of 3D Slicer or FreeSurfer), or "
                      "totalsegmentator, totalsegmentator-mr, freesurfer");
  add_common(*command, shared);
  return {command, [&shared, label_names] {
            describe_image(shared.image, *label_names, shared.json);
            return 0;
          }};
}

}  // namespace dimple
