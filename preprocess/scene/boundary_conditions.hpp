#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/surface/body_surface.hpp"

namespace dimple {

struct BoundaryOptions {
  /// What the organ rests on: auto, organ, a side of the patient (sides.hpp), or x,y,z: the LPS direction
  /// from the organ towards it.
  std::string base = "auto";
  double base_depth_mm = 0.0;  ///< how far up from the lowest point tissue is held; 0: chosen
  /// Where the tool comes from: opposite (to the base) or a side of the patient, on the highest place there;
  /// either and a half of the organ, "superior,left". x,y,z: LPS mm; x,y,top: where it meets the organ there
  /// from superior.
  std::string indent_at = "opposite";
  double indenter_diameter_mm = 10.0;
  /// auto: from the side that indent_at names; or x,y,z: the LPS direction in which the circle moves. Where
  /// that is within 49 degrees of auto the circle stays at the place of auto.
  std::string direction = "auto";
  double voxel_mm =
      0.0;  ///< longest edge of the image's voxels: finer than that nothing is known; 0: unknown
  /// Of a tool that touches, which is indenter_diameter_mm wide: nodes are graded around a circle of this
  /// radius in its middle, and none of them is held. 0: the tool is the circle.
  double contact_radius_mm = 0.0;
  /// Of a round tool that touches: how far its surface is above its tip at a distance from its axis [mm of
  /// mm]. On a slope it touches beside its axis, and nodes are graded around that place.
  std::function<double(double)> height_of_tool = {};
  /// Of a tool that touches and goes on in steps: how far it has come after each, LPS mm; nodes are as fine
  /// along that way. Of one that goes straight in: none.
  std::vector<Vec3> way_of_tool = {};
  /// The same of one that turns, which depends on its push, and on where it first touches, LPS mm.
  std::function<std::vector<Vec3>(const Vec3& push, const Vec3& place_mm)> way_of_turning_tool = {};
  /// Where further tools touch, LPS mm: nodes are as fine around the nearest place of the surface.
  std::vector<Vec3> other_tools = {};
  bool is_pressed = true;  ///< false: no tool presses there, and it is a place for fine nodes alone
};

/// The fixed base and the tool's circle as places on the surface; mm, in the surface's own frame.
struct Boundary {
  Vec3 down = -Vec3::UnitZ();  ///< unit vector towards what the organ rests on
  double lowest = 0.0;         ///< x . down on the plane that it rests on, or where a bed ends
  double height = 0.0;         ///< of the body above that
  double base_depth = 0.0;     ///< surface within this of `lowest` and facing down is held
  bool flat_base = false;      ///< the organ stands on a flat face, otherwise it lies in a bed
  bool base_by_axes = false;   ///< the patient's axes have decided on which side
  Vec3 centre = Vec3::Zero();  ///< of the circle, on the surface
  Vec3 push = -Vec3::UnitZ();  ///< unit vector
  double radius = 5.0;
  double room = 0.0;  ///< from the centre to the nearest fold or edge, as far as was looked: 2.3 radii
  bool over_cut =
      false;  ///< a tool that touches stands on a body with cuts: its places lie on the banks' edges
  std::string base_reason, circle_reason;
  std::vector<std::string> warnings;
};

/// Throws UsageError: `base` or `indent_at` is no word or place that find_boundary() knows.
void check_words(const BoundaryOptions& options);

/// Finds the surface that the organ rests on, and the circle.
///
/// Base, where it is auto: the largest flat face, where an organ was cut (at least 45 % of its outline within
/// 2 % of its height of a plane beyond which it does not reach; of several as large the most inferior),
/// unless the image ends there. Without one the patient's axes decide, as in Horton et al. (2007): the side
/// opposite to the one that `indent_at` names; the inferior side; or the posterior one, where the image cuts
/// the organ off above or below. organ: the largest flat face from a quarter of the outline on, also where
/// the image ends; without one the broadest side, across which it is thinnest by its moments of inertia, its
/// broader dome up. That turns with the organ. A side whose flat part is less than a quarter of the outline
/// is a bed to a third of the organ's height, as in a mould. Circle: the highest dome with room
/// (circle_place.hpp). Warns of a base or a circle where the image ends.
///
/// Throws UsageError (unknown word; a direction that does not come from the side), ModelError (the tool
/// misses the organ, hangs over its edge, is smaller than a voxel, or lies two diameters from the place asked
/// for).
///
/// `known`: of the same body under the same options for its base, whose base is taken instead of being looked
/// for; and its push, for a place x,y,z.
Boundary find_boundary(const BodySurface& body, const BoundaryOptions& options,
                       const Boundary* known = nullptr);

/// Where a tool that moves along the push on the circle's axis first touches the surface, of that within
/// `reach` [mm] of its axis; `height` as BoundaryOptions::height_of_tool. The circle's middle, if nowhere
/// sooner.
Vec3 place_of_touch(const BodySurface& body, const Boundary& boundary, double reach,
                    const std::function<double(double)>& height);

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
