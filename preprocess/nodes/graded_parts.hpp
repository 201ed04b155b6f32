#pragma once

#include <optional>
#include <vector>

#include "preprocess/nodes/sizing.hpp"
#include "preprocess/surface/body_surface.hpp"

namespace dimple {

struct SmallTriangle {
  Vec3 a, b, c, normal;
  double area;  ///< [mm^2]
};

/// Triangles with nearly constant spacing: the surface's own, and parts of large ones.
struct GradedFacets {
  struct Facet {
    int triangle, part;              ///< of the surface; of `part`, or -1
    double area;                     ///< [mm^2]
    double sizing, distance, finer;  ///< in its middle
  };
  std::vector<Facet> facet;
  std::vector<SmallTriangle> part;
};
SmallTriangle triangle_of(const BodySurface& body, const GradedFacets& facets, std::size_t k);

/// Nothing if more than `most` triangles are necessary in addition to the surface's own. Throws Stopped.
std::optional<GradedFacets> facets_of(const BodySurface& body, const Sizing& sizing, double far_spacing,
                                      std::size_t most);

/// Boxes of a few nodes' volume.
struct GradedBoxes {
  std::vector<Leaf> leaf;
  std::vector<double> size;  ///< volume of the body in each [mm^3]
};

/// Nothing if more than `most` boxes are necessary. Throws Stopped.
std::optional<GradedBoxes> boxes_of(const BodySurface& body, const Sizing& sizing, double far_spacing,
                                    std::size_t most);

}  // namespace dimple
