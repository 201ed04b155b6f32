#pragma once

#include <array>

namespace dimple {

/// The parts of a run, in their order.
enum class Part { reading, surface, node_set, supports, solving, error_bounds, writing };
inline constexpr std::array all_parts = {Part::reading, Part::surface,      Part::node_set, Part::supports,
                                         Part::solving, Part::error_bounds, Part::writing};
const char* name_of(Part part);

/// Counts from which the durations of a run's parts are estimated.
struct Work {
  double voxels = 0.0;
  double nodes = 1500.0, points = 10500.0;
  double depths = 16.0;  ///< equilibria
  bool picture = true, error_bounds = true;
  bool refinement = false;  ///< further levels may follow; their number is unknown
};

/// Expected duration of a part [s] on the machine of tests/bench/results/whole_runs.csv, within a factor of
/// two. The first parts of a run show the factor of another machine.
double expected_s(Part part, const Work& work);

}  // namespace dimple
