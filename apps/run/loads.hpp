#pragma once

#include "apps/run/config.hpp"
#include "solver/terms/loads.hpp"

namespace dimple {

/// Before anything is built: throws UsageError where the words of gravity or of a pressure are not
/// understood; and where a pressure names no part of the surface.
void check_loads(const Config& config);
void check_loads(const Config& config, const Surface& surface);

/// What config.load says of gravity and of pressures, on the model's surface. Throws UsageError: a pressure
/// names no part of it; ModelError: the model has no surface.
Loads loads_of(const Config& config, const Model& model);

/// "gravity 9.81 m/s2 (inferior), pressure csf 500 Pa".
std::string in_words(const Loads& loads);

}  // namespace dimple
