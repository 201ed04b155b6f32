#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "apps/studies/explain.hpp"
#include "apps/studies/shift.hpp"

namespace dimple {

/// Measured effects of choices on a shift: changes of the largest shift within the opening [mm].
struct ShiftExplanation {
  double shift_mm = 0.0, noise_mm = 0.0;       ///< of the unchanged shift; largest change by another node set
  std::vector<Alternative> alternatives = {};  ///< `effect` in mm
  Index nodes = 0;
  double seconds = 0.0, total_s = 0.0;
  std::string ended_by = {};  ///< reason why it was stopped; empty: it was not
};

/// Repeats the shift with one choice at a time changed: other random nodes, gap, lost fluid, shear modulus,
/// direction of up, radius of the opening, friction at the skull, held part, sulci. A choice that changes the
/// nodes is compared with the mean over three node sets. `scene`: of describe_shift(). Throws what shift()
/// throws for the unchanged shift; a choice that fails is listed with its reason.
ShiftExplanation explain_shift(const Scene& scene, const ShiftOptions& options,
                               const std::function<void(const std::string&)>& progress);

void write_explanation(const std::filesystem::path& folder, const ShiftExplanation& explanation,
                       const std::string& subject);

}  // namespace dimple
