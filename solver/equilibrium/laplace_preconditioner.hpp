#pragma once

#include <utility>
#include <vector>

#include "solver/equilibrium/multigrid.hpp"
#include "solver/system.hpp"

namespace dimple {

/// Approximate inverse of a scalar matrix over some of the nodes, for four right-hand sides.
struct NodalInverse {
  std::vector<Index> node;  ///< of each row
  Multigrid multigrid;
  Multigrid::Vectors b, x;

  /// z = A^-1 r [4xN] at its nodes, zero elsewhere.
  void solve(const Nodal& r, Nodal& z);
};

/// Preconditioner for the displacements of a body: approximately the inverse of A [N/m], one scalar matrix
/// for all three components,
///
///     v.A v = sum over neighbours a, b of (w_a + w_b) / 2 |v_a - v_b|^2 + bounds of all further force terms.
///
/// The weights w [N/m] give a linear field MixedConstants::laplacian_stiffness times the energy of the shear
/// modulus at rest. Nodes that are held wholly are left out; sets of nodes that slide have an inverse for
/// each direction along which they are held. That is exact where these directions are orthogonal.
///
/// A membrane is stiff within its plane and soft across it, and a scalar matrix has one stiffness for both:
/// with A alone a surface would bend by a thousandth of its true deflection. A second inverse moves the soft
/// part Q of each node, without the terms that resist in some directions alone:
///
///     1/2 (A^-1 + Q A_soft^-1 Q),   Q = (1 + stiffness / diagonal of A_soft)^-1/2,
///
/// where both splittings of a motion, stiff and soft, cost little.
class LaplacePreconditioner {
 public:
  /// `body` must outlive it. A is not factorised yet.
  explicit LaplacePreconditioner(System& body);

  /// Makes the inverses. False: A is not positive definite.
  bool factorise();
  bool is_factorised() const { return !across_.node.empty(); }
  /// Finds Q for the body deformed by u [4xN] m. Needs: factorise() has returned true.
  void find_soft_part(const Nodal& u);
  bool has_soft_part() const { return soft_part_.cols() > 0; }
  /// z = A^-1 r approximately, r [4xN] N, z [4xN] m; symmetric, and zero where nodes are held.
  void apply(const Nodal& r, Nodal& z);

  /// Largest eigenvalue of Q at each node, [N]; empty if no term resists in some directions alone. Contact
  /// presses across a membrane, which hardly resists.
  Eigen::VectorXd softest_part() const;
  /// Applies the inverse to four scalar fields, one a row: mean displacements of nodes in their softest
  /// directions. Sliding sets are not held here. `softest`: from softest_part().
  void apply_to_scalars(const Eigen::VectorXd& softest, const Nodal& r, Nodal& z);

  /// Scales the weights of the next factorise() by the stiffness of the law at u over that at rest.
  void stiffen(const Nodal& u);
  /// Restores the weights at rest; A has to be factorised again.
  void relax();

  /// result = L v [4xN] N, L the Laplacian at rest without further terms.
  void multiply_undeformed(const Nodal& v, Nodal& result) const;
  /// Largest change of the strain between neighbours from `before` to `after` [4xN] m.
  double strain_between(const Nodal& before, const Nodal& after) const;
  /// [N] square roots of stiffnesses; a displacement times this is the square root of an energy.
  const Eigen::VectorXd& scale() const { return scale_; }
  /// [N] N/m, the weights of the next factorise().
  const Eigen::VectorXd& weights() const { return weight_; }

 private:
  const ForceSystem& tissue() const { return body_.tissue().system(); }
  Eigen::VectorXd undeformed_diagonal() const;
  void stiffen_single_nodes();
  Eigen::VectorXd stiffening(const Nodal& u);
  Multigrid::Sparse matrix_over(const std::vector<Index>& node, const StiffnessBound& bound, bool directed);
  bool invert(NodalInverse& inverse, const Eigen::Vector4d* direction, const StiffnessBound& bound,
              bool directed);
  bool invert_all(NodalInverse& across, std::vector<NodalInverse>& along, const StiffnessBound& bound,
                  bool directed);
  void solve_with(NodalInverse& across, std::vector<NodalInverse>& along, const Nodal& r, Nodal& z) const;
  void take_soft_part(Nodal& v) const;

  System& body_;
  const Model& model_;
  std::vector<std::pair<int, int>> edge_;         // neighbours a > b, ascending
  std::vector<Eigen::Vector4d> sliding_;          // directions along which sets that slide across are held
  Eigen::VectorXd undeformed_weight_, weight_;    // [N] N/m
  Eigen::VectorXd scale_;                         // [N]
  NodalInverse across_, soft_across_;             // over the nodes that move in some direction
  std::vector<NodalInverse> along_, soft_along_;  // over those that move along each of `sliding_`
  Eigen::VectorXd soft_diagonal_;                 // [N] N/m of A_soft; empty: A has no directed terms
  NodeStiffness soft_part_;                       // [9xN] Q
};

}  // namespace dimple
