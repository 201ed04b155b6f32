#pragma once

#include <vector>

#include "preprocess/surface/height_map.hpp"

namespace dimple {

/// A flat part of a surface that the body does not exceed, and may rest on.
struct FlatFace {
  Vec3 out;                ///< unit vector out of the body
  double offset = 0.0;     ///< x . out on its plane [mm]
  double height = 0.0;     ///< of the body above it [mm]
  double tolerance = 0.0;  ///< surface within this of the plane belongs to it [mm]
  double area = 0.0;       ///< of that surface where it faces out, projected along `out` [mm^2]
  double fraction = 0.0;   ///< that / the body's outline projected along `out`; below a fifth an upper bound
  bool outermost = false;  ///< no part of the body is clearly beyond the plane
};

/// Flat faces of a body, the largest first. They turn with the body. A method of this project.
/// 1. Candidates: binned triangle normals with most surface within 12 degrees, at least 25 degrees apart.
/// 2. For each: the slab of twice the tolerance near the outermost place with most surface facing out (cosine
///    at least 0.85); tolerance = 2 % of the height, or more for coarse triangles. Its plane halves that
///    surface.
/// 3. New direction: normal of the least-squares plane through the slab's triangles. Steps 2 and 3 repeat to
///    1e-5, at most 20 times.
/// 4. Directions within 0.25 degrees of an axis of the body's frame become that axis; those within 5 degrees
///    of another are dropped.
/// 5. Area within the tolerance of the plane / area of the body's outline.
std::vector<FlatFace> flat_faces(const BodySurface& body, const Moments& moments);

/// The plane across `out` that holds most of the outermost surface.
FlatFace face_towards(const BodySurface& body, const Moments& moments, const Vec3& out);

}  // namespace dimple
