#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "io/types.hpp"
#include "preprocess/scene/tool_mesh.hpp"

namespace dimple {

/// Current pose of a tool: its tip, and the unit vector from its upper end to its tip.
struct ToolPose {
  Vec3 tip = Vec3::Zero();          ///< [m]
  Vec3 points_at = -Vec3::UnitZ();  ///< unit vector
  /// [3x3] axes of the frame of a drawn tool: z away from points_at, x as close to x (LPS: to the left) as
  /// possible, or to y if points_at is along x. For a rotated tool: its first axes, rotated with it.
  Mat3 axes() const;
  std::optional<Mat3> turned_axes = {};
};

/// Signed distance from the tool's surface to a place, negative inside the tool [m]; and its gradient, the
/// unit normal of the nearest surface point, out of the tool.
struct ToolDistance {
  double distance;
  Vec3 normal;
};

/// Distance [m] in the half-plane through the axis of a body of revolution, and its derivatives by the radius
/// and by the height above the tip.
struct ProfileDistance {
  double distance, by_r, by_z;
};

/// Rigid tool with its tip at the bottom, or wall, as functions. SI units. The functions below make it, also
/// again from its kind and numbers.
struct ToolShape {
  std::string kind = {};             ///< name of the maker: "sphere"
  std::vector<double> numbers = {};  ///< arguments of the maker [m], an angle [rad]
  double radius = 0.0;               ///< half of its width [m]; of a wall a length for its tolerances
  double edge = 0.0;                 ///< edge radius of a flat end [m]; 0: no flat end
  double length = std::numeric_limits<double>::infinity();  ///< from the tip to the upper end [m]

  std::function<ProfileDistance(double r, double z)> profile = {};  ///< of a body of revolution
  /// Signed distance at a place relative to the tip, where there is no profile.
  std::function<ToolDistance(const ToolPose&, const Vec3&)> distance = {};
  std::function<double(double r)> height = {};  ///< see height_of_tool(); empty for a wall
  /// Height straight above a place relative to the tip, where there is no profile.
  std::function<double(const ToolPose&, const Vec3&)> height_over = {};

  /// Depth [m] and force over E / (1 - nu^2) [m^2] of contact within a radius on a half-space; empty:
  /// unknown.
  std::function<double(double a)> contact_depth = {}, contact_force = {};
  std::function<double(double depth)> contact_radius = {};  ///< [m], where contact_depth is unknown
  /// Outline for a picture, with `rings` for a quarter arc: radii and heights above the tip [m], the last the
  /// middle of the upper end. Empty for a wall and a mesh.
  std::function<std::vector<std::pair<double, double>>(Index rings)> outline = {};

  std::shared_ptr<const ToolMesh> mesh = {};       ///< of a tool that was drawn
  std::shared_ptr<const DistanceGrid> field = {};  ///< of a wall, in the frame of the body
};

/// Sphere of a radius [m].
ToolShape sphere_shape(double radius);
/// Rod of a radius and a length [m] of at least two radii, with both ends round.
ToolShape capsule_shape(double radius, double length);
/// Flat-ended cylinder without an upper end; its edge has the radius `edge` [m], above 0 and at most
/// `radius`.
ToolShape punch_shape(double radius, double edge);
/// Cone of an angle [rad] between its axis and its flank, below a right angle, with a spherical tip of a
/// radius [m] that is tangent to the flank. It ends at a shaft of `radius` [m], which has no upper end.
ToolShape cone_shape(double angle, double tip, double radius);
/// Tool of a mesh, half of whose width is the radius.
ToolShape drawn_shape(std::shared_ptr<const ToolMesh> mesh);

/// Length [m] for the tolerances of a wall, which has no size.
inline constexpr double size_of_wall = 5e-3;
/// Wall of all that is behind the plane through the tip, across the axis.
ToolShape plane_shape(double size = size_of_wall);
/// Wall of a distance field with its origin at the tip.
ToolShape field_shape(std::shared_ptr<const DistanceGrid> field, double size = size_of_wall);

ToolDistance distance_to_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x);

/// Height of the tool's lower surface above its tip, `r` [m] from its axis [m]; for a drawn tool the least in
/// any direction; infinite beyond the tool's radius.
double height_of_tool(const ToolShape& shape, double r);
/// Height of the lower surface straight above a place x.
double height_of_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x);

/// A place at least `deep` [m] inside of both tools, by alternating projections; nothing if there is none. It
/// may be missed in drawn tools with hollows; a shaft without an end counts for four radii.
///
/// Source:   Bauschke and Borwein, SIAM Review 38 (1996) 367 (projections onto convex sets).
std::optional<Vec3> place_in_both(const ToolShape& one, const ToolPose& at_one, const ToolShape& other,
                                  const ToolPose& at_other, double deep);

/// Radius [m] of the contact with a half-space, linear elastic and without friction, at a depth [m] (Sneddon
/// 1965); for a capsule that of its end; at most nearly the tool's own. For a drawn tool: the radius at which
/// its lower surface is at half the depth, as for a paraboloid.
double contact_radius(const ToolShape& shape, double depth);

/// Force of a tool pressed by `depth` [m] into that half-space, over E / (1 - nu^2) [m^2]. A punch's edge
/// counts as a parabola, and contact ends at its side. Nothing for a drawn tool.
std::optional<double> half_space_force(const ToolShape& shape, double depth);
/// Work of that force from first contact on, over depth x force at its end: 2/5 for a sphere, 1/2 for a flat
/// end or a drawn tool.
double fraction_of_first_work(const ToolShape& shape, double depth);

}  // namespace dimple
