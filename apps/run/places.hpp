#pragma once

#include <string>
#include <vector>

#include "apps/run/simulate.hpp"
#include "apps/scene/scene.hpp"
#include "preprocess/scene/usable_places.hpp"

namespace dimple {

/// Where the tool may stand on an image's organ.
struct PlacesOfImage {
  UsablePlaces places;
  std::vector<std::string> warnings;
};

/// Of scene.image, or of `image` if there is one. Throws what reading an image and finding its base throw.
PlacesOfImage places_of_image(const Scene& scene, const LabelImage* image, const RunObserver& observer);

/// As JSON; lengths in mm, LPS.
std::string places_json(const Scene& scene, const PlacesOfImage& found);

/// What a warning says of a circle beneath which tissue will bend, with the next better place; empty: it will
/// not.
std::string warning_of_bending(const BodySurface& body, const Boundary& boundary);

}  // namespace dimple
