#pragma once

#include "io/types.hpp"

namespace dimple {

/// How pictures show a body: up is against the push, its longest direction across the push lies along the
/// picture. Unit vectors, each at right angles to the others.
struct BodyFrame {
  Vec3 up;     ///< against the push
  Vec3 broad;  ///< the longest direction of the body across the push
  Vec3 front;  ///< out of the picture, toward the viewer
};

/// Of the body with nodes at these places. Deterministic: the same body gives the same frame, whatever the
/// signs of its eigenvectors. Places and a push that are not finite do not count.
BodyFrame body_frame(const Points& nodes, const Vec3& circle_centre, const Vec3& push);

}  // namespace dimple
