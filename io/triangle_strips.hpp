#pragma once

#include "io/types.hpp"

namespace dimple {

/// The triangles in another order and rotation, so that they follow each other as in long strips: (a, b, c),
/// (c, b, d), (c, d, e). Such files compress best. Each strip continues as far as it can over triangles that
/// are in none yet.
Triangles in_strips(const Triangles& triangles);

}  // namespace dimple
