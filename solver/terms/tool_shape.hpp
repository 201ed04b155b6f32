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

/// Where it stands: its tip, and the unit vector from its upper end to its tip, as they are now.
struct ToolPose {
  Vec3 tip = Vec3::Zero();          ///< [m]
  Vec3 points_at = -Vec3::UnitZ();  ///< unit vector
  /// [3x3] from the frame of a tool that was drawn: its z axis away from points_at, its x axis as nearly
  /// along x (LPS: to the left) as it can be, along y where points_at is that. Of a tool that has turned:
  /// those of where it began, turned with it.
  Mat3 axes() const;
  std::optional<Mat3> turned_axes = {};
};

/// From the tool's surface to a place, negative inside of the tool [m]; and its gradient, the unit normal of
/// the nearest place of the surface, out of the tool.
struct ToolDistance {
  double distance;
  Vec3 normal;
};

/// Distance [m] in the half-plane through the axis of a body of revolution, and its derivatives by the radius
/// and by the height above the tip.
struct ProfileDistance {
  double distance, by_r, by_z;
};

/// Rigid tool with its tip at the bottom, or wall, as functions. SI units. It is made by one of the functions
/// below, and made again from its kind and numbers.
struct ToolShape {
  std::string kind = {};             ///< name of the maker: "sphere"
  std::vector<double> numbers = {};  ///< arguments of the maker [m], an angle [rad]
  double radius = 0.0;               ///< half of its width [m]; of a wall a length for its tolerances
  double edge = 0.0;                 ///< radius to which the rim of a flat end is rounded [m]; 0: no flat end
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
  /// Outline for a picture, with so many rings for a quarter of a circle: their radii and heights above the
  /// tip [m], the last the middle of the upper end. Empty for a wall and a mesh.
  std::function<std::vector<std::pair<double, double>>(Index rings)> outline = {};

  std::shared_ptr<const ToolMesh> mesh = {};       ///< of a tool that was drawn
  std::shared_ptr<const DistanceGrid> field = {};  ///< of a wall, in the frame of the body
};

/// Sphere of a radius [m].
ToolShape sphere_shape(double radius);
/// Rod of a radius and a length [m] of at least two radii, with both ends round.
ToolShape capsule_shape(double radius, double length);
/// Flat-ended cylinder without an upper end, whose rim is rounded by `edge` [m], above 0 and at most
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
/// Wall of a distance field, whose origin is where the tip is.
ToolShape field_shape(std::shared_ptr<const DistanceGrid> field, double size = size_of_wall);

ToolDistance distance_to_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x);

/// How far above its tip the tool's lower surface is, `r` [m] from its axis [m], of a tool that was drawn at
/// the least in any direction; infinite beside the tool.
double height_of_tool(const ToolShape& shape, double r);
/// The same straight above a place.
double height_of_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x);

/// A place at least `deep` [m] inside of both tools, by projections onto the one and the other in turn;
/// nothing where there is none. In tools that were drawn and have hollows it may be missed; of a
/// shaft without an end no more than four radii count.
///
/// Source:   Bauschke and Borwein, SIAM Review 38 (1996) 367 (projections onto convex sets).
std::optional<Vec3> place_in_both(const ToolShape& one, const ToolPose& at_one, const ToolShape& other,
                                  const ToolPose& at_other, double deep);

/// The radius [m] of the contact with a half-space, linear elastic and without friction, at a depth [m]
/// (Sneddon 1965), of a capsule that of its end; at most nearly the tool's own. Of a tool that was drawn: to
/// where its lower surface is half of the depth above its tip, as it is of a paraboloid.
double contact_radius(const ToolShape& shape, double depth);

/// The force with which a tool is pressed by `depth` [m] into that half-space, over E / (1 - nu^2) [m^2]. A
/// punch's edge is taken for a parabola, and contact ends at its side. Nothing of a tool that was drawn.
std::optional<double> half_space_force(const ToolShape& shape, double depth);
/// The work of that force from the first touch on, over depth x force at its end: 2/5 of a sphere, 1/2 of
/// what is flat, and of a tool that was drawn.
double share_of_first_work(const ToolShape& shape, double depth);

}  // namespace dimple
