#pragma once

#include <string>

#include "apps/studies/shift_run.hpp"

namespace dimple {

/// Range of shifts measured in 16 craniotomies: PMC4834281.
inline constexpr double least_measured_mm = 2.5, most_measured_mm = 21.0;

/// Discretisation error of a shift: half-width of the error bounds of each displacement at the opening, at
/// the targets and in depth.
struct ShiftErrorBounds {
  double half_mm = 0.0;
  double change_mm = 0.0;  ///< largest change with half as many nodes
  Index coarser_nodes = 0;
  bool stopped = false;  ///< during the comparison
  std::string unknown;   ///< why it is unavailable; empty: it is available
  bool known() const { return unknown.empty(); }
};

/// Estimates the error from the same shift with half as many nodes, which adds about half the time. `scene`:
/// of describe_shift(). Unavailable if stopped.
ShiftErrorBounds error_bounds_of_shift(const Scene& scene, const ShiftScene& requested,
                                       const Shifted& shifted);

/// End of a sentence: "at most 2.3 mm: ..." or "unknown: ...".
std::string in_words(const ShiftErrorBounds& error_bounds);

}  // namespace dimple
