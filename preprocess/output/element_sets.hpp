#pragma once

#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include "io/types.hpp"

namespace dimple {

/// An edge of a mesh by the numbers of its ends, the lesser first.
using Edge = std::pair<Index, Index>;
inline Edge edge(Index a, Index b) {
  return {std::min(a, b), std::max(a, b)};
}

/// How a refusal calls the mesh and its faces, and why it may have none where they are asked for.
struct MeshWords {
  std::string mesh, face, why;
};

/// Throws ModelError: the base or the circle has no node, or both have one in common.
void require_apart(const std::set<Index>& base, const std::set<Index>& circle, const MeshWords& words);

}  // namespace dimple
