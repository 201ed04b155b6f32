#pragma once

#include "preprocess/supports/interpolation.hpp"

namespace dimple {

/// A part of a body's surface that moves with its nodes: triangles no longer than the spacing of the nodes
/// near them, so that one place in each serves for integrals as pieces_of() has them.
struct SurfacePatch {
  Points corner;        ///< [3xV] at rest [m]
  Triangles triangles;  ///< outward
  Interpolation at_corner, at_middle;
};

double area_of(const SurfacePatch& patch);  ///< at rest [m^2]

/// Patch of some triangles of the model's surface, by their numbers.
SurfacePatch surface_patch(const Model& model, const std::vector<Index>& chosen);

}  // namespace dimple
