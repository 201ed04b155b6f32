#include "apps/run/places.hpp"

#include <fmt/format.h>

#include <cmath>

#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/run/tool.hpp"
#include "apps/scene/resolve.hpp"
#include "io/digits.hpp"

namespace dimple {
namespace {

std::string coordinates(const Vec3& x) {
  const auto tenths = [](double value) { return std::round(10.0 * value) / 10.0 + 0.0; };
  return fmt::format("{:.1f},{:.1f},{:.1f}", tenths(x.x()), tenths(x.y()), tenths(x.z()));
}

void print_place(const UsablePlace& place) {
  const std::string verdict =
      word_of(place.verdict) + (place.reason.empty() ? std::string() : ": " + place.reason);
  if (place.room_mm > 0.0)
    print(fmt::format("{:<9}  {:<22}  {:<9}  {:>9.1f}  {:>10.0f}  {:>7.1f}  {}\n", place.from,
                      coordinates(place.centre), place.base, place.beneath.thickness_mm,
                      place.beneath.tilt_degrees, place.room_mm, verdict));
  else
    print(fmt::format("{:<9}  {:<22}  {:<9}  {:>9}  {:>10}  {:>7}  {}\n", place.from, "-", "-", "-", "-", "-",
                      verdict));
}

// Tool as text: "a circle of 10 mm", or "the tool sphere:6mm, pressed in by 3.00 mm".
std::string tool_in_words(const Scene& scene) {
  if (!scene.tool) return fmt::format("a contact patch of {:.4g} mm", scene.boundary.indenter_diameter_mm);
  return fmt::format("the tool {}, pressed in by {}", scene.tool_words.shape,
                     length_in_words(scene.depth_mm));
}

void print_places(const UsablePlaces& places, const std::string& tool) {
  print(
      fmt::format("Places for {}; --indent-at is a side, or x,y,z (LPS, mm) with the base and, if the tool "
                  "does not approach from the opposite side, its direction: --base inferior "
                  "--direction=-1,0,0.\n\n{:<9}  {:<22}  {:<9}  {:>9}  {:>10}  {:>7}  {}\n",
                  tool, "tool from", "x,y,z [mm]", "base", "tissue mm", "tilt [deg]", "room mm", "verdict"));
  for (const UsablePlace& place : places.sides) print_place(place);
  if (places.looked_at == 0) return;
  const std::string& side = places.sides.front().from;
  if (!places.others.empty()) print(fmt::format("\nMore places on the {} side, the highest first:\n", side));
  for (const UsablePlace& place : places.others) print_place(place);
  int against = 0;
  for (const auto& [reason, count] : places.against) against += count;
  print(fmt::format("\n{} of {} places examined on the {} side are good. Reasons against the others:\n",
                    places.looked_at - against, places.looked_at, side));
  for (const auto& [reason, count] : places.against) print(fmt::format("{:>6}  {}\n", count, reason));
}

}  // namespace

Command add_places(CLI::App& app, Invocation& shared) {
  const auto flags = std::make_shared<Flags>();
  CLI::App* command = app.add_subcommand(
      "places", "list usable places for the tool on an organ, with reasons against the others");
  command->add_option("IMAGE", shared.image, "label image");
  flags->add(*command, "places");
  add_common(*command, shared);
  return {command, [&shared, command, flags] {
            const Scene scene = resolve(flags->described(*command, shared.image));
            const PlacesOfImage found = places_of_image(scene, nullptr, {.line = to_log().line});
            clear_stage_line();
            if (shared.json)
              print_json(places_json(scene, found) + "\n");
            else
              print_places(found.places, tool_in_words(scene));
            return 0;
          }};
}

}  // namespace dimple
