#pragma once

#include "preprocess/supports/fold_faces.hpp"
#include "solver/terms/contact_term.hpp"
#include "solver/terms/internal_force.hpp"

namespace dimple {

/// Self-contact of folds: the opposite surfaces of a gap do not penetrate each other; contact is
/// frictionless. The gap of a sample is its height above the plane of the opposite surface, which moves and
/// turns with the tissue there,
///
///     d_s = n_s . (x_s - y_s),   n_s along cof(F) N,   x = X + u at the sample, y = Y + u opposite,
///
/// and its force acts on both surfaces, in opposite directions along one line: at the sample, and at the foot
/// of its gap, found again at each accepted state. On a curved surface the part nearest to the opposite
/// surface represents the sample. The opposite place is that at rest until the sample has slid by half a node
/// spacing; then it is that of the nearest opposite sample, at each accepted state. Beyond all samples there
/// is no contact.
class FoldContact : public ContactTerm {
 public:
  /// `tissue` gives the gradients that turn the surfaces.
  FoldContact(std::shared_ptr<const FoldFaces> fold_faces, const ForceSystem& tissue);

  Index count() const override { return fold_faces_->count(); }
  const Interpolation& moves() const override { return moves_; }
  const FoldFaces& fold_faces() const { return *fold_faces_; }
  int pairing() const override { return pairing_; }
  double error_at(Index s, const Instant&) const override { return wall_error * fold_faces_->spacing[s]; }

  bool is_load() const override { return false; }
  void add_force(const Nodal& u, const Instant& now, Nodal& f) override;
  void accept(const Nodal& u, const Instant& now) override;
  std::vector<double> past() const override;
  void restore_past(const std::vector<double>& past) override;

  /// At the last add_force(): largest penetration at the samples [m]; largest slip since rest of samples in
  /// contact [m]; contact area at rest, half of that of both surfaces [m^2]; and sum of the forces [N].
  struct Audit {
    double penetration = 0.0, slid = 0.0, area = 0.0, force = 0.0;
    Index in_contact = 0;
  };
  Audit audit() const;

 private:
  // Shape function gradients at points that turn a surface.
  struct Turning {
    CompressedRows rows;
    Points dphi;  // [3 x rows.member] 1/m
  };
  static constexpr int undeformed = -1, beyond = -2;  // of faced_

  std::shared_ptr<const FoldFaces> fold_faces_;
  // Opposite surface of a sample: its place and normal at rest, and the gradients that turn it.
  struct FoldFace {
    Vec3 place, normal;
    const Turning& by;
    Index turns;  // its row there
  };
  Interpolation moves_;  // at the sample, less those at the foot of its gap
  Turning of_opposite_, of_own_;
  std::vector<int> faced_;  // [M] opposite sample, or one of the two values above
  std::vector<Index> row_;  // [M] row in `fold_faces_` of the sample, or of the part that represents it
  Points foot_;             // [3xM] m, along the surface at rest: from the opposite place to the foot
  int pairing_ = 1;
  Eigen::VectorXd travel_;  // [M] slip along the opposite surface since rest [m]

  static Mat3 gradient(const Turning& by, Index s, const Nodal& u);
  FoldFace fold_face_of(Index s) const;
  Points feet(const Nodal& u) const;
  Vec3 moved(Index s, const Nodal& u) const;
  static Turning turning(const std::vector<Index>& point, const ForceSystem& tissue);
  static Vec3 turned(const Turning& by, Index s, const Nodal& u, const Vec3& normal);
  double gap_of(Index row, Index s, const Nodal& u) const;
  Index nearest_row(Index s, const Nodal& u) const;
  int find_faced(Index s, const Points& place, const Points& normal) const;
  void pair_up();
};

}  // namespace dimple
