#pragma once

#include "preprocess/supports/fold_banks.hpp"
#include "solver/terms/contact_term.hpp"
#include "solver/terms/internal_force.hpp"

namespace dimple {

/// Folds that close: the two banks of a gap touch without friction and do not pass through each other. The
/// gap of a sample is its height above the plane of the bank ahead, which moves and turns with the tissue
/// there,
///
///     d_s = n_s . (x_s - y_s),   n_s along cof(F) N,   x = X + u at the sample, y = Y + u at the place
///     ahead,
///
/// and its force pushes both banks, in opposite directions and along one line: at the sample, and at the foot
/// of its gap, which is sought anew at each accepted state. Of a bank that bulges the part of the sample
/// stands for it that is nearest to the bank ahead, chosen at each accepted state. The place ahead is the one
/// at rest until the sample has slid half a spacing of the nodes along the bank; then it is that of the
/// nearest sample of the bank, at each accepted state anew. What has slid beyond the bank's samples touches
/// nothing.
class FoldContact : public ContactTerm {
 public:
  /// `tissue` is asked for the gradients that turn the banks.
  FoldContact(std::shared_ptr<const FoldBanks> banks, const ForceSystem& tissue);

  Index count() const override { return banks_->count(); }
  const Interpolation& moves() const override { return moves_; }
  const FoldBanks& banks() const { return *banks_; }
  int pairing() const override { return pairing_; }
  double error_at(Index s, const Instant&) const override { return wall_error * banks_->spacing[s]; }

  bool is_load() const override { return false; }
  void add_force(const Nodal& u, const Instant& now, Nodal& f) override;
  void accept(const Nodal& u, const Instant& now) override;
  std::vector<double> past() const override;
  void restore_past(const std::vector<double>& past) override;

  /// At the last add_force(): how deep a bank lies in the other at most, at the samples [m]; how far one has
  /// slid along the other since rest where they touch [m]; the area of that at rest, half of both banks'
  /// [m^2]; and the sum of the forces [N].
  struct Audit {
    double penetration = 0.0, slid = 0.0, area = 0.0, force = 0.0;
    Index touching = 0;
  };
  Audit audit() const;

 private:
  // Shape functions' gradients at points that turn a bank.
  struct Turning {
    CompressedRows rows;
    Points dphi;  // [3 x rows.member] 1/m
  };
  static constexpr int at_rest = -1, beyond = -2;  // of ahead_

  std::shared_ptr<const FoldBanks> banks_;
  // The bank ahead of a sample: a place of it at rest, its normal there, and what turns it.
  struct Bank {
    Vec3 place, normal;
    const Turning& by;
    Index turns;  // its row there
  };
  Interpolation moves_;  // at the sample, less those at the foot of its gap
  Turning of_opposite_, of_own_;
  std::vector<int> ahead_;  // [M] the sample that lies ahead now, or one of the two words above
  std::vector<Index> row_;  // [M] of the sample in `banks_`, or of the part that stands for it
  Points foot_;             // [3xM] m, along the bank at rest: from the place ahead to the foot of the gap
  int pairing_ = 1;
  Eigen::VectorXd way_;  // [M] of the sample along the bank ahead since rest [m]

  static Mat3 gradient(const Turning& by, Index s, const Nodal& u);
  Bank bank_of(Index s) const;
  Points feet(const Nodal& u) const;
  Vec3 moved(Index s, const Nodal& u) const;
  static Turning turning(const std::vector<Index>& point, const ForceSystem& tissue);
  static Vec3 turned(const Turning& by, Index s, const Nodal& u, const Vec3& normal);
  double gap_of(Index row, Index s, const Nodal& u) const;
  Index nearest_row(Index s, const Nodal& u) const;
  int find_ahead(Index s, const Points& place, const Points& normal) const;
  void pair_up();
};

}  // namespace dimple
