#pragma once

#include "preprocess/surface/body_surface.hpp"

namespace dimple {

// Bodies whose surface is known exactly, without the voxels of an image between them and their geometry: what
// the scheme is compared with other solutions on. Lengths in mm, z upwards.

/// A box between two corners; twelve triangles.
BodySurface block_surface(const Vec3& lower, const Vec3& upper);

/// A block of the given size on z = 0, centred at x = y = 0, with a slit `width` wide and `depth` deep from
/// the top all along y, whose nearer wall lies at x = `wall`.
BodySurface slit_block_surface(const Vec3& size, double wall, double width, double depth);

/// A cylinder about the z axis, standing on z = 0: a prism of `sides` sides whose edges lie on the cylinder;
/// its volume is too small by (2 pi / sides)^2 / 6.
BodySurface cylinder_surface(double radius, double height, int sides = 360);

/// An ellipsoid about the origin with the given half axes, cut flat at z = `cut`, of which the upper part is
/// kept. All vertices lie on the ellipsoid, `sides` around and sides / 2 upwards. Needs: |cut| < half.z().
BodySurface cut_ellipsoid_surface(const Vec3& half, double cut, int sides = 240);

}  // namespace dimple
