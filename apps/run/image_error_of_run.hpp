#pragma once

#include <vector>

#include "apps/run/simulate.hpp"

namespace dimple {

// The error of the force by the image's resolution, from what a run has found anyway: its force curve, the
// drawn surface under the tool, and the voxels. Nothing is solved again.

/// The voxels and the body under the tool.
struct UnderTool {
  double voxel = 0.0;          ///< edge along the push [m]; 0: there is no image
  double thickness = 0.0;      ///< of the body along the push [m]; 0: not known
  double contact = 0.0;        ///< radius of the contact at the last depth [m]
  bool touches = false;        ///< a contacting tool; false: the bonded circle
  double curvature = 0.0;      ///< of the body where the tool touches it [1/m]; 0: it is flat or hollow
  double roughness = 0.0;      ///< root mean square distance of the drawn surface from a quadric there [m]
  bool is_free_below = false;  ///< the body does not rest on its base where the push leaves it
};

/// How far the height of the drawn surface may differ, within the contact, from that where the tool first
/// touches [m]. A shift of the whole surface moves the first touch too, from which the depth counts. Flat
/// faces and wide domes are drawn with their shape, whatever the grid; a ridge two voxels wide is not, and
/// bumps that are drawn on one grid are not on another.
///
///     voxel min(most_shape_voxels, sqrt((shape_voxels (voxel curvature)^2)^2 + (bumps roughness / voxel)^2))
double shape_error(const UnderTool& under);
extern const double shape_voxels, bumps, most_shape_voxels;

/// So much of a voxel the thickness may be off. Faces parallel to the grid are known to half a voxel each.
extern const double thickness_voxels;
/// At least this exponent of the thickness a part has that is free below and bends. A plate's is 3, and half
/// of the push or so bends the part.
extern const double exponent_of_bending;

/// By which factor of its own relative change a layer's thickness reduces the force, -d ln F / d ln H, of a
/// contact of radius a on an incompressible layer of thickness H that is bonded to its base; x = a / H. From
///
///     F(x) / F(0) = 1 + 1.133 x + 1.283 x^2 + 0.769 x^3 + 0.0975 x^4,
///
/// Dimitriadis et al., Biophys. J. 82 (2002) 2798, with a^2 = R depth.
double thickness_exponent(double contact_per_thickness);

/// half = sqrt(shape^2 + thickness^2), with
///
///     shape     = |F| ((1 + shape_error / depth)^p - 1),  p = d ln F / d ln depth,
///     thickness = |F| thickness_exponent(a / H) thickness_voxels voxel / H.
///
/// Of the bonded circle the shape is 0: its nodes are bonded wherever the surface is. The constants were made
/// from forces on moved grids: tests/verification/image_error.py.
ImageError image_error(const std::vector<ForceSample>& force, const UnderTool& under);

/// Sets the curvature of a body where a tool touches it, and its roughness, from the area in which the tool,
/// moved by `depth` [m] from its first touch, would overlap the surface at rest: with r^2 = area / pi, the
/// tool's surface is height(r) above its tip and the body's as far below its top as is left of the depth,
/// curvature r^2 / 2 = depth - height(r).
void look_under(const Touch& touch, const Surface& surface, const Vec3& push, double depth, UnderTool& under);

/// Of a run that has come to its end.
ImageError image_error_of(const Scene& scene, const Result& result);

}  // namespace dimple
