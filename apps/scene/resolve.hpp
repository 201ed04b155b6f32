#pragma once

#include "apps/scene/description.hpp"
#include "apps/scene/scene.hpp"

namespace dimple {

/// The scene that options describe, once complete() has completed them. The only function of a run
/// that reads them. Throws UsageError: a word is not understood, or parts of the scene contradict each other;
/// InputError: a file of a tool, a wall or a cut. What of a scene goes together is checked by check_pairs().
Scene resolve(const Description& description);

}  // namespace dimple
