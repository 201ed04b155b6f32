#pragma once

#include <vector>

#include "preprocess/surface/height_map.hpp"

namespace dimple {

/// A flat part of a surface, beyond which the body does not reach: what it can stand on.
struct FlatFace {
  Vec3 out;                ///< unit vector out of the body
  double offset = 0.0;     ///< x . out on its plane [mm]
  double height = 0.0;     ///< of the body above it [mm]
  double tolerance = 0.0;  ///< surface within this of the plane belongs to it [mm]
  double area = 0.0;       ///< of that surface where it faces out, seen along `out` [mm^2]
  double share = 0.0;      ///< that / the body's outline seen along `out`; below a fifth a bound from above
  bool outermost = false;  ///< nothing of the body lies clearly beyond the plane
};

/// Planes are sought where many normals agree and fitted to the surface there, so that they turn with the
/// body. Within a quarter of a degree of an axis of the body's frame a plane's normal is taken as that axis.
/// Largest face first.
std::vector<FlatFace> flat_faces(const BodySurface& body, const Moments& moments);

/// The plane across `out` that most of the outermost surface touches.
FlatFace face_towards(const BodySurface& body, const Moments& moments, const Vec3& out);

}  // namespace dimple
