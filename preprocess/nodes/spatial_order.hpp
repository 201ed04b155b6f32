#pragma once

#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Numbers of the places along a Hilbert curve: places near in space are near in memory.
std::vector<Index> spatial_order(const Points& places);

}  // namespace dimple
