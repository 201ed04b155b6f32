#pragma once

#include <string>
#include <vector>

#include "apps/run/simulate.hpp"
#include "apps/scene/scene.hpp"
#include "preprocess/scene/usable_places.hpp"

namespace dimple {

/// Usable places of the tool on an image's organ.
struct PlacesOfImage {
  UsablePlaces places;
  std::vector<std::string> warnings;
};

/// Places on scene.image, or on `image` if given. Throws the errors of reading an image and finding its base.
PlacesOfImage places_of_image(const Scene& scene, const LabelImage* image, const RunObserver& observer);

/// JSON of the places; lengths in mm, LPS.
std::string places_json(const Scene& scene, const PlacesOfImage& found);

/// Warning that the tissue under the bonded patch will bend, with the next better place; empty: it will not.
std::string warning_of_bending(const BodySurface& body, const Boundary& boundary);

}  // namespace dimple
