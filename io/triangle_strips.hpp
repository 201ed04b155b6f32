#pragma once

#include "io/types.hpp"

namespace dimple {

/// The same triangles in another order, each from another of its corners, so that they follow each other as
/// in long strips (a, b, c), (c, b, d), (c, d, e): files of them are packed best. Each strip goes on as far
/// as it can over triangles that are not yet in one.
Triangles in_strips(const Triangles& triangles);

}  // namespace dimple
