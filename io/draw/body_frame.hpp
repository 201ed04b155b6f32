#pragma once

#include "io/types.hpp"

namespace dimple {

/// Orientation of a body in pictures: up is against the press direction, the body's longest direction across
/// it is horizontal. Orthonormal vectors.
struct BodyFrame {
  Vec3 up;     ///< against the press direction
  Vec3 broad;  ///< the longest direction of the body across the press direction
  Vec3 front;  ///< out of the picture, toward the viewer
};

/// Frame of the body with these nodes. Deterministic: the same body gives the same frame for any signs of its
/// eigenvectors. Places and a direction that are not finite do not count.
BodyFrame body_frame(const Points& nodes, const Vec3& patch_centre, const Vec3& approach);

}  // namespace dimple
