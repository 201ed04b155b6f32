#pragma once

#include <optional>
#include <span>
#include <vector>

#include "io/volume_image.hpp"
#include "preprocess/model.hpp"
#include "preprocess/supports/support.hpp"
#include "preprocess/surface/surface_cells.hpp"

namespace dimple {

/// Report on the inverse map, in numbers of voxels.
struct InverseMapReport {
  Index moved = 0;                ///< that show displaced tissue
  Index solved = 0;               ///< of them those in or at the body: the field itself was solved for them
  Index unsettled = 0;            ///< of those, not converged: the best place remains
  Index folded = 0;               ///< covered by inverted tissue only
  double largest_residual = 0.0;  ///< of all those |X + u(X) - x| [voxels]
  void add(const InverseMapReport& other);
};

/// A displacement field u on the voxels of an image, X -> X + u(X), and its inverse: the place at rest X with
/// X + u(X) = x of the tissue that voxel x shows afterwards.
///
/// 1. Inside the model's surface u is the MLS field itself. The first lattice point outside continues it by
///    its gradient, so that u is continuous at the surface.
/// 2. Within three times the largest displacement u continues smoothly (nearly harmonic) and falls to zero,
///    and is zero beyond. So surroundings follow the body in pictures; this is no mechanics.
/// 3. Inverse: a lattice along the image's axes, of at most most_lattice points and no finer than the voxels,
///    divided into tetrahedra. Voxels in a displaced tetrahedron get their places at rest from it: continuous
///    and complete.
/// 4. In cells at the body, Newton's method follows from there on the field itself, first with the
///    tetrahedron's gradient, then with the field's. At most 16 steps, to 1/1000 voxel.
/// 5. Without convergence within two cells of the start, the best place remains.
/// 6. Of several pieces of tissue at one voxel, one that is not inverted wins, then the first along the axes.
class DeformationMap {
 public:
  /// `u`: [3xN] at the nodes [m]. `model`, `field` and `u` must outlive this. All members throw Stopped.
  DeformationMap(const Model& model, const FieldAnywhere& field, const Points& u, const VoxelGrid& grid);

  /// Displacement of each voxel of slice k [3 x slice, mm LPS]; and the determinant of the deformation
  /// gradient [slice], 0 outside of the body, unless `jacobian` is empty.
  void displacement(Index k, std::span<float> u_mm, std::span<float> jacobian) const;
  /// Flags of the voxels whose centre is in the body at rest.
  void inside(Index k, std::span<char> is_inside) const;
  /// Places at rest [3 x voxels] of the voxels of slices [first, last), in voxels along the axes.
  InverseMapReport reference_places(Index first, Index last, std::span<float> place) const;

  /// Is a place [voxels] within two voxels of the surface inside? Nothing: it is farther, or on the surface.
  std::optional<bool> inside_near_surface(const Vec3& place) const;

  /// Fraction of the deformed surface's vertices beyond the image.
  double fraction_beyond() const { return fraction_beyond_; }
  static constexpr Index most_lattice = 4'000'000;

 private:
  struct Cell;
  struct Owners;
  struct Seeker;
  Index point_number(Index a, Index b, Index c) const { return a + n_[0] * (b + n_[1] * c); }
  bool has_lattice() const { return n_[0] > 0; }
  void rows_inside(double j, double k, std::vector<double>& crossings) const;
  void sample_body();
  bool continue_from_inside(const std::array<Index, 3>& at, double largest_mm, Vec3& v) const;
  void continue_outside();
  void bound_rows();
  Vec3 on_lattice(const Vec3& place) const;
  Points displaced(const Points& places) const;
  bool moves_to(const std::array<Index, 3>& cell, double level) const;
  bool at_body(Index a, Index b, Index c) const;
  void cover(const Cell& cell, std::int32_t number, bool order_is_even, Index k, Owners& owners) const;
  Owners owners_in_slice(Index k) const;
  void solve(std::vector<Seeker>& group, InverseMapReport& report) const;
  InverseMapReport reference_slice(Index k, std::span<float> place) const;

  const Model& model_;
  const FieldAnywhere& field_;
  const Points& u_;
  VoxelGrid grid_;
  Eigen::Affine3d to_voxels_;
  SurfaceCells surface_;  // in voxels
  double fraction_beyond_ = 0.0;

  std::array<Index, 3> n_{}, first_{}, step_{};  // of the lattice; where it begins and its steps [voxels]
  std::array<std::array<bool, 2>, 3> cut_{};     // ends where the image ends: not zero there
  std::vector<float> v_;                         // [3 x points] displacement [voxels]
  std::vector<char> inside_;                     // [points]
  std::vector<std::array<float, 2>> reach_;      // of each row of cells: the range of slices that it reaches
};

}  // namespace dimple
