#pragma once

#include <optional>
#include <vector>

#include "preprocess/cloud/sizing.hpp"
#include "preprocess/surface/body_surface.hpp"

namespace dimple {

struct SmallTriangle {
  Vec3 a, b, c, normal;
  double area;  ///< [mm^2]
};

/// Triangles so small that the spacing is nearly the same all over each, with the sizing in its middle.
struct GradedFacets {
  std::vector<SmallTriangle> triangle;
  std::vector<double> sizing;
};

/// Nothing, if it takes more than `most` besides the surface's own. Throws Stopped.
std::optional<GradedFacets> facets_of(const BodySurface& body, const Sizing& sizing, double far_spacing,
                                      std::size_t most);

/// Boxes a few to a node.
struct GradedBoxes {
  std::vector<Leaf> leaf;
  std::vector<double> size;  ///< how much of the body each holds [mm^3]
};

/// Nothing, if it takes more than `most`. Throws Stopped.
std::optional<GradedBoxes> boxes_of(const BodySurface& body, const Sizing& sizing, double far_spacing,
                                    std::size_t most);

}  // namespace dimple
