#include "apps/run/model_options.hpp"

#include <algorithm>

#include "apps/run/other_tools.hpp"
#include "apps/run/steps.hpp"
#include "solver/terms/touching_tool.hpp"

namespace dimple {

ModelOptions model_options(const Scene& scene) {
  ModelOptions options = options_of(scheme_of(scene));
  options.cloud.count = scene.cloud.nodes;
  options.cloud.spacing_mm = scene.cloud.spacing_mm;
  options.cloud.seed = static_cast<std::uint64_t>(scene.cloud.seed);
  options.cloud.jitter = scene.cloud.jitter;
  options.grid.count = scene.grid.points;
  options.boundary = {.base = scene.boundary.base,
                      .base_depth_mm = scene.boundary.base_depth_mm,
                      .indent_at = scene.boundary.indent_at,
                      .indenter_diameter_mm = scene.boundary.indenter_diameter_mm,
                      .direction = scene.boundary.direction};
  options.boundary.other_tools = places_of_other_tools(scene);
  if (const std::optional<ToolShape>& tool = scene.tool) {
    options.boundary.indenter_diameter_mm = 2e3 * tool->radius;
    options.boundary.contact_radius_mm = 1e3 * contact_radius(*tool, 1e-3 * scene.depth_mm);
    // The displacement in press direction, not known yet, needs no other nodes and is left out.
    for (const Vec3& come : way_of_tool(scene, Vec3::Zero()))
      options.boundary.way_of_tool.push_back(1e3 * come);
    if (turns(scene))
      options.boundary.way_of_turning_tool = [scene](const Vec3& push, const Vec3& place_mm) {
        std::vector<Vec3> way;
        for (const Vec3& come : swept(scene, {.centre = 1e-3 * place_mm, .push = push}))
          way.push_back(1e3 * come);
        return way;
      };
    GradingOptions& grading = options.cloud.grading;
    grading.whole_circle = !(tool->edge > 0.0);
    // A bonded edge distorts finer nodes; the first contact of a round tool is small compared to its last.
    if (grading.whole_circle) {
      grading.least = std::min(grading.least, 0.08);
      options.boundary.height_of_tool = [shape = *tool](double r) {
        return 1e3 * height_of_tool(shape, 1e-3 * r);
      };
    }
    if (tool->edge > 0.0)
      grading.least = std::min(grading.least, 0.25 * 1e3 * tool->edge / options.boundary.contact_radius_mm);
  }
  return options;
}

FloorOfBand band_floor(const Scene& scene) {
  if (scene.followed) return floor_of_displacement();
  return floor_of_force({2.0 * scene.depth_mm / scene.boundary.indenter_diameter_mm, !scene.tissues.empty()});
}

}  // namespace dimple
