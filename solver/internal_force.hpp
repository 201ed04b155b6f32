#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "preprocess/model.hpp"
#include "solver/projected_kernel.hpp"

namespace dimple {

/// Width of the numbers in the hot loop of the converging scheme. Displacements, forces and sums outside it
/// are double.
enum class Precision { single_, double_ };

/// The internal force of a model: of the converging scheme where the model has pressure patches (see
/// ProjectedKernel), of the paper's where it has not. The paper's is below.
///
/// Letters: the paper writes X for the deformation gradient and F for the force vector; here, as usual today,
/// the gradient is F and the force f.
///
///     sweep 1, points:  F_q = I + sum_a u_a (x) dphi_qa,   P_q = F_q S_q,   V_q P_q dphi_qa to each block's
///     own sums sweep 2, nodes:   f_a = sum of what the blocks have for it
///
/// which is the paper's f = integral of B_L^T S (section 2.2) without the 6 x 3n matrix: a test compares the
/// two. Blocks are fixed and sums have one order: the result is the same, bit for bit, for any number of
/// threads.
///
/// Layout: every (point, node) pair is one record {dphi_x, dphi_y, dphi_z, number within its block}; nodal
/// vectors and the columns of V P are padded to four numbers, so that each is one vector register. Nothing is
/// allocated after construction.
class ForceSystem {
 public:
  /// One tissue.
  ForceSystem(const Model& model, const Material& material, Precision precision = Precision::double_);
  /// Several; the paper's scheme takes the first.
  ForceSystem(const Model& model, const Tissues& tissues, Precision precision = Precision::double_);

  /// A vector per node, padded with a zero: [4xN].
  using Nodal = Eigen::Matrix4Xd;

  /// What a sweep met: the smallest J of all points and where. Not ok if it is not positive, or not a number.
  struct Sweep {
    double J_min = 1.0;
    Index point = -1;
    Index inverted = 0;            ///< points with J <= 0
    bool may_be_inverted = false;  ///< the energy is defined there, and a solver may pass through
    bool ok() const {
      // Not J_min > 0 || (may_be_inverted && J_min <= 0): GCC 12 makes that true for what is no number.
      return std::isfinite(J_min) && (may_be_inverted || J_min > 0.0);
    }
  };

  /// f [N] = force with which the tissue resists displacement u [m]: the gradient of the stored energy. f
  /// [N]. Where a point is inverted its stress is left at zero and the sweep says so; it never throws.
  Sweep internal_force(const Nodal& u, Nodal& f) const;

  /// The two sweeps apart, for a caller that does more with nodes [first, last) once their force is known.
  Sweep stress_sweep(const Nodal& u) const;
  void gather_sweep(Nodal& f, const std::function<void(Index first, Index last)>& then) const;

  /// Total stored energy at u [J]. With the printed stress there is none, and this is the energy of the form
  /// above.
  /// `unseen`: the part of it in what averaged gradients leave out (GradientVariance) [J].
  double stored_energy(const Nodal& u, double* unseen = nullptr) const;
  /// J - 1 of point q in the last sweep.
  double dilation(Index q) const { return single_ ? single_->dilation(q) : double_->dilation(q); }
  /// F at every point, as [9 x Q] column-major 3x3 matrices.
  Eigen::Matrix<double, 9, Eigen::Dynamic> deformation_gradients(const Nodal& u) const;

  /// First Piola-Kirchhoff stress at every point [9 x Q] Pa, column-major 3x3 matrices.
  Eigen::Matrix<double, 9, Eigen::Dynamic> stresses(const Nodal& u) const;

  /// A step of dt [s] of viscoelastic tissue begins, or has ended at u. Elastic tissue does not notice.
  void begin_step(double dt) const;
  void accept_step(const Nodal& u) const;
  /// All that accepted steps have left, for a state that is kept. Throws std::invalid_argument: too few
  /// numbers.
  std::vector<double> past() const;
  void restore_past(const std::vector<double>& past) const;

  /// Of the converging scheme: the patches' pressures as unknowns of their own. See ProjectedKernel.
  void hold_pressures(const Eigen::VectorXd& pressure) const;
  void release_pressures() const { hold_pressures({}); }
  struct Patches {
    Eigen::VectorXd dilation, bulk;  ///< [patches] J_b - 1; [Pa]
  };
  void patch_state(Patches& patches) const;
  void patch_gradients(const CompressedRows& nodes, Eigen::Matrix4Xf& gradient) const;

  /// The nodes of point q and their shape function gradients [3 x nodes] 1/m, in the system's precision.
  void gradients_at(Index q, std::vector<int>& node, Points& dphi) const;

  const std::vector<Material>& materials() const { return tissues_.material; }
  const Tissues& tissues() const { return tissues_; }
  Precision precision() const { return single_ ? Precision::single_ : Precision::double_; }
  bool viscoelastic() const;
  bool as_printed() const { return is_as_printed(tissues_.material.front()); }
  Index node_count() const { return nodes_; }
  Index point_count() const { return points_; }
  Index pair_count() const { return pairs_; }

 private:
  Tissues tissues_;
  Index nodes_, points_, pairs_;
  bool patches_;
  std::unique_ptr<ProjectedKernel<float>> single_;  // one of the two
  std::unique_ptr<ProjectedKernel<double>> double_;
};

/// Pads vectors [3xN] for the hot loop; `.topRows<3>()` takes them back.
ForceSystem::Nodal to_nodal(const Points& values);

}  // namespace dimple
