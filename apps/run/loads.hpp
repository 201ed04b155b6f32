#pragma once

#include "apps/scene/scene.hpp"
#include "solver/terms/loads.hpp"

namespace dimple {

/// Throws UsageError: a pressure or a membrane names no part of the surface.
void check_loads(const Scene& scene, const Surface& surface);

/// Gravity, pressures and membranes of `scene`, on the model's surface. Their parts are chosen on
/// `chosen_on`, which has the same triangles as imaged. Throws as check_loads().
Loads loads_of(const Scene& scene, const Model& model, const Surface& chosen_on);

/// "gravity 9.81 m/s2 (inferior), pressure csf 500 Pa"; membranes are left out.
std::string in_words(const Loads& loads);

}  // namespace dimple
