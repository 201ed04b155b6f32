#pragma once

#include <optional>
#include <span>
#include <vector>

#include "io/volume_image.hpp"
#include "preprocess/model.hpp"
#include "preprocess/supports/support.hpp"
#include "preprocess/surface/surface_cells.hpp"

namespace dimple {

/// How the way back was found, in numbers of voxels.
struct WayBackReport {
  Index moved = 0;      ///< that show something which has moved
  Index solved = 0;     ///< of them those in or at the body: the field itself was solved for their place
  Index unsettled = 0;  ///< of those, where this did not succeed: the best place stays
  Index folded = 0;     ///< where only tissue that is turned inside out comes to lie
  double largest_residual = 0.0;  ///< of all those |X + u(X) - x| [voxels]
  void add(const WayBackReport& other);
};

/// A displacement field u on the voxels of an image, both ways: where a voxel of the body at rest goes, X ->
/// X + u(X), and where that which a voxel shows afterwards was at rest, x -> X with X + u(X) = x.
///
/// Inside of the model's surface u is the moving-least-squares field itself. The first point outside goes on
/// from there by its gradient, so that u is continuous at the surface. Around it, within three times
/// the largest displacement, it continues smoothly (nearly harmonic) and falls to zero: a picture's
/// surroundings follow the body's surface there, which is no mechanics. Beyond, it is zero.
///
/// The way back starts from a lattice along the image's axes, of at most most_lattice points, no finer than
/// the voxels. It is divided into tetrahedra, and each carries the voxels that its displaced copy covers to
/// their places at rest: this map is continuous and leaves no voxel out. In cells at the body the field
/// itself is then solved for, from there, by Newton's method with the tetrahedron's gradient and then with
/// its own; at most 16 steps, until X + u(X) lies within a thousandth of a voxel of x. Where it does not
/// settle within two cells of its start, the place that came nearest stays. Of several pieces of tissue that
/// come to lie at one voxel, one that is not inside out wins, then the first along the axes.
class DeformationMap {
 public:
  /// `u`: [3xN] at the nodes [m]. `model`, `field` and `u` must outlive this. Throws Stopped, as all that
  /// follows does.
  DeformationMap(const Model& model, const FieldAnywhere& field, const Points& u, const VoxelGrid& grid);

  /// Of slice k of the image, for which there is room: the displacement of each voxel [3 x slice, mm LPS];
  /// the determinant of the deformation gradient [slice], 0 outside of the body, unless that is empty.
  void displacement(Index k, std::span<float> u_mm, std::span<float> jacobian) const;
  /// Whether each voxel's centre lies in the body at rest.
  void inside(Index k, std::span<char> is_inside) const;
  /// Where what the voxels of slices [first, last) show was at rest [3 x voxels], in voxels along the axes.
  WayBackReport places_at_rest(Index first, Index last, std::span<float> place) const;

  /// Whether a place [voxels] within two voxels of the surface is inside; nothing: it is farther, or on the
  /// surface.
  std::optional<bool> inside_near_surface(const Vec3& place) const;

  /// Share of the deformed surface's vertices that lie beyond the image.
  double share_beyond() const { return share_beyond_; }
  static constexpr Index most_lattice = 4'000'000;

 private:
  struct Cell;
  struct Owners;
  struct Seeker;
  Index point_number(Index a, Index b, Index c) const { return a + n_[0] * (b + n_[1] * c); }
  bool has_lattice() const { return n_[0] > 0; }
  void rows_inside(double j, double k, std::vector<double>& crossings) const;
  void sample_body();
  bool go_on_from_inside(const std::array<Index, 3>& at, double largest_mm, Vec3& v) const;
  void continue_outside();
  void bound_rows();
  Vec3 on_lattice(const Vec3& place) const;
  Points displaced(const Points& places) const;
  bool moves_to(const std::array<Index, 3>& cell, double level) const;
  bool at_body(Index a, Index b, Index c) const;
  void cover(const Cell& cell, std::int32_t number, bool way_is_even, Index k, Owners& owners) const;
  Owners owners_in_slice(Index k) const;
  void solve(std::vector<Seeker>& group, WayBackReport& report) const;
  WayBackReport slice_at_rest(Index k, std::span<float> place) const;

  const Model& model_;
  const FieldAnywhere& field_;
  const Points& u_;
  VoxelGrid grid_;
  Eigen::Affine3d to_voxels_;
  SurfaceCells surface_;  // in voxels
  double share_beyond_ = 0.0;

  std::array<Index, 3> n_{}, first_{}, step_{};  // of the lattice; where it begins and its steps [voxels]
  std::array<std::array<bool, 2>, 3> cut_{};     // ends where the image does: its border is no zero
  std::vector<float> v_;                         // [3 x points] displacement [voxels]
  std::vector<char> inside_;                     // [points]
  std::vector<std::array<float, 2>> reach_;  // of each row of cells: the slices that it comes to lie between
};

}  // namespace dimple
