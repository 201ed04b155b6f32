#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/terminal.hpp"
#include "io/label_image.hpp"
#include "io/text.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

using Json = nlohmann::ordered_json;

Json three(const Vec3& v) {
  return Json::array({v.x(), v.y(), v.z()});
}

void describe_image(const std::filesystem::path& file, const std::filesystem::path& label_names,
                    bool as_json) {
  const LabelImage image = read_label_image(file, label_names);
  const std::vector<LabelMeasure> labels = measure_labels(image);
  if (as_json) {
    Json out = {{"file", file.string()},
                {"format", image.format},
                {"orientation", image.orientation},
                {"size", {image.stored_size[0], image.stored_size[1], image.stored_size[2]}},
                {"spacing_mm", three(image.stored_spacing)},
                {"labels", Json::array()},
                {"warnings", image.warnings}};
    for (const LabelMeasure& l : labels)
      out["labels"].push_back({{"value", l.value},
                               {"name", l.name},
                               {"voxels", l.voxels},
                               {"volume_mm3", l.volume_mm3},
                               {"centre_mm", three(l.centre_mm)},
                               {"pieces", l.pieces},
                               {"touches_border", l.touches_border}});
    // A file's name may be no UTF-8.
    print_json(out.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
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
  for (const LabelMeasure& l : labels)
    print(
        fmt::format("{:>6}  {:<28} {:>12} {:>14}  {:<24}  {:>6}  {}\n", l.value, printable(l.name), l.voxels,
                    volume_in_words(l.volume_mm3),
                    fmt::format("{:.1f}, {:.1f}, {:.1f}", l.centre_mm.x(), l.centre_mm.y(), l.centre_mm.z()),
                    l.pieces, l.touches_border ? "yes" : "no"));
  for (const std::string& warning : image.warnings) warn(warning);
}

}  // namespace

Command add_info(CLI::App& app, Invocation& shared) {
  const auto label_names = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand("info", "say what an image holds");
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
