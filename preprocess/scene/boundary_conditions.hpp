#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/surface/body_surface.hpp"

namespace dimple {

struct BoundaryOptions {
  /// Support of the organ: auto, organ, a side of the patient (sides.hpp), or x,y,z: the LPS direction from
  /// the organ towards it.
  std::string base = "auto";
  double base_depth_mm = 0.0;  ///< height above the lowest point up to which tissue is held; 0: chosen
  /// Side that the tool comes from: opposite (to the base) or a side of the patient, on the highest place
  /// there; either and a half of the organ, "superior,left". x,y,z: LPS mm; x,y,top: the place met from
  /// superior.
  std::string indent_at = "opposite";
  double indenter_diameter_mm = 10.0;
  /// Direction of motion: auto, from the side that indent_at names; or x,y,z in LPS. Within 49 degrees of
  /// auto the patch stays at the place of auto.
  std::string direction = "auto";
  double voxel_mm = 0.0;  ///< longest edge of the image's voxels, the limit of its accuracy; 0: unknown
  /// Radius of the contact patch of a contacting tool, indenter_diameter_mm wide: nodes are graded around it
  /// and none is held. 0: the patch is bonded.
  double contact_radius_mm = 0.0;
  /// Height of a round contacting tool's surface above its tip at a distance from its axis [mm of mm]. On a
  /// slope its first contact is off its axis, and nodes are graded around that place.
  std::function<double(double)> height_of_tool = {};
  /// Displacement of a contacting tool after each of its steps, LPS mm; nodes are as fine along that path.
  /// None for a straight approach.
  std::vector<Vec3> path_of_tool = {};
  /// Displacements of a turning tool, from its approach direction and its first contact, LPS mm.
  std::function<std::vector<Vec3>(const Vec3& approach, const Vec3& place_mm)> path_of_turning_tool = {};
  /// Contacts of further tools, LPS mm: nodes are as fine around the nearest place of the surface.
  std::vector<Vec3> other_tools = {};
  bool is_pressed = true;  ///< false: no tool presses there, and only nodes are refined
};

/// The fixed base and the contact patch as places on the surface; mm, in the surface's own frame.
struct Boundary {
  Vec3 down = -Vec3::UnitZ();      ///< unit vector towards the support of the organ
  double lowest = 0.0;             ///< x . down on the plane of the base, or at the upper end of a bed
  double height = 0.0;             ///< of the body above that
  double base_depth = 0.0;         ///< surface within this of `lowest` and facing down is held
  bool flat_base = false;          ///< the organ is on a flat face, otherwise in a bed
  bool base_by_axes = false;       ///< the patient's axes have decided on which side
  Vec3 centre = Vec3::Zero();      ///< of the contact patch, on the surface
  Vec3 approach = -Vec3::UnitZ();  ///< unit vector
  double radius = 5.0;
  double room = 0.0;  ///< from the centre to the nearest fold or edge, searched up to 2.3 radii
  bool over_cut =
      false;  ///< a contacting tool is on a body with cuts: its places are on the edges of their faces
  std::string base_reason, patch_reason;
  std::vector<std::string> warnings;
};

/// Throws UsageError: `base` or `indent_at` is no word or place that find_boundary() accepts.
void check_words(const BoundaryOptions& options);

/// Base that the organ rests on, and contact patch of the tool. Rules of this project, except step 2.
///
/// 1. Base auto: the largest flat face where an organ was cut (flat_face.hpp), with at least 45 % of the
///    outline, unless the image ends there. Of faces within 5 % in area: the most inferior one.
/// 2. Without one the patient's axes decide, as in Horton et al. (2007): the side opposite to the one that
///    `indent_at` names. Else the inferior side, or the posterior one if the image cuts the organ off above
///    or below, and not in front or behind.
/// 3. Base organ: the largest flat face from 25 % of the outline, also where the image ends. Without one: the
///    broadest side, across which the organ is thinnest by its moments of inertia, its broader dome up.
/// 4. A side whose flat part is less than 25 % of the outline is a bed to a third of the organ's height.
/// 5. Contact patch: the highest dome with room (patch_place.hpp), or the requested place.
///
/// Warns of a base or a patch where the image ends. Throws UsageError: unknown word; a direction that does
/// not come from the side. Throws ModelError: the tool misses the organ, hangs over its edge, is smaller than
/// a voxel, or the organ is two diameters from the requested place. `known`: of the same body under the same
/// options for its base; supplies the base, and the direction for a place x,y,z.
Boundary find_boundary(const BodySurface& body, const BoundaryOptions& options,
                       const Boundary* known = nullptr);

/// First contact of a tool that moves along the patch's axis, within `reach` [mm] of the axis; `height` as
/// BoundaryOptions::height_of_tool. The middle of the patch if nothing is met sooner.
Vec3 place_of_contact(const BodySurface& body, const Boundary& boundary, double reach,
                      const std::function<double(double)>& height);

/// True if a place on the surface, with outward normal n, belongs to the base.
bool on_base(const Boundary& boundary, const Vec3& x, const Vec3& normal);

/// Nodes of the contact patch: one in the middle and rings outwards, the last on the edge of the patch;
/// neighbours are at most `spacing` apart. [3xn] mm.
Points patch_nodes(const BodySurface& body, const Boundary& boundary, double spacing_mm);

/// Nodes of the patch for a spacing [mm] that changes with the distance from the axis [mm]; spacing(radius)
/// holds on the edge.
Points graded_patch_nodes(const BodySurface& body, const Boundary& boundary,
                          const std::function<double(double)>& spacing);

/// `count` places on the edge of the patch, evenly by angle. [3xcount] mm.
Points edge_of_patch(const BodySurface& body, const Boundary& boundary, int count);

/// Places as the columns of one matrix. [3xn]
Points to_points(const std::vector<Vec3>& places);

/// "x,y,z" as three numbers, or nothing.
std::optional<Vec3> parse_vector(const std::string& text);

}  // namespace dimple
