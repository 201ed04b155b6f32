#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "apps/run/simulate.hpp"

namespace dimple {

// What one wants to know of a run before its numbers: summary.json's `verdict`, and the head of report.html.

/// Where a number is beyond these, the word is no longer "good". Shares, not per cent.
inline constexpr double volume_to_check = 0.05;        ///< of the labels, that the body has not, or has more
inline constexpr double grid_volume_to_check = 0.005;  ///< of the body, that the integration points have not
inline constexpr double inertia_to_check = 0.1;        ///< of the tool's force, that the base does not bear
inline constexpr double energy_to_check = 0.02;        ///< as guards.hpp has it
inline constexpr double band_to_check = 0.1, band_too_wide = 0.25;  ///< half the width, of the force

/// For `image`, `model`, `equilibrium`, `energy` and `accuracy`, in this order: `word` is "good", "check" or
/// "bad"; `value` and `unit` are the number behind it, `of` says what it is of; `reasons`: why it is not
/// "good".
///
/// "check": a warning or a guard concerns it, or its number is beyond the limits above: the force may well be
/// right, and somebody should look. "bad": the run has failed there, or the number is far beyond.
nlohmann::ordered_json verdict_of(const Scene& scene, const Result& result, const std::string& status);

}  // namespace dimple
