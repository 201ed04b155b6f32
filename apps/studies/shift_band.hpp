#pragma once

#include <string>

#include "apps/studies/shift_run.hpp"

namespace dimple {

/// In 16 craniotomies: PMC4834281.
inline constexpr double least_measured_mm = 2.5, most_measured_mm = 21.0;

/// What a shift may be off by because its nodes are finite: half the width of the band around each
/// displacement at the opening, of the targets and in depth.
struct ShiftBand {
  double half_mm = 0.0;
  double change_mm = 0.0;  ///< with half as many nodes, the largest of them
  Index coarser_nodes = 0;
  bool stopped = false;  ///< while it was compared
  std::string unknown;   ///< why it is not known; empty: it is
  bool known() const { return unknown.empty(); }
};

/// From the same shift with half as many nodes, which takes about half as long again. `scene`: of what
/// describe_shift() returns. Unknown, too, where it is stopped.
ShiftBand band_of_shift(const Scene& scene, const ShiftScene& asked, const Shifted& shifted);

/// A sentence's end: "at most 2.3 mm: ..." or "unknown: ...".
std::string in_words(const ShiftBand& band);

}  // namespace dimple
