#include "preprocess/scene/cut_face.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "preprocess/scene/flat_face.hpp"
#include "preprocess/scene/sides.hpp"

namespace dimple {
namespace {

// Least fraction of the outline: gentle sides of uncut organs have 0.29 to 0.39.
constexpr double large_fraction = 0.45;

// True if the face is across an axis of the voxels. The body's frame has the axes of the image.
bool runs_along_voxels(const BodySurface& body, const FlatFace& face) {
  const bool ends_with_image =
      std::any_of(body.image_ends().begin(), body.image_ends().end(), [&](const auto& end) {
        return end.out.dot(face.out) > 0.98 &&
               std::abs(end.offset - face.offset) < end.tolerance + face.tolerance;
      });
  return face.outermost && face.fraction >= large_fraction && face.out.cwiseAbs().maxCoeff() > 1.0 - 1e-9 &&
         !ends_with_image;
}

std::string in_words(const BodySurface& body, const FlatFace& face) {
  return fmt::format(
      "flat face of {:.3g} cm2 on the {} side, along one plane of voxels, where the segmentation may end and "
      "not the organ",
      face.area / 1e2, side_towards(body.to_world().linear() * face.out));
}

}  // namespace

FacesAlongVoxels faces_along_voxels(const BodySurface& body, const Boundary& boundary) {
  FacesAlongVoxels found;
  const Moments moments = moments_of(body);
  if (boundary.flat_base)
    if (const FlatFace face = face_towards(body, moments, boundary.down); runs_along_voxels(body, face))
      found.base = "a " + in_words(body, face);
  const FlatFace face = face_towards(body, moments, -boundary.approach);
  if (runs_along_voxels(body, face) &&
      std::abs(boundary.centre.dot(face.out) - face.offset) <= face.tolerance)
    found.tool = "the tool is on a " + in_words(body, face) + "; --indent-at gives another place";
  return found;
}

}  // namespace dimple
