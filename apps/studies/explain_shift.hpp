#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "apps/studies/explain.hpp"
#include "apps/studies/shift.hpp"

namespace dimple {

/// What a shift depends on, measured: effects are changes of the largest shift within the opening [mm].
struct ShiftExplanation {
  double shift_mm = 0.0, noise_mm = 0.0;       ///< as it is; the largest change by another cloud
  std::vector<Alternative> alternatives = {};  ///< `effect` in mm
  Index nodes = 0;
  double seconds = 0.0, total_s = 0.0;
  std::string ended_by = {};  ///< by what it was stopped before its end; empty: it was not
};

/// Repeats the shift with one choice at a time changed: other clouds, the gap, the fluid that is lost, the
/// shear modulus, the direction of up, the opening's radius, friction at the skull, what is held, and sulci.
/// A change that gives another cloud is compared with the mean of three clouds. `scene`: of
/// describe_shift(). Throws what shift() throws of the shift as it is; one that fails is listed with why.
ShiftExplanation explain_shift(const Scene& scene, const ShiftOptions& options,
                               const std::function<void(const std::string&)>& progress);

void write_explanation(const std::filesystem::path& folder, const ShiftExplanation& explanation,
                       const std::string& subject);

}  // namespace dimple
