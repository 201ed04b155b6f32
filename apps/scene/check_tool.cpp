#include <fmt/format.h>

#include "apps/scene/resolve_parts.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"

namespace dimple {

void require_tool_as_long(const Scene& scene, double depth_mm) {
  const std::optional<ToolShape> tool = scene.tool;
  if (!tool || 1e-3 * depth_mm <= tool->length) return;
  constexpr double smallest_mm = 0.05;  // smallest radius of an indenter for soft tissue
  const bool looks_like_metres = 1e3 * tool->radius < smallest_mm;
  throw UsageError(
      {.fact = fmt::format("the tool is to be pressed in by {}, and is {} long", length_in_words(depth_mm),
                           length_in_words(1e3 * tool->length)),
       .where = scene.steps.empty() ? "--depth (load.depth_mm)" : "step",
       .why = looks_like_metres ? fmt::format("its radius is {}: are the units of --tool those of its "
                                              "numbers? A bare number is in mm",
                                              length_in_words(1e3 * tool->radius))
                                : "the holder at its upper end is not modelled",
       .remedy = looks_like_metres ? "give the radius in millimetres or with its unit, as --tool sphere:5mm"
                                   : "give a smaller --depth, or a longer tool"});
}

void check_tool(const Scene& scene) {
  constexpr double shortest = 0.001;
  const double step = scene.solver.step_radii;
  if (step > 0.0 && step < shortest)
    throw UsageError({.fact = fmt::format("steps of the load of {:g} radii are requested", step),
                      .where = "solver.step_radii",
                      .why = fmt::format("the shortest are {:g} radii: a thousand for each radius", shortest),
                      .remedy = "give a longer one, or 0 for the usual"});
  // The depth of steps depends on the approach direction: require_room_beneath() checks it.
  if (scene.steps.empty()) require_tool_as_long(scene, scene.depth_mm);
}

}  // namespace dimple
