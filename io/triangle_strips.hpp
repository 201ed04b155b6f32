#pragma once

#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Triangles as strips: a strip of corners a, b, c, d, e is the triangles (a, b, c), (c, b, d), (c, d, e), so
/// that each after the first takes one number and not three.
struct TriangleStrips {
  std::vector<int> corner;
  std::vector<int> offset = {0};  ///< of each strip's first corner; one more at the end
  std::vector<Index> first;       ///< of each strip, its first triangle
};

/// The triangles as they stand: a strip ends where the next one does not go on from it, or `kind` of it
/// [1xT, or none] is another. Taken apart by triangles_of() they are the same, in order and first corners.
TriangleStrips strips_in(const Triangles& triangles, const Eigen::MatrixXd& kind = {});
Triangles triangles_of(const TriangleStrips& strips);

/// The same triangles in another order, each from another of its corners, so that they form long strips:
/// each goes on as far as it can over triangles that are not yet in one.
Triangles in_strips(const Triangles& triangles);

}  // namespace dimple
