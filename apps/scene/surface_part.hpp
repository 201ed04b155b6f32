#pragma once

#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "apps/scene/option_word.hpp"
#include "preprocess/model.hpp"

namespace dimple {

/// Part of a body's surface: all of it, the part that faces a side of the patient within 45 degrees, or the
/// part in a ball.
struct SurfacePart {
  std::optional<Vec3> side;             ///< LPS unit vector
  std::optional<Eigen::Vector4d> ball;  ///< centre and radius [mm, LPS]
  /// True if the part contains a point with that outward normal, of any length.
  bool has(const Vec3& place_mm, const Vec3& normal) const;
};

/// Forms of the option: all, a side such as superior (sides.hpp), or x,y,z,radius.
std::vector<WordForm> forms_of_surface_part();
SurfacePart surface_part_of(const OptionWord& word);
/// Part that the option `where` of `of`, "the pressure 'csf'", names. Throws UsageError.
SurfacePart surface_part_named(const std::string& on, const std::string& where, const std::string& of);

/// Triangles of a surface whose centroids are in the part.
std::vector<Index> triangles_on(const SurfacePart& part, const Surface& surface);
/// Triangles on the part except the faces of cuts, which the uncut body did not have.
std::vector<Index> uncut_triangles_on(const SurfacePart& part, const Surface& surface);

/// Cosine of the largest angle at which a surface faces a direction.
inline constexpr double facing = std::numbers::sqrt2 / 2.0;

}  // namespace dimple
