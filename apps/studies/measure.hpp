#pragma once

#include "apps/run/simulate.hpp"

namespace dimple {

/// A force curve and what it cost.
struct Measured {
  Index nodes = 0, points = 0;
  double spacing_mm = 0.0, rim_spacing_mm = 0.0;
  History history;
  Band band;
  std::vector<std::string> warnings;
  double build_s = 0.0, solve_s = 0.0;  ///< reading and making the model; marching
};

/// One case from its image to the curve, in memory. Throws what simulate() throws, and Stopped: no numbers of
/// a part for those of the whole. `band`: of the force is wanted.
Measured measure(const Config& config, bool band = false);

}  // namespace dimple
