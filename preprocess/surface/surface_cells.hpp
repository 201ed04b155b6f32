#pragma once

#include <cmath>
#include <functional>
#include <optional>
#include <vector>

#include "io/types.hpp"
#include "preprocess/surface/box_tree.hpp"

namespace dimple {

/// Squared distance of p from a triangle.
double distance2_to_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c);

/// The triangles of a closed surface sorted into cubic cells. Answers in plain floating point where rounding
/// leaves no doubt, and reports where it does: only there an exact answer is necessary.
class SurfaceCells {
 public:
  SurfaceCells(const Points& vertex, const Triangles& triangles);

  /// Finds the side of each cell without a triangle. `is_inside` is called at most once for each connected
  /// group of them, where lines along all axes meet edges.
  void mark_clear_cells(const std::function<bool(const Vec3&)>& is_inside);

  /// Is x inside? Nothing: too near to the surface, or to a triangle's edge on the line, to decide.
  std::optional<bool> contains(const Vec3& x) const;

  /// Triangles that may be the nearest to x within rounding, usually one. Returns their distance.
  double nearest(const Vec3& x, std::vector<Index>& candidates) const;

  /// Is every triangle farther from x than d? Nothing: rounding decides.
  std::optional<bool> farther(const Vec3& x, double d) const;

  struct Hit {
    Index triangle;
    double at;  ///< coordinate along the axis
  };
  /// Triangles that the line through x along an axis meets between two coordinates, unordered; false if an
  /// edge is met, or nearly.
  bool line(const Vec3& x, int axis, double from, double to, std::vector<Hit>& hits) const;

  struct Crossing {
    Index triangle;
    double t;    ///< place: from + t (to - from)
    bool leave;  ///< outwards through the triangle, otherwise inwards
  };
  /// Triangles that the straight segment between two places passes through, in order. At an edge or a corner:
  /// one or several of those that meet there. `to_first_entry`: those behind the first entry may be left out.
  void pass(const Vec3& from, const Vec3& to, std::vector<Crossing>& crossings,
            bool to_first_entry = false) const;

  /// Is there a triangle within d of x above whose plane x is by more than `height`?
  bool any_above(const Vec3& x, double d, double height) const;

  /// Height of x above the plane of a triangle, outwards.
  double height(const Vec3& x, Index triangle) const {
    return normal_.col(triangle).dot(x - corner_[static_cast<std::size_t>(triangle)].a);
  }
  const Points& normal() const { return normal_; }  ///< [3xT] outward unit normals

 private:
  struct Corners {
    Vec3 a, b, c;
  };
  using Cell = Eigen::Array3i;
  void sort_into_cells(const Points& vertex, const Triangles& triangles);
  Cell cell_of(const Vec3& x) const;
  std::optional<bool> inside_by_lines(const Vec3& x) const;
  bool in_grid(const Cell& c) const { return (c >= 0).all() && (c < n_).all(); }
  std::size_t number(const Cell& c) const {
    return static_cast<std::size_t>(c[0]) +
           static_cast<std::size_t>(n_[0]) *
               (static_cast<std::size_t>(c[1]) +
                static_cast<std::size_t>(n_[1]) * static_cast<std::size_t>(c[2]));
  }
  double distance_to(const Vec3& x, int triangle) const {
    const Corners& at = corner_[static_cast<std::size_t>(triangle)];
    return std::sqrt(distance2_to_triangle(x, at.a, at.b, at.c));
  }

  enum class Side : char { mixed, inside, outside };
  double edge_ = 1.0, size_ = 1.0;
  Vec3 origin_;
  Cell n_;
  std::vector<int> offset_, member_;  // the triangles whose boxes overlap each cell
  std::vector<unsigned char> clear_;  // least number of cells to the next one with a triangle
  std::vector<Side> side_;
  std::vector<Corners> corner_;
  Points normal_;
  BoxTree boxes_;
};

}  // namespace dimple
