#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/body_surface.hpp"

namespace dimple {

struct BoundaryOptions {
  /// auto, or the side that the organ rests on: inferior, superior, left, right, anterior, posterior, or
  /// x,y,z: the LPS direction from the organ towards what it rests on.
  std::string base = "auto";
  double base_depth_mm = 0.0;  ///< how far up from the lowest point tissue is held; 0: chosen
  /// top: over the highest dome. left, right: over the highest dome of that half. x,y,z: LPS mm.
  std::string indent_at = "top";
  double indenter_diameter_mm = 10.0;
  std::string direction =
      "auto";  ///< auto: towards the base; or x,y,z: LPS direction in which the circle moves
};

/// The fixed base and the indenter's circle as places on the surface; mm, in the surface's own frame.
struct Boundary {
  Vec3 down = -Vec3::UnitZ();  ///< unit vector towards what the organ rests on
  double lowest = 0.0;         ///< largest x . down on the body
  double height = 0.0;         ///< extent along down
  double base_depth = 0.0;     ///< surface within this of `lowest` and facing down is held
  bool flat_base = false;      ///< the organ stands on a flat face, otherwise it lies in a bed
  Vec3 centre = Vec3::Zero();  ///< of the circle, on the surface
  Vec3 push = -Vec3::UnitZ();  ///< unit vector
  double radius = 5.0;
  std::string base_reason, circle_reason;
};

/// Finds the surface that the organ rests on, and the circle on the side opposite to it.
///
/// Base: of the six axis directions of the image the one on which the organ stands with its largest flat face
/// (at least a quarter of its outline, within 2 % of its height); otherwise the one across which it is
/// thinnest, its broader dome up, bedded to a third of its height as in a mould. Circle: where the mean
/// height over a disc of the indenter's size is greatest ("the highest dome"); places within a quarter per
/// cent of the height of that count as equal, and the one nearest to the middle is taken. Throws UsageError
/// (unknown word), ModelError (the indenter misses the organ, or hangs over its edge).
Boundary find_boundary(const BodySurface& body, const BoundaryOptions& options, double node_spacing_mm);

/// Whether a place on the surface, with outward normal n, belongs to the base.
bool on_base(const Boundary& boundary, const Vec3& x, const Vec3& normal);

/// The nodes that make the circle: one in the middle and rings out to the rim, on the rim itself the
/// outermost; neighbours are `spacing` apart at most. [3xn] mm.
Points circle_nodes(const BodySurface& body, const Boundary& boundary, double spacing_mm);

/// The same for a spacing [mm] that changes with the distance from the axis [mm]; the rim's own is
/// spacing(radius).
Points graded_circle_nodes(const BodySurface& body, const Boundary& boundary,
                           const std::function<double(double)>& spacing);

/// `count` places on the rim, evenly by angle. [3xcount] mm.
Points rim_of_circle(const BodySurface& body, const Boundary& boundary, int count);

/// Places side by side. [3xn]
Points to_points(const std::vector<Vec3>& places);

/// "x,y,z" as three numbers, or nothing.
std::optional<Vec3> parse_vector(const std::string& text);

}  // namespace dimple
