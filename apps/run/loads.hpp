#pragma once

#include "apps/run/config.hpp"
#include "solver/loads.hpp"

namespace dimple {

/// What config.load says of gravity and of pressures, on the model's surface. Throws UsageError: a pressure names no
/// part of it; ModelError: the model has no surface.
Loads loads_of(const Config& config, const Model& model);

/// "gravity 9.81 m/s2 (inferior), pressure csf 500 Pa".
std::string in_words(const Loads& loads);

}  // namespace dimple
