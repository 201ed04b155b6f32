#pragma once

#include "apps/scene/description.hpp"
#include "apps/scene/scene.hpp"

namespace dimple {

/// Scene of options that complete() has completed. In a run, only this function reads them. Throws
/// UsageError: a text is not understood, or parts of the scene contradict each other; InputError: a file of a
/// tool, a wall or a cut. check_pairs() checks which features exclude each other.
Scene resolve(const Description& description);

}  // namespace dimple
