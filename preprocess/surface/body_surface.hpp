#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// The closed surface of one body: decides inside and outside, and measures distances. Lengths in mm.
///
/// Coordinates are the body's own frame: the image's axes in the order and directions of own_order(), with
/// the origin two voxels before the body's own box. `to_world` is the rigid motion to LPS. Everything built
/// on the surface is therefore the same, bit for bit, however the image was stored and cropped. It turns with
/// the body.
class BodySurface {
 public:
  /// Takes a closed, outward-oriented triangle surface. Throws ModelError if it is not closed.
  BodySurface(Points vertex, Triangles triangles,
              const Eigen::Isometry3d& to_world = Eigen::Isometry3d::Identity());
  ~BodySurface();
  BodySurface(BodySurface&&) noexcept;

  const Points& vertex() const { return vertex_; }
  const Triangles& triangles() const { return triangles_; }
  const Points& normal() const { return normal_; }                         ///< [3xT] outward unit normals
  const Eigen::VectorXd& triangle_area() const { return triangle_area_; }  ///< [T] mm^2
  Vec3 middle_of(Index t) const {                                          ///< of a triangle
    return (vertex_.col(triangles_(0, t)) + vertex_.col(triangles_(1, t)) + vertex_.col(triangles_(2, t))) /
           3.0;
  }
  const Eigen::Isometry3d& to_world() const { return to_world_; }
  double volume() const { return volume_; }             ///< mm^3
  double area() const { return triangle_area_.sum(); }  ///< mm^2
  const Vec3& lower() const { return lower_; }          ///< corners of its box
  const Vec3& upper() const { return upper_; }
  Vec3 centroid() const { return centroid_; }  ///< of the enclosed volume

  /// A plane x . out = offset [mm] on which the image ends and cuts the body off, while the organ continues.
  struct ImageEnd {
    Vec3 out;  ///< unit vector out of the image
    double offset, tolerance;
  };
  void ends_with_image(std::vector<ImageEnd> where) { image_end_ = std::move(where); }
  const std::vector<ImageEnd>& image_ends() const { return image_end_; }
  /// True for a place of the surface on an end of the image.
  bool at_image_end(const Vec3& x) const;

  bool contains(const Vec3& x) const;

  struct Closest {
    Vec3 place;
    Index triangle;
    double distance;
  };
  Closest closest(const Vec3& x) const;
  /// closest(x).distance > distance, at lower cost.
  bool farther(const Vec3& x, double distance) const;

  /// Does the straight segment from x to y stay in the body? `spacing`: of the nodes there. As sees() of
  /// sight.hpp.
  bool sees(const Vec3& x, const Vec3& y, double spacing) const;

  /// Does the straight segment from x to y cross the surface?
  bool is_between(const Vec3& x, const Vec3& y) const;

  /// Parameters t of the crossings of origin + t direction with the surface: ascending, an even number.
  std::vector<double> crossings(const Vec3& origin, const Vec3& direction) const;
  /// Crossings along an axis, clipped to the part from origin to origin + length: pairs of entry and exit.
  std::vector<double> chord(const Vec3& origin, int axis, double length) const;

 private:
  struct Tree;
  std::optional<std::pair<double, double>> part_in_box(const Vec3& origin, const Vec3& direction) const;
  Points vertex_;
  Triangles triangles_;
  Points normal_;
  Eigen::VectorXd triangle_area_;
  Eigen::Isometry3d to_world_;
  double volume_ = 0.0;
  Vec3 centroid_ = Vec3::Zero(), lower_, upper_;
  std::vector<ImageEnd> image_end_;
  std::unique_ptr<Tree> tree_;
};

}  // namespace dimple
