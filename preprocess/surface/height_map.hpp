#pragma once

#include <Eigen/Core>

#include "preprocess/surface/body_surface.hpp"

namespace dimple {

/// Moments of the enclosed volume about its centroid, per volume.
struct Moments {
  Mat3 second;  ///< mean of x x^T [mm^2]
  Vec3 third;   ///< mean of |x|^2 x [mm^3]: towards the pointed end
  double size;  ///< root of the mean of |x|^2 [mm]
};
Moments moments_of(const BodySurface& body);

/// A surface in projection along `approach`, the approach direction: u and v across it, w the height against
/// it.
///
/// `u` is the body's longest direction across `approach`, so that samples turn with the body.
struct View {
  View(const BodySurface& body, const Moments& moments, const Vec3& approach);
  const BodySurface* body;
  Vec3 approach, u, v;
  Points place;               ///< [3xV] the vertices as (u, v, w) [mm]
  Eigen::Vector2d low, high;  ///< of its outline
  Eigen::Matrix4Xd block;     ///< [4xB] of each `in_block` triangles in turn: least u and v, greatest u and v
  static constexpr Index in_block = 64;
  Eigen::Vector2d flat(const Vec3& x) const { return {x.dot(u), x.dot(v)}; }
  Vec3 at(const Eigen::Vector2d& p, double w) const { return p.x() * u + p.y() * v - w * approach; }
};

/// First surface met along the approach direction, on a square lattice of places.
struct HeightMap {
  Eigen::Vector2d corner;     ///< of the place (0, 0) [mm]
  double step = 1.0;          ///< [mm]
  Eigen::ArrayXXd height;     ///< w of the surface that is met first [mm]; not a number: none is met
  Eigen::ArrayXXd thickness;  ///< of the tissue beneath it, to the first exit of the line [mm]
  Eigen::Vector2d place(Index i, Index j) const {
    return corner + step * Eigen::Vector2d(static_cast<double>(i), static_cast<double>(j));
  }
  /// Height between four places; not a number where one of them misses the body, or outside of the map.
  double between(const Eigen::Vector2d& p) const;
  /// Area of the outline [mm^2].
  double outline() const { return step * step * static_cast<double>(height.isFinite().count()); }
};

/// The map of `rows` x `columns` places from `corner` on. Visits the triangles of the blocks that it meets,
/// and each place in them, once.
HeightMap height_map(const View& view, const Eigen::Vector2d& corner, double step, Index rows, Index columns);
/// The map of the whole outline.
HeightMap height_map(const View& view, double step);

}  // namespace dimple
