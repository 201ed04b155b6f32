#pragma once

#include <functional>

#include "preprocess/supports/contact_surface.hpp"

namespace dimple {

/// Samples of the part of a body's surface that may come to a wall: all pieces for which `may_contact`(place
/// [m], outward unit normal) is true, except those that the base holds. At most `most` samples: with many
/// nodes a sample is the mean over several neighbours. Empty: none. Throws Stopped.
using MayContact = std::function<bool(const Vec3& place, const Vec3& outward)>;
ContactSurface wall_surface(const Model& model, const MayContact& may_contact, Index most);

}  // namespace dimple
