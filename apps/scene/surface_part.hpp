#pragma once

#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "apps/scene/option_word.hpp"
#include "preprocess/model.hpp"

namespace dimple {

/// A part of a body's surface as options name it: all of it, what faces a side of the patient within 45
/// degrees, or what lies in a ball.
struct SurfacePart {
  std::optional<Vec3> side;             ///< LPS unit vector
  std::optional<Eigen::Vector4d> ball;  ///< centre and radius [mm, LPS]
  /// Whether it holds a place with that outward normal, of any length.
  bool has(const Vec3& place_mm, const Vec3& normal) const;
};

/// Words of a part of the surface: all, a side such as superior (sides.hpp), or x,y,z,radius.
std::vector<WordForm> forms_of_surface_part();
SurfacePart surface_part_of(const OptionWord& word);
/// Part that the option `where` of `of`, "the pressure 'csf'", names. Throws UsageError.
SurfacePart surface_part_named(const std::string& on, const std::string& where, const std::string& of);

/// The triangles of a surface that it holds, by their middles.
std::vector<Index> triangles_on(const SurfacePart& part, const Surface& surface);
/// The same without the banks of cuts, on which nothing lies that lay on the whole body.
std::vector<Index> uncut_triangles_on(const SurfacePart& part, const Surface& surface);

/// Cosine of the largest angle at which a surface faces a direction.
inline constexpr double facing = std::numbers::sqrt2 / 2.0;

}  // namespace dimple
