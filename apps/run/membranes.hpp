#pragma once

#include "apps/scene/scene.hpp"
#include "solver/terms/membrane.hpp"

namespace dimple {

/// Throws UsageError before anything is built: a membrane is not understood, has neither stiffness nor
/// tension, or names no part of the surface. ModelError: there is no surface.
void check_membranes(const Scene& scene, const Surface& surface);

/// All membranes by name; that of --membrane is called "surface". Their parts are as in loads_of(). Throws as
/// check_membranes().
std::vector<Membrane> membranes_on(const Scene& scene, const Model& model, const Surface& chosen_on);

/// "pia: 0.1 mm of 400 kPa (40 N/m) on 5600 mm2".
std::string in_words(const Membrane& film);

}  // namespace dimple
