#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <variant>
#include <vector>

#include "preprocess/model.hpp"
#include "solver/constraints.hpp"
#include "solver/terms/projected_kernel.hpp"

namespace dimple {

/// Width of the numbers in the hot loop of the converging scheme. Displacements, forces and sums outside it
/// are double.
enum class Precision { single_, double_ };

/// Model prepared for the hot loops: constant after construction, and usable by any number of ForceStates at
/// once. With pressure patches it is the converging scheme (see ProjectedKernel), without them the paper's,
/// which is below.
///
/// Letters: the paper writes X for the deformation gradient and F for the force vector; here, as usual today,
/// the gradient is F and the force f.
///
///     sweep 1, points:  F_q = I + sum_a u_a (x) dphi_qa,   P_q = F_q S_q,   V_q P_q dphi_qa to block sums
///     sweep 2, nodes:   f_a = sum of its block sums
///
/// which is the paper's f = integral of B_L^T S (section 2.2) without the 6 x 3n matrix: a test compares the
/// two. Blocks are fixed and sums have one order: the result is the same, bit for bit, for any number of
/// threads.
///
/// Layout: four (point, node) pairs are one record, see ProjectedQuad; nodal vectors and the columns of V P
/// are padded to four numbers, so that each is one vector register.
class ForceSystem {
 public:
  /// One tissue.
  ForceSystem(const Model& model, const Material& material, Precision precision = Precision::double_);
  /// Several tissues; the paper's scheme uses the first.
  ForceSystem(const Model& model, const Tissues& tissues, Precision precision = Precision::double_);

  using Nodal = dimple::Nodal;

  /// Worst point of a sweep: smallest J and its point. Not ok if J is not finite, or not positive where it
  /// must be.
  struct Sweep {
    double J_min = 1.0;
    Index point = -1;
    Index inverted = 0;            ///< points with J <= 0
    bool may_be_inverted = false;  ///< the energy is defined there, and a solver may pass through
    bool ok() const {
      // Not J_min > 0 || (may_be_inverted && J_min <= 0): GCC 12 makes that true for NaN.
      return std::isfinite(J_min) && (may_be_inverted || J_min > 0.0);
    }
  };

  /// The nodes of point q and their shape function gradients [3 x nodes] 1/m, in the system's precision.
  void gradients_at(Index q, std::vector<int>& node, Points& dphi) const;

  const std::vector<Material>& materials() const { return tissues_.material; }
  const Tissues& tissues() const { return tissues_; }
  /// At rest, of the tissue at point q [Pa].
  double shear_modulus(Index q) const {
    return tissues_.material[static_cast<std::size_t>(tissues_.of_point[q])].mu;
  }
  Precision precision() const { return single_ ? Precision::single_ : Precision::double_; }
  bool viscoelastic() const;
  bool as_printed() const { return is_as_printed(tissues_.material.front()); }
  Index node_count() const { return nodes_; }
  Index point_count() const { return points_; }

 private:
  friend class ForceState;
  Tissues tissues_;
  Index nodes_, points_;
  bool patches_;
  std::unique_ptr<const ProjectedKernel<float>> single_;  // one of the two
  std::unique_ptr<const ProjectedKernel<double>> double_;
};

/// State of the force besides the displacements: viscoelastic history, held pressures, and results of the
/// last sweep. Starts at rest and relaxed. Copies are independent. Only energies and lists allocate after
/// construction.
class ForceState {
 public:
  using Sweep = ForceSystem::Sweep;

  /// `system` must outlive it.
  explicit ForceState(const ForceSystem& system);
  const ForceSystem& system() const { return *system_; }

  /// f [4xN] N = force with which the tissue resists displacement u [4xN] m: the gradient of the stored
  /// energy. Without patches inverted points have no stress, and the sweep reports them; it never throws.
  Sweep internal_force(const Nodal& u, Nodal& f);

  /// The two sweeps separately, for a caller that does more with nodes [first, last) once their force is
  /// known.
  Sweep stress_sweep(const Nodal& u);
  std::int64_t sweeps() const { return sweeps_; }  ///< so far
  void gather_sweep(Nodal& f, const std::function<void(Index first, Index last)>& then) const;

  /// Total stored energy at u [J]. With the printed stress there is none, and this is the energy of the form
  /// above. `hourglass`: the part of it in what averaged gradients leave out (GradientVariance) [J].
  double stored_energy(const Nodal& u, double* hourglass = nullptr);

  /// Results of the last sweep: J - 1 of point q; F [9 x Q] and first Piola-Kirchhoff stress [9 x Q] Pa at
  /// every point, column-major 3x3 matrices.
  double dilation(Index q) const;
  Eigen::Matrix<double, 9, Eigen::Dynamic> deformation_gradients() const;
  Eigen::Matrix<double, 9, Eigen::Dynamic> stresses() const;

  /// Begins a step of dt [s] of viscoelastic tissue, or ends it at u. Elastic tissue is not affected.
  void begin_step(double dt);
  void accept_step(const Nodal& u);
  /// History of accepted steps. Throws std::invalid_argument: too few numbers.
  std::vector<double> past() const;
  void restore_past(const std::vector<double>& past);

  /// Makes the patches' pressures independent unknowns, in the converging scheme only. See ProjectedKernel.
  void hold_pressures(const Eigen::VectorXd& pressure);
  /// Applies a following pressure on the entire surface [Pa], in the converging scheme only, as one more
  /// pressure in all of the tissue: the forces agree to the last digit. Forces on the surface's triangles
  /// would differ where the surface is curved, by more than soft tissue can resist.
  void press_around(double pressure);
  double pressure_around() const;  ///< that pressure; stresses() include it
  struct Patches {
    Eigen::VectorXd dilation, bulk;  ///< [patches] J_b - 1; [Pa]
  };
  void patch_state(Patches& patches) const;
  void patch_gradients(const CompressedRows& nodes, Eigen::Matrix4Xf& gradient) const;

 private:
  const ForceSystem* system_;
  std::int64_t sweeps_ = 0;
  std::variant<ProjectedKernel<float>::State, ProjectedKernel<double>::State> state_;

  // The kernel and its state.
  template <class Then>
  decltype(auto) with(const Then& then);
  template <class Then>
  decltype(auto) with(const Then& then) const;
};

/// Pads vectors [3xN] for the hot loop; `.topRows<3>()` takes them back.
Nodal to_nodal(const Points& values);

}  // namespace dimple
