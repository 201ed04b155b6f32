#pragma once

#include "preprocess/surface/box_tree.hpp"

namespace dimple {

/// A blade's open sheet, without thickness, at rest. Lengths in the unit of its vertices.
class Sheet {
 public:
  Sheet(Points vertex, Triangles triangles);

  /// Does the straight segment from x to y pass through it? A place on the sheet itself, within a billionth
  /// of its size, is on the side of its triangles' normals; where two triangles meet one of them is crossed.
  bool between(const Vec3& x, const Vec3& y) const;
  /// Is some of it within d of x?
  bool reaches(const Vec3& x, double d) const;

  const Points& vertex() const { return vertex_; }
  const Triangles& triangles() const { return triangles_; }

 private:
  bool passes(Index t, const Vec3& x, const Vec3& y) const;

  Points vertex_;
  Triangles triangles_;
  Points normal_;  // [3xT], unit vectors
  double size_ = 0.0;
  Vec3 lower_, upper_;
  Vec3 across_;              // the mean normal
  double lowest_, highest_;  // of all vertices along it
  BoxTree boxes_;
};

}  // namespace dimple
