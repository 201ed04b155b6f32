#pragma once

#include <array>

namespace dimple {

/// The parts of a run, in their order.
enum class Part { reading, surface, cloud, supports, solving, band, writing };
inline constexpr std::array all_parts = {Part::reading, Part::surface, Part::cloud,  Part::supports,
                                         Part::solving, Part::band,    Part::writing};
const char* name_of(Part part);

/// Counts that say how long the parts of a run take.
struct Work {
  double voxels = 0.0;
  double nodes = 1500.0, points = 10500.0;
  double depths = 16.0;  ///< equilibria
  bool picture = true, band = true;
  bool refinement = false;  ///< further clouds may follow, nobody knows how many
};

/// [s] That part on the machine of tests/bench/results/whole_runs.csv, to a factor of two: what another one
/// makes of it shows after its first parts.
double expected_s(Part part, const Work& work);

}  // namespace dimple
