#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "apps/run/simulate.hpp"

namespace dimple {

// Verdict on a run before its numbers: `verdict` of summary.json, and the head of report.html.

/// Limits beyond which a number is no longer "good". Fractions, not per cent.
inline constexpr double volume_to_check = 0.05;        ///< of the labels: difference of the body's volume
inline constexpr double grid_volume_to_check = 0.005;  ///< of the body: volume missing in the points
inline constexpr double inertia_to_check = 0.1;        ///< of the tool's force: not carried by the base
inline constexpr double energy_to_check = 0.02;        ///< as in guards.hpp
inline constexpr double error_to_check = 0.1, error_too_large = 0.25;  ///< half-width, of the force

/// Verdicts on `image`, `model`, `equilibrium`, `energy` and `accuracy`, in this order: `word` is "good",
/// "check" or "bad"; `value` and `unit` are its number, `of` what that measures; `reasons`: why it is not
/// "good".
///
/// "check": a warning or a guard concerns it, or its number exceeds a limit above; the force may be right,
/// but a person should check. "bad": the run has failed there, or the number is far beyond the limit.
nlohmann::ordered_json verdict_of(const Scene& scene, const Result& result, const std::string& status);

}  // namespace dimple
