#pragma once

#include <vector>

#include "apps/run/simulate.hpp"

namespace dimple {

// Error of the force by the image's resolution, from the results of a run: its force curve, the surface under
// the tool, and the voxels. Nothing is solved again.

/// The voxels and the body under the tool.
struct UnderTool {
  double voxel = 0.0;          ///< edge along the press direction [m]; 0: there is no image
  double thickness = 0.0;      ///< of the body along the press direction [m]; 0: not known
  double contact = 0.0;        ///< radius of the contact at the last depth [m]
  bool has_contact = false;    ///< a contacting tool; false: the bonded patch
  double curvature = 0.0;      ///< of the body at the contact [1/m]; 0: it is flat or hollow
  double roughness = 0.0;      ///< root mean square distance of the surface from a quadric there [m]
  bool is_free_below = false;  ///< the body is not on its base where the press direction leaves it
};

/// Error of the surface's height within the contact, relative to the place of first contact [m]. A shift of
/// the whole surface moves that place too, from which the depth counts. Flat faces and wide domes keep their
/// shape on any grid. A ridge two voxels wide does not, and bumps differ from grid to grid.
///
///     voxel min(most_shape_voxels, sqrt((shape_voxels (voxel curvature)^2)^2 + (bumps roughness / voxel)^2))
double shape_error(const UnderTool& under);
extern const double shape_voxels, bumps, most_shape_voxels;

/// Error of the thickness, in voxels. Faces parallel to the grid are within half a voxel each.
extern const double thickness_voxels;
/// Least exponent of the thickness for a part that is free below and bends. A plate has 3, and about half of
/// the tool's depth bends the part.
extern const double exponent_of_bending;

/// Relative decrease of the force over the relative change of a layer's thickness, -d ln F / d ln H. The
/// contact has radius a; the incompressible layer of thickness H is bonded to its base; x = a / H. From
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
/// The shape error of the bonded patch is 0: its nodes are bonded wherever the surface is. The constants are
/// from forces on moved grids: tests/verification/image_error.py.
ImageError image_error(const std::vector<ForceSample>& force, const UnderTool& under);

/// Sets the curvature and roughness of a body under a tool. They are from the area in which the tool, moved
/// by `depth` [m] from first contact, overlaps the surface at rest. With r^2 = area / pi the tool's surface
/// is height(r) above its tip. The body's surface is below its top by the rest of the depth: curvature r^2 /
/// 2 = depth - height(r).
void look_under(const RigidBody& indenter, const Surface& surface, const Vec3& approach, double depth,
                UnderTool& under);

/// Estimate for a run that has ended.
ImageError image_error_of(const Scene& scene, const Result& result);

}  // namespace dimple
