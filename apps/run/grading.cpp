#include "apps/run/grading.hpp"

#include <cmath>

namespace dimple {

void grade_to_size(const BodySurface& body, ModelOptions& options) {
  GradingOptions& grading = options.node_set.grading;
  const bool usual =
      grading.patch_edge == converging.grading.patch_edge && grading.reach == converging.grading.reach;
  if (!usual || options.boundary.contact_radius_mm > 0.0 || !options.boundary.is_pressed) return;
  const double size = std::cbrt(body.volume()) / (0.5 * options.boundary.indenter_diameter_mm);
  if (size <= graded_to_size_from) return;
  grading.patch_edge *= grading.reach / size;
  grading.reach = size;
}

}  // namespace dimple
