#pragma once

#include <vector>

#include "io/types.hpp"

namespace dimple {

/// The numbers of the places along a Hilbert curve: what is near in space comes to be near in memory.
std::vector<Index> spatial_order(const Points& places);

}  // namespace dimple
