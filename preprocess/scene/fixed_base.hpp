#pragma once

#include <optional>
#include <string>

#include "preprocess/scene/boundary_conditions.hpp"
#include "preprocess/surface/height_map.hpp"

namespace dimple {

/// An LPS direction in the body's own frame.
Vec3 local_direction(const BodySurface& body, const Vec3& lps);
/// The image axis nearest to an LPS direction: a side of the image, not of the scanner's room.
Vec3 nearest_axis(const BodySurface& body, const Vec3& lps);
/// "inferior side", or "inferior side (0.17, 0.00, -0.98)" where `down` is not along that axis of the
/// patient.
std::string side_in_words(const BodySurface& body, const Vec3& down);

/// Direction named by BoundaryOptions::base, LPS; nothing for auto and organ. Throws UsageError.
std::optional<Vec3> base_direction(const std::string& text);

/// Finds the base as find_boundary() describes it, into `result`. `from`: the requested side of the tool,
/// LPS. Throws UsageError.
void find_base(const BodySurface& body, const Moments& moments, const BoundaryOptions& options,
               const std::optional<Vec3>& from, Boundary& result);

/// Warns of a base where the image ends, since the tissue continues there.
void warn_of_base_at_image_end(const BodySurface& body, Boundary& result);

}  // namespace dimple
