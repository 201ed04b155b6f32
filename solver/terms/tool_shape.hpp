#pragma once

#include "io/types.hpp"

namespace dimple {

/// A rigid tool: a body of revolution about its own axis, with its tip at the bottom. SI units.
struct ToolShape {
  enum class Kind {
    sphere,  ///< of `radius`
    punch,   ///< a flat-ended cylinder of `radius` whose rim is rounded by `edge`; it has no upper end
    capsule  ///< a rod of `radius` and `length` with both ends round, which stands on one of them
  };
  Kind kind = Kind::sphere;
  double radius = 5e-3;  ///< [m]
  double edge = 0.0;     ///< [m] of a punch: more than 0, at most the radius
  double length = 0.0;   ///< [m] of a capsule, with its ends: at least two radii
};

/// Where it stands: its tip, and the unit vector from its upper end to its tip.
struct ToolPose {
  Vec3 tip = Vec3::Zero();          ///< [m]
  Vec3 points_at = -Vec3::UnitZ();  ///< unit vector
};

/// From the tool's surface to a place, negative inside of the tool [m]; and its gradient, the unit normal of
/// the nearest place of the surface, out of the tool.
struct ToolDistance {
  double distance;
  Vec3 normal;
};
ToolDistance distance_to_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x);

/// How far above its tip the tool's lower surface is, `r` [m] from its axis [m]; infinite beside the tool.
double height_of_tool(const ToolShape& shape, double r);

/// From the tip to the upper end [m]; infinite where there is none.
double length_of_tool(const ToolShape& shape);

/// The radius [m] of the contact with a half-space, linear elastic and without friction, at a depth [m]
/// (Sneddon 1965), of a capsule that of its end; at most nearly the tool's own.
double contact_radius(const ToolShape& shape, double depth);

}  // namespace dimple
