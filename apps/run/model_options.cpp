#include "apps/run/model_options.hpp"

#include <algorithm>

#include "apps/run/other_tools.hpp"
#include "apps/run/steps.hpp"
#include "solver/terms/rigid_contact.hpp"

namespace dimple {

ModelOptions model_options(const Scene& scene) {
  ModelOptions options = options_of(scheme_of(scene));
  options.node_set.count = scene.node_set.nodes;
  options.node_set.spacing_mm = scene.node_set.spacing_mm;
  options.node_set.seed = static_cast<std::uint64_t>(scene.node_set.seed);
  options.node_set.jitter = scene.node_set.jitter;
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
    for (const Vec3& come : path_of_tool(scene, Vec3::Zero()))
      options.boundary.path_of_tool.push_back(1e3 * come);
    if (turns(scene))
      options.boundary.path_of_turning_tool = [scene](const Vec3& approach, const Vec3& place_mm) {
        std::vector<Vec3> path;
        for (const Vec3& come : swept(scene, {.centre = 1e-3 * place_mm, .approach = approach}))
          path.push_back(1e3 * come);
        return path;
      };
    GradingOptions& grading = options.node_set.grading;
    grading.whole_patch = !(tool->edge > 0.0);
    // A bonded edge distorts finer nodes; the first contact of a round tool is small compared to its last.
    if (grading.whole_patch) {
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

ErrorFloor error_floor(const Scene& scene) {
  if (scene.followed) return floor_of_displacement();
  return floor_of_force({2.0 * scene.depth_mm / scene.boundary.indenter_diameter_mm, !scene.tissues.empty()});
}

}  // namespace dimple
