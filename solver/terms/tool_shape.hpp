#pragma once

#include <memory>
#include <optional>

#include "io/types.hpp"
#include "preprocess/scene/tool_mesh.hpp"

namespace dimple {

/// A rigid tool with its tip at the bottom: a body of revolution about its own axis, or as it was drawn. SI
/// units.
struct ToolShape {
  enum class Kind {
    sphere,   ///< of `radius`
    punch,    ///< a flat-ended cylinder of `radius` whose rim is rounded by `edge`; it has no upper end
    capsule,  ///< a rod of `radius` and `length` with both ends round, which stands on one of them
    drawn,    ///< `mesh`, `radius` half its width
    plane,    ///< all that is behind the plane through the tip, across the axis
    field     ///< `field`, whose origin is where the tip is
  };
  Kind kind = Kind::sphere;
  double radius = 5e-3;                            ///< [m]
  double edge = 0.0;                               ///< [m] of a punch: more than 0, at most the radius
  double length = 0.0;                             ///< [m] of a capsule, with its ends: at least two radii
  std::shared_ptr<const ToolMesh> mesh = nullptr;  ///< of a tool that was drawn
  std::shared_ptr<const DistanceGrid> field = nullptr;  ///< of a wall, in the body's own frame
};

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
ToolDistance distance_to_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x);

/// How far above its tip the tool's lower surface is, `r` [m] from its axis [m], of a tool that was drawn at
/// the least in any direction; infinite beside the tool.
double height_of_tool(const ToolShape& shape, double r);
/// The same straight above a place.
double height_of_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x);

/// From the tip to the upper end [m]; infinite where there is none.
double length_of_tool(const ToolShape& shape);

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
