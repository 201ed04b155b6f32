#pragma once

#include <Eigen/SparseCholesky>
#include <memory>

#include "solver/system.hpp"

namespace dimple {

/// The patches' pressures in the mixed iteration: the gradient G = dJ/du of the patches' volume ratios, and
/// the inverse of the approximate Schur complement of the pressures,
///
///     S = M / mu + 1 / (bulk V),   M_bc = sum over points q of V_q psi_bq psi_cq / (V_b V_c).
///
/// The patches' mass matrix / mu replaces G' A^-1 G, as one may for Stokes flow. S is symmetric, positive
/// definite and as well conditioned with many rows as with few.
///
/// Source:   Elman, Silvester, Wathen, Finite Elements and Fast Iterative Solvers, 2014, chapter 4.
class PressureSchur {
 public:
  /// `body` must outlive it. G and S are not computed yet.
  explicit PressureSchur(const System& body);

  /// G at the displacements of the body's last force.
  void find_gradient();
  bool has_gradient() const { return gradient_.cols() > 0; }
  /// [patches] G' du for du [4xN] m: the change of each patch's volume ratio.
  Eigen::VectorXd volume_change(const Nodal& du) const;
  /// f += G lambda, f [4xN] N, `lambda` [patches] N m: pressures x volumes.
  void add_forces(const Eigen::VectorXd& lambda, Nodal& f) const;

  /// Makes S for `bulk` [patches] Pa, unless it is the last one's. False: S is not positive definite.
  bool factorise(const Eigen::VectorXd& bulk);
  bool is_factorised() const { return factor_ || matrix_.rows() > 0; }
  /// S^-1 r [patches] N m, r [patches]. Up to MixedConstants::worth_factorising rows by a factor, beyond by
  /// conjugate gradients.
  Eigen::VectorXd apply(const Eigen::VectorXd& r) const;

  /// [patches] 1 / square root of the energy of a unit of lambda, 1 / sqrt(mu V).
  const Eigen::VectorXd& scale() const { return scale_; }

 private:
  using Sparse = Eigen::SparseMatrix<double>;
  using Factor = Eigen::SimplicialLLT<Sparse>;
  static std::shared_ptr<const Factor> factorised(Sparse matrix);
  Sparse lower_half() const;
  template <class Add>
  void visit_column(int c, const Add& add) const;

  const System& body_;
  const Model& model_;
  Eigen::VectorXi slot_;       // where in patches.psi each member of `points_` is
  CompressedRows points_;      // of each patch
  CompressedRows nodes_;       // of each patch
  Eigen::Matrix4Xf gradient_;  // [4 x nodes_.member] G
  Eigen::VectorXd bulk_;       // [patches] Pa, for which S was made
  Eigen::VectorXd scale_;
  std::shared_ptr<const Factor> factor_;
  Sparse matrix_;  // lower half of S, without a factor
};

}  // namespace dimple
