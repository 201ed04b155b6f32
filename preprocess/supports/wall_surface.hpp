#pragma once

#include <functional>

#include "preprocess/supports/contact_surface.hpp"

namespace dimple {

/// What of a body's surface may come to a wall, as samples: all pieces that `may_touch` takes, by their place
/// [m] and their outward unit normal, but for what the base holds. At most `most` samples: where the nodes
/// are many a sample is the mean over several neighbouring ones. Empty: none. Throws Stopped.
using MayTouch = std::function<bool(const Vec3& place, const Vec3& outward)>;
ContactSurface wall_surface(const Model& model, const MayTouch& may_touch, Index most);

}  // namespace dimple
