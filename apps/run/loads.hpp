#pragma once

#include <optional>

#include "apps/scene/option_word.hpp"
#include "apps/scene/scene.hpp"
#include "solver/terms/loads.hpp"

namespace dimple {

/// Before anything is built: throws UsageError where the words of gravity, of a pressure or of a membrane are
/// not understood; and where a pressure or a membrane names no part of the surface.
void check_loads(const Scene& scene);
void check_loads(const Scene& scene, const Surface& surface);

/// What `scene` says of gravity, pressures and membranes, on the model's surface; the parts of it are chosen
/// on `chosen_on`, the same triangles as the image has them. Throws as check_loads().
Loads loads_of(const Scene& scene, const Model& model, const Surface& chosen_on);

/// "gravity 9.81 m/s2 (inferior), pressure csf 500 Pa"; of membranes nothing.
std::string in_words(const Loads& loads);

/// Which way is up, and the share of the body's height that a fluid has left, in [0, 1]: of "anterior,60%"
/// (load.fluid_lost). Nothing: no fluid is lost. Throws UsageError: it is not understood.
struct FluidWords {
  Vec3 up;
  double share;
};
/// Share of the body's height as an option gives it, in percent.
WordNumber share_of_lost_fluid();
std::optional<FluidWords> fluid_lost_of(const Scene& scene);

}  // namespace dimple
