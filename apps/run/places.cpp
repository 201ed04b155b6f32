#include "apps/run/places.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "apps/run/organ.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/tool.hpp"
#include "apps/scene/compatibility.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

// Rounds to the digits that a user enters for a place.
double to_step(double x, double step) {
  const double per_mm = std::round(1.0 / step);  // division by a whole number keeps 98.74
  return std::round(x * per_mm) / per_mm + 0.0;
}

Json three(const Vec3& v, double step) {
  return {to_step(v.x(), step), to_step(v.y(), step), to_step(v.z(), step)};
}

Json described(const UsablePlace& place) {
  Json json = {{"from", place.from}, {"verdict", word_of(place.verdict)}};
  if (!place.reason.empty()) json["reason"] = place.reason;
  if (!(place.room_mm > 0.0)) return json;  // the patch fits nowhere on this side
  json["centre_mm"] = three(place.centre, 1e-3);
  json["push"] = three(place.approach, 1e-6);
  json["base"] = place.base;
  json["thickness_mm"] = to_step(place.beneath.thickness_mm, 1e-2);
  json["tilt_degrees"] = to_step(place.beneath.tilt_degrees, 1e-1);
  json["room_mm"] = to_step(place.room_mm, 1e-2);
  return json;
}

}  // namespace

PlacesOfImage places_of_image(const Scene& scene, const LabelImage* image, const RunObserver& observer) {
  PlacesOfImage found;
  Result result;
  const RunLog log{observer, result};
  check_pairs(scene, Feature::places);
  const Organ organ = read_organ({.scene = scene, .image = image}, model_options(scene), log, result);
  found.places = usable_places(organ.body->surface, organ.options.boundary);
  found.warnings = result.warnings;
  return found;
}

std::string places_json(const Scene& scene, const PlacesOfImage& found) {
  const std::optional<ToolShape> tool = scene.tool;
  Json json = {{"image", name_of_image(scene)},
               {"tool", scene.tool_words.shape},
               {"circle_diameter_mm", tool ? 2e3 * tool->radius : scene.boundary.indenter_diameter_mm},
               {"sides", Json::array()},
               {"others", Json::array()},
               {"looked_at", found.places.looked_at},
               {"against", Json::object()},
               {"warnings", found.warnings}};
  for (const UsablePlace& place : found.places.sides) json["sides"].push_back(described(place));
  for (const UsablePlace& place : found.places.others) json["others"].push_back(described(place));
  for (const auto& [reason, count] : found.places.against) json["against"][reason] = count;
  return json.dump(2, ' ', false, Json::error_handler_t::replace);
}

std::string warning_of_bending(const BodySurface& body, const Boundary& boundary) {
  const Beneath what = beneath(body, boundary);
  if (!will_bend(what.bending)) return {};
  const auto better = next_better_place(body, boundary);
  return fmt::format(
      "the tool is on a thin part that is free to bend: {:.1f} mm of tissue along the approach direction "
      "under a contact patch of {:.4g} mm, with no base behind it; {}",
      what.thickness_mm, 2.0 * boundary.radius,
      better ? fmt::format(
                   "the next better place is {}, with {:.1f} mm of tissue: --indent-at {:.1f},{:.1f},{:.1f}",
                   in_words(better->centre), better->beneath.thickness_mm, better->centre.x(),
                   better->centre.y(), better->centre.z())
             : "no better place was found on this side; `dimple places` lists the others");
}

}  // namespace dimple
