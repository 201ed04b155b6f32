#pragma once

#include <string>
#include <vector>

#include "apps/run/config.hpp"
#include "apps/run/simulate.hpp"
#include "preprocess/scene/usable_places.hpp"

namespace dimple {

/// Where the tool may stand on an image's organ.
struct PlacesOfImage {
  UsablePlaces places;
  std::vector<std::string> warnings;
};

/// Of config.image, or of `image` if there is one. Throws what reading an image and finding its base throw.
PlacesOfImage places_of_image(const Config& config, const LabelImage* image, const RunObserver& observer);

/// As JSON; lengths in mm, LPS.
std::string places_json(const Config& config, const PlacesOfImage& found);

/// What a warning says of a circle beneath which tissue will bend, with the next better place; empty: it will
/// not.
std::string warning_of_bending(const BodySurface& body, const Boundary& boundary);

}  // namespace dimple
