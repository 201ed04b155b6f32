#pragma once

#include <cstdint>
#include <vector>

#include "preprocess/model.hpp"
#include "solver/huge_pages.hpp"
#include "solver/material.hpp"
#include "solver/terms/projected_loops.hpp"

namespace dimple {

/// Consecutive points that one thread computes together; and number of them that go from displacements to
/// forces at once, without patches.
constexpr Index points_per_block = 256;
constexpr Index points_at_once = 32;

/// Materials, and the tissue of each point.
struct Tissues {
  std::vector<Material> material;
  Eigen::VectorXi of_point;  ///< [Q] number in `material`
};

/// The stored energy of the converging scheme and its forces; Real is float or double. Without patches: the
/// paper's scheme, ks = kappa at every point and no last term.
///
/// With F_q the mean of the deformation gradient over cell q, J_q = det F_q, psi_b the patches' weights:
///
///     J_b  = sum_q psi_b V_q J_q / V_b            the volume ratio that the bulk modulus acts on
///     J~_q = sum_b psi_b(q) J_b                    what of J_q the patches resolve
///
///     W = sum_q V_q [ W_dist(F_q) + ks/2 (J_q - 1)^2 + ks beta/2 (J_q - J~_q)^4 ]
///       + (kappa - ks)/2 sum_b V_b (J_b - 1)^2
///       + mu/2 sum_cells V (mean|F|^2 - |mean F|^2)
///
/// Forces are its exact derivative, so energy, momentum and angular momentum are kept as by any hyperelastic
/// body. Purpose of each term:
///
/// - W_dist at the cell's mean gradient: with means, the sum of nodal forces of any constant stress vanishes
///   at inner nodes for any cells (the patch test), as by surface integrals in SCNI (Chen et al. 2001).
/// - the last term: what the mean leaves out of mu/2 |F|^2. It is quadratic, so it is integrated once,
///   beforehand, with all eight places of every cell: no zero-energy modes, and no softening with larger
///   cells.
/// - kappa on J_b: a coarser space for the volume, or the body locks.
/// - ks = min(2/3 mu, kappa) at every point: W_dist does not resist dilation that the patches average out.
///   With this ks its linear part is mu |eps|^2, the Stokes operator's, as stiff in dilation as in shear: the
///   size of the stabilisation in Dohrmann & Bochev 2004. In viscoelastic tissue it falls with the shear
///   modulus.
/// - beta = 1, quartic: keeps J_q from leaving the patch's mean by much more than 1/sqrt(beta) at a sharp
///   edge, where the strain is unbounded; elsewhere it is negligible. W_dist prevents collapse, below its J0;
///   against growth there is nothing else: with beta = 0 points swell without limit. A choice, not a theory.
template <class Real>
class ProjectedKernel {
 public:
  ProjectedKernel(const Model& model, const Tissues& tissues);

  struct Sweep {
    double J_min = 1.0;
    Index point = -1;
    Index inverted = 0;  ///< points with J <= 0
    bool finite = true;
  };

  /// Viscoelastic history of the variance of gradients, as ViscousHistory.
  struct VariancePast {
    std::vector<double> force;  ///< [4xN] constant part of the force during a step
    std::vector<double> h, f0;  ///< [4xN x terms], [4xN]: history
  };

  /// Everything that changes: viscoelastic history, held pressures, and results of the last sweep.
  struct State {
    std::vector<ViscousHistory> history;  ///< by tissue
    std::vector<VariancePast> variance;   ///< as the kernel's
    double elapsed = 0.0, step = 0.0;     ///< [s] until the last accepted step; of the current step
    LongVector<Real> ks, bulk;            ///< [Q]; bulk = kappa - ks
    std::vector<double> patch_bulk;       ///< [patches]
    std::vector<Real> held;               ///< [patches] pressures, or empty
    Real around = 0;                      ///< pressure on the entire surface, with patches only [Pa]

    std::vector<Real> octet_sum;    ///< [8 x places of patches]
    std::vector<double> place_sum;  ///< [places of patches]
    std::vector<Real> u;            ///< [4xN]
    std::vector<Real> moved;  ///< [4 x places] displacements, while forces are added up; without patches
    std::vector<Real> at_node, at_patch;        ///< [4 x places] displacements, then forces; [places] means
    LongVector<ProjectedOctet<Real>> gradient;  ///< [octets of points] F - I
    LongVector<Real> dilation, pressure, unresolved;  ///< [Q]
    std::vector<Real> patch_dilation, patch_unresolved;
    std::vector<Sweep> block;
    bool backward = false;  ///< direction of the next pass over the blocks
  };
  State undeformed() const;

  /// u [4xN] m; afterwards stress() is that of u.
  Sweep stress_sweep(State& s, const double* u) const;
  /// f [4xN] N for nodes [first, last).
  void gather(const State& s, double* f, Index first, Index last) const;
  double stored_energy(State& s, const double* u, double* hourglass = nullptr) const;

  /// Starts a step of a viscoelastic material, dt [s]; accept() makes u the end of that step.
  void begin_step(State& s, double dt) const;
  void accept(State& s, const double* u) const;
  /// History of accepted steps as a list of numbers.
  std::vector<double> past(const State& s) const;
  void restore_past(State& s, const std::vector<double>& past) const;

  /// Holds each patch at this pressure [Pa] instead of that of its volume; empty: releases them. For searches
  /// with pressures as unknowns.
  void hold(State& s, const Eigen::VectorXd& pressure) const {
    s.held.assign(pressure.begin(), pressure.end());
  }
  /// Linearisation of the last stress_sweep. [patches]: J_b - 1, and the bulk modulus that acts on it [Pa].
  void patch_state(const State& s, Eigen::VectorXd& dilation, Eigen::VectorXd& bulk) const;
  /// [4 x nodes.member] dJ_b / du_a, patch by patch [1/m].
  void patch_gradients(const State& s, const CompressedRows& nodes, Eigen::Matrix4Xf& gradient) const;

  double dilation(const State& s, Index q) const {
    return static_cast<double>(s.dilation[static_cast<std::size_t>(q)]);
  }
  /// The nodes of point q and their shape function gradients [3 x nodes] 1/m, in this precision.
  void gradients_at(Index q, std::vector<int>& node, Points& dphi) const;

  Mat3 deformation_gradient(const State& s, Index q) const;  ///< of the last stress_sweep
  /// First Piola-Kirchhoff at every point [9 x Q] Pa, of the last stress_sweep.
  Eigen::Matrix<double, 9, Eigen::Dynamic> stresses(const State& s) const;

 private:
  using Loops = ProjectedLoops<Real>;
  using Quad = ProjectedQuad<Real>;
  using Octet = ProjectedOctet<Real>;
  using Columns = ProjectedColumns<Real>;
  using Fraction = ProjectedFraction<Real>;
  struct Lists {
    std::vector<std::int32_t> offset;
    LongVector<Fraction> fraction;
  };
  // Members (nodes, patches) of each block of points, all blocks end to end. Each block writes only to its
  // own places; every member then sums its places in order, which is the same for any number of threads.
  struct Places {
    std::vector<std::int32_t> offset, member;    // [blocks + 1], [places]
    std::vector<std::int32_t> of_offset, place;  // [members + 1], of each member
  };
  struct Variance {
    Lists rows;
    int tissue;
  };

  Index nodes_, points_, patches_, blocks_;
  std::vector<Material> material_;
  std::vector<std::int32_t> tissue_;  // [Q]
  bool plain_ = true;                 // all neo-Hookean and elastic
  std::vector<std::int32_t> point_offset_;
  LongVector<Quad> quad_;  // by point, the last padded; places relative to the block
  // Lists of eight points: their patches' numbers within the block, and psi [8 x members].
  std::vector<std::int32_t> octet_offset_, octet_number_;
  LongVector<Real> octet_weight_;
  Lists of_patch_;  // points; psi V / V_b
  Places nodes_of_block_, patches_of_block_;
  LongVector<Real> volume_, mu_;  // [Q], and whole octets
  Real smallest_J_, slope_;       // see neo_hookean_stresses
  std::vector<double> patch_volume_;
  std::vector<Variance> variance_;
  std::vector<std::int32_t> slot_;  // [Q] of the point in its tissue's history
  std::vector<Index> points_of_tissue_;

  struct OfBlock;  // what stress_sweep() does with the points of one block
  void number_blocks(const CompressedRows& rows, Index members, Places& places,
                     std::vector<std::int32_t>& local) const;
  void lay_out_supports(const Model& model);
  void lay_out_patches(const Model& model);
  void lay_out_points(const Model& model);
  void lay_out_variance(const Model& model);
  void pointwise_forces(State& s, Index first, Index last, std::size_t from, std::size_t to) const;
  // Visits all that past() lists, in its order.
  template <class OfState, class Visit>
  static void visit_past(OfState& s, const Visit& visit);
  double unresolved_dilation(const State& s, std::size_t q) const;
  void find_patch_bulk(State& s) const;
  template <class Body>
  void over_blocks(State& s, const Body& body) const;
  void sum_patches(const State& s, std::vector<Real>& patch) const;
  /// V P of points [first, last), into `stress` from its beginning.
  void point_stresses(const State& s, Index first, Index last, Columns* stress) const;
};

}  // namespace dimple
