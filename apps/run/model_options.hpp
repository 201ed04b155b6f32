#pragma once

#include "apps/run/error_bounds.hpp"
#include "apps/scene/scene.hpp"

namespace dimple {

/// Choices of the nodes and points of a scene's model.
ModelOptions model_options(const Scene& scene);

/// Smallest error that the bounds of this scene can show: see ErrorFloor.
ErrorFloor error_floor(const Scene& scene);

}  // namespace dimple
