#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/body_surface.hpp"

namespace dimple {

struct BoundaryOptions {
  /// auto, or the side that the organ rests on: inferior, superior, left, right, anterior, posterior (or
  /// bottom, top, front, back, or 3D Slicer's letters), or x,y,z: the LPS direction from the organ towards
  /// what it rests on. All are the patient's sides; auto alone looks for the organ's own.
  std::string base = "auto";
  double base_depth_mm = 0.0;  ///< how far up from the lowest point tissue is held; 0: chosen
  /// top: over the highest dome. left, right: over the highest dome of that half. x,y,z: LPS mm; x,y,top:
  /// where the push first meets the organ there.
  std::string indent_at = "top";
  double indenter_diameter_mm = 10.0;
  std::string direction =
      "auto";  ///< auto: towards the base; or x,y,z: LPS direction in which the circle moves
  double voxel_mm =
      0.0;  ///< longest edge of the image's voxels: finer than that nothing is known; 0: unknown
};

/// The fixed base and the indenter's circle as places on the surface; mm, in the surface's own frame.
struct Boundary {
  Vec3 down = -Vec3::UnitZ();  ///< unit vector towards what the organ rests on
  double lowest = 0.0;         ///< x . down on the plane that it rests on, or where a bed ends
  double height = 0.0;         ///< of the body above that
  double base_depth = 0.0;     ///< surface within this of `lowest` and facing down is held
  bool flat_base = false;      ///< the organ stands on a flat face, otherwise it lies in a bed
  Vec3 centre = Vec3::Zero();  ///< of the circle, on the surface
  Vec3 push = -Vec3::UnitZ();  ///< unit vector
  double radius = 5.0;
  double room = 0.0;  ///< from the centre to the nearest fold or edge, as far as was looked: 2.3 radii
  std::string base_reason, circle_reason;
  std::vector<std::string> warnings;
};

/// Finds the surface that the organ rests on, and the circle on the side opposite to it. Both belong to the
/// organ: they turn with it. Only where the organ itself leaves a choice do the patient's directions decide.
///
/// Base: the largest flat face beyond which the organ does not reach (at least a quarter of its outline
/// within 2 % of its height of a plane; of several as large the most inferior); otherwise the side across
/// which it is thinnest by its moments of inertia, its broader dome up, bedded to a third of its height as in
/// a mould; an organ that is as thin across other axes lies on the patient's inferior side of those. Circle:
/// the highest dome with room (circle_place.hpp). Throws UsageError (unknown word), ModelError (the indenter
/// misses the organ, hangs over its edge, is smaller than a voxel, or lies two diameters from the place asked
/// for).
///
/// `known`: of the same body under the same options for its base, whose base is taken instead of being looked for.
Boundary find_boundary(const BodySurface& body, const BoundaryOptions& options,
                       const Boundary* known = nullptr);

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
