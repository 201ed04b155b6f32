#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <string>
#include <vector>

#include "io/label_image.hpp"
#include "io/types.hpp"

namespace dimple {

/// The closed surface of one body: what decides inside and outside, and how far away. Lengths in mm.
///
/// Coordinates are the body's own frame: the image's axes, with the origin at its first voxel. `to_world` is
/// the rigid motion to LPS. Everything that is built on the surface therefore comes out the same, bit for
/// bit, however the image was stored, and moves with the body when the body is turned.
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
  const Eigen::Isometry3d& to_world() const { return to_world_; }
  double volume() const { return volume_; }             ///< mm^3
  double area() const { return triangle_area_.sum(); }  ///< mm^2
  const Vec3& lower() const { return lower_; }          ///< corners of its box
  const Vec3& upper() const { return upper_; }
  Vec3 centroid() const { return centroid_; }  ///< of the enclosed volume

  bool contains(const Vec3& x) const;

  struct Closest {
    Vec3 place;
    Index triangle;
    double distance;
  };
  Closest closest(const Vec3& x) const;
  /// closest(x).distance > distance, which is cheaper to say.
  bool farther(const Vec3& x, double distance) const;

  /// Where the line origin + t direction passes through the surface: ascending t, always an even number of
  /// them.
  std::vector<double> crossings(const Vec3& origin, const Vec3& direction) const;
  /// The same along an axis, cut to the part from origin to origin + length: pairs between which it is
  /// inside.
  std::vector<double> chord(const Vec3& origin, int axis, double length) const;

 private:
  struct Tree;
  Points vertex_;
  Triangles triangles_;
  Points normal_;
  Eigen::VectorXd triangle_area_;
  Eigen::Isometry3d to_world_;
  double volume_ = 0.0;
  Vec3 centroid_ = Vec3::Zero(), lower_, upper_;
  std::unique_ptr<Tree> tree_;
};

/// What was taken from the image, and what was not.
struct SegmentReport {
  std::vector<int> labels;          ///< taken
  double label_volume_mm3 = 0.0;    ///< of all voxels with these labels
  int pieces = 0;                   ///< face-connected; only the largest is kept
  double dropped_volume_mm3 = 0.0;  ///< of the others
  int cavities_filled = 0;          ///< holes too small for the cloud to resolve
  double filled_volume_mm3 = 0.0;
  double voxel_volume_mm3 = 0.0;  ///< of what is kept and filled: the surface encloses the same
  bool cut_by_border = false;     ///< the organ goes on outside the image
  double smoothing_mm = 0.0;      ///< standard deviation of the Gaussian along the coarsest voxel axis
  std::vector<std::string> warnings;
};

/// A smooth surface around the voxels with the given labels (none: all foreground), not the voxel staircase.
///
/// The indicator (1 inside, 0 outside), smoothed by a Gaussian of 0.7 voxel, is contoured half-way; the
/// vertices are relaxed by at most half a voxel, so that no terraces stay, and the surface is moved evenly
/// until it encloses the voxels' volume within 0.1 %. Detail finer than a quarter of `node_spacing_mm`, which
/// no cloud of that spacing can follow, is not drawn. Throws InputError (a label that is not there),
/// ModelError (too few voxels for a body).
struct SegmentedBody {
  BodySurface surface;
  SegmentReport report;
};
SegmentedBody make_body_surface(const LabelImage& image, const std::vector<int>& labels,
                                double node_spacing_mm);

/// Volume of the largest piece of the chosen labels [mm^3]: what a node count is turned into a spacing with.
double largest_piece_volume(const LabelImage& image, const std::vector<int>& labels);

}  // namespace dimple
