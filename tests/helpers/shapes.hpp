#pragma once

#include <array>
#include <cassert>
#include <cmath>
#include <numbers>
#include <vector>

#include "preprocess/surface/body_surface.hpp"

namespace dimple {

// Bodies whose surface is known exactly, not through the voxels of an image: the scheme is compared with
// other solutions on them. Lengths in mm, z upwards.

// Generalised surface of revolution: rings of `sides` vertices from below upwards, and one vertex in the
// middle below the first and above the last.
inline BodySurface of_rings(const std::vector<std::vector<Vec3>>& ring, const Vec3& below,
                            const Vec3& above) {
  const auto sides = static_cast<Index>(ring.front().size()), rings = static_cast<Index>(ring.size());
  Points vertex(3, sides * rings + 2);
  for (Index r = 0; r < rings; ++r)
    for (Index k = 0; k < sides; ++k)
      vertex.col(r * sides + k) = ring[static_cast<std::size_t>(r)][static_cast<std::size_t>(k)];
  const Index bottom = sides * rings, top = bottom + 1;
  vertex.col(bottom) = below;
  vertex.col(top) = above;
  Triangles triangles(3, 2 * sides * rings);
  Index t = 0;
  for (Index k = 0; k < sides; ++k) {
    const Index next = (k + 1) % sides;
    triangles.col(t++) << bottom, next, k;
    for (Index r = 0; r + 1 < rings; ++r) {
      const Index a = r * sides + k, b = r * sides + next, c = a + sides, d = b + sides;
      triangles.col(t++) << a, b, d;
      triangles.col(t++) << a, d, c;
    }
    triangles.col(t++) << top, (rings - 1) * sides + k, (rings - 1) * sides + next;
  }
  return {std::move(vertex), std::move(triangles)};
}

inline std::vector<Vec3> ring_of(double rx, double ry, double z, int sides) {
  std::vector<Vec3> result;
  for (int k = 0; k < sides; ++k) {
    const double angle = 2.0 * std::numbers::pi * k / sides;
    result.emplace_back(rx * std::cos(angle), ry * std::sin(angle), z);
  }
  return result;
}

/// A box between two corners; twelve triangles.
inline BodySurface block_surface(const Vec3& lower, const Vec3& upper) {
  Points vertex(3, 8);
  for (int corner = 0; corner < 8; ++corner)
    vertex.col(corner) << (corner & 1 ? upper : lower).x(), (corner & 2 ? upper : lower).y(),
        (corner & 4 ? upper : lower).z();
  Triangles triangles(3, 12);
  triangles.transpose() << 0, 2, 3, 0, 3, 1,  // below
      4, 5, 7, 4, 7, 6,                       // above
      0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3,     // small y, large y
      0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5;     // small x, large x
  return {std::move(vertex), std::move(triangles)};
}

/// A block of the given size on z = 0, centred at x = y = 0. A slit `width` wide and `depth` deep goes from
/// the top all along y; its nearer wall is at x = `wall`.
inline BodySurface slit_block_surface(const Vec3& size, double wall, double width, double depth) {
  // Boxes, three by one by two, without the one in the middle above.
  const std::array<double, 4> x = {-0.5 * size.x(), wall, wall + width, 0.5 * size.x()};
  const std::array<double, 3> z = {0.0, size.z() - depth, size.z()};
  const auto number = [](int i, int j, int k) { return static_cast<Index>(i + 4 * (j + 2 * k)); };
  Points vertex(3, 24);
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < 2; ++j)
      for (int i = 0; i < 4; ++i)
        vertex.col(number(i, j, k)) << x[static_cast<std::size_t>(i)], (j - 0.5) * size.y(),
            z[static_cast<std::size_t>(k)];
  const auto filled = [](int i, int k) { return i >= 0 && i < 3 && k >= 0 && k < 2 && !(i == 1 && k == 1); };
  std::vector<std::array<Index, 3>> triangle;
  const auto add = [&](Index a, Index b, Index c, Index d) {
    triangle.push_back({a, b, c});
    triangle.push_back({a, c, d});
  };
  for (int k = 0; k < 2; ++k)
    for (int i = 0; i < 3; ++i) {
      if (!filled(i, k)) continue;
      add(number(i, 0, k), number(i + 1, 0, k), number(i + 1, 0, k + 1), number(i, 0, k + 1));
      add(number(i, 1, k), number(i, 1, k + 1), number(i + 1, 1, k + 1), number(i + 1, 1, k));
      if (!filled(i - 1, k)) add(number(i, 0, k), number(i, 0, k + 1), number(i, 1, k + 1), number(i, 1, k));
      if (!filled(i + 1, k))
        add(number(i + 1, 0, k), number(i + 1, 1, k), number(i + 1, 1, k + 1), number(i + 1, 0, k + 1));
      if (!filled(i, k - 1)) add(number(i, 0, k), number(i, 1, k), number(i + 1, 1, k), number(i + 1, 0, k));
      if (!filled(i, k + 1))
        add(number(i, 0, k + 1), number(i + 1, 0, k + 1), number(i + 1, 1, k + 1), number(i, 1, k + 1));
    }
  Triangles triangles(3, static_cast<Index>(triangle.size()));
  for (std::size_t t = 0; t < triangle.size(); ++t)
    triangles.col(static_cast<Index>(t)) << triangle[t][0], triangle[t][1], triangle[t][2];
  return {std::move(vertex), std::move(triangles)};
}

/// A cylinder about the z axis, standing on z = 0: a prism of `sides` sides with its edges on the cylinder;
/// its volume is too small by (2 pi / sides)^2 / 6.
inline BodySurface cylinder_surface(double radius, double height, int sides = 360) {
  return of_rings({ring_of(radius, radius, 0.0, sides), ring_of(radius, radius, height, sides)}, Vec3::Zero(),
                  Vec3(0.0, 0.0, height));
}

/// Upper part of an ellipsoid about the origin with the given half axes, cut flat at z = `cut`. All vertices
/// are on the ellipsoid, `sides` around and sides / 2 upwards. Needs: |cut| < half.z().
inline BodySurface cut_ellipsoid_surface(const Vec3& half, double cut, int sides = 240) {
  assert(std::abs(cut) < half.z());
  const double lowest = std::asin(cut / half.z());
  const int rings = sides / 2;
  std::vector<std::vector<Vec3>> ring;
  for (int r = 0; r < rings; ++r) {
    const double latitude = lowest + (0.5 * std::numbers::pi - lowest) * r / rings;
    ring.push_back(ring_of(half.x() * std::cos(latitude), half.y() * std::cos(latitude),
                           r == 0 ? cut : half.z() * std::sin(latitude), sides));
  }
  return of_rings(ring, Vec3(0.0, 0.0, cut), Vec3(0.0, 0.0, half.z()));
}

}  // namespace dimple
