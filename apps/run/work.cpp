#include "apps/run/work.hpp"

namespace dimple {

const char* name_of(Part part) {
  switch (part) {
    case Part::reading:
      return "reading";
    case Part::surface:
      return "surface";
    case Part::node_set:
      return "cloud";
    case Part::supports:
      return "supports";
    case Part::solving:
      return "solving";
    case Part::error_bounds:
      return "band";
    case Part::writing:
      return "writing";
  }
  return "";
}

double expected_s(Part part, const Work& work) {
  // Unit of the durations: a millionth of a second for each voxel, node or point.
  constexpr double us = 1e-6;
  const auto evaluations_s = [](double depths, double points) {
    constexpr double a_depth = 14.0;
    return a_depth * depths * (1e-3 + 0.28 * us * points);
  };
  switch (part) {
    case Part::reading:
      return 0.02 + 0.02 * us * work.voxels;
    case Part::surface:
      return 0.2 + 0.3 * us * work.voxels;
    case Part::node_set:
      return 0.3 + 130.0 * us * work.nodes;
    case Part::supports:
      return 130.0 * us * work.nodes;
    case Part::solving:
      return evaluations_s(work.depths, work.points);
    case Part::error_bounds:
      return work.error_bounds ? 0.3 + 130.0 * us * work.nodes + evaluations_s(4.0, 0.5 * work.points) : 0.0;
    case Part::writing:
      return work.picture ? 0.8 : 0.05;
  }
  return 0.0;
}

}  // namespace dimple
