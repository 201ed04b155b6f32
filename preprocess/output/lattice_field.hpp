#pragma once

#include <array>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// A lattice with displacements that are known at some of its points.
struct LatticeField {
  std::array<Index, 3> n{};
  std::vector<char> known;  ///< [points]
  std::vector<float> v;     ///< [3 x points]
  Index points() const { return n[0] * n[1] * n[2]; }
  Index number(Index a, Index b, Index c) const { return a + n[0] * (b + n[1] * c); }
};

/// Continues the known values nearly harmonically to all points, from coarse lattices to fine ones. `weight`:
/// of the differences along each axis, one over the squared step. Throws Stopped.
void continue_smoothly(LatticeField& lattice, const Vec3& weight);

}  // namespace dimple
