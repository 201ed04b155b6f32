#pragma once

#include <cstdint>
#include <functional>

#include "preprocess/build_model.hpp"
#include "solver/equilibrium/relax.hpp"
#include "tests/verification/verify.hpp"

namespace dimple {

// Common parts of the verification cases: bodies that are smooth images of the unit cube, without any image
// or surface, and their equilibrium.

/// A lattice in the unit cube and its image. SI units.
struct Lattice {
  std::function<Vec3(const Vec3&)> place;  ///< from the unit cube [0, 1]^3 to the body [m]
  Eigen::Array3i intervals;                ///< nodes along an edge of the cube, less one
  Eigen::Array3i cells;                    ///< of integration, along an edge
  double jitter = 0.0;  ///< each node moves by up to this part of an interval, within its face
  std::function<int(const Vec3&)> tissue;  ///< number of the tissue at a place [m]; none: all one
  std::uint32_t seed = 1;
};

struct LatticeBody {
  Discretisation places;  ///< a point's label is the number of its tissue
  Points at;              ///< [3xN] nodes in the unit cube; 0 and 1 exactly on its faces
  bool on_face(Index a, int axis, double value) const { return at(axis, a) == value; }
  bool on_boundary(Index a) const {
    return (at.col(a).array() == 0.0).any() || (at.col(a).array() == 1.0).any();
  }
};

/// Makes nodes, and cells with their exact volumes, centroids and second moments, by 27 Gauss points each. A
/// cell with several tissues uses 512 even parts and becomes a point for each tissue.
LatticeBody make_lattice(const Lattice& lattice);

/// A box from the origin with as many intervals along its shortest edge; cells 1.75 times as fine.
Lattice box_lattice(const Vec3& size, int intervals, double jitter = 0.2);

/// Prescribed values at a fraction of the load in (0, 1]: displacements [3xN] m of the held nodes, of which
/// only the component along the press direction counts for sliding ones; and nodal forces [3xN] N, or none.
/// Free nodes start near these displacements.
struct Load {
  std::function<Points(double fraction)> displacement;
  std::function<Points(double fraction)> force = {};
};

struct Equilibrium {
  ForceSystem::Nodal u, f;
};

/// Marks all held nodes as such, makes the model and finds its equilibrium at the full load, in even steps.
/// Each starts from the last one, scaled up.
class Statics {
 public:
  Statics(LatticeBody body, std::vector<HeldSet> held, std::vector<Material> material);
  Equilibrium solve(const Load& load, int steps = 4, double tolerance = 1e-5) const;

  const LatticeBody& body() const { return body_; }
  const Model& model() const { return model_; }
  const ForceSystem& system() const { return *system_; }
  const Constraints& constraints() const { return constraints_; }

 private:
  LatticeBody body_;  // its places are in the model
  Constraints constraints_;
  Model model_;
  std::unique_ptr<ForceSystem> system_;
};

/// Nodes that are held completely, or along z only.
HeldSet fixed_nodes(const LatticeBody& body, const std::function<bool(Index a)>& chosen);
HeldSet sliding_nodes(const LatticeBody& body, const std::function<bool(Index a)>& chosen);

/// Set of all nodes on the boundary; all others are free.
std::vector<HeldSet> boundary_fixed(const LatticeBody& body);

/// Displacements (F - I) X at every node.
Points affine_displacement(const Model& model, const Mat3& F);

/// Mean first Piola-Kirchhoff stress sum_a f_a X_a^T / V [Pa] from the reactions, exact by virtual work.
Mat3 mean_stress(const Model& model, const ForceSystem::Nodal& f);

/// Sum of the forces at the nodes of a face [N].
Vec3 face_force(const LatticeBody& body, const ForceSystem::Nodal& f, int axis, double value);

/// A frictionless flat punch of radius a on an elastic layer of height h that is bonded to its base: the
/// integral equation of Hayes et al., J. Biomech. 5 (1972) 541, for phi, whose pressure has the transform
/// int_0^1 phi(t) cos(x t) dt. Lengths in a.
class PunchOnLayer {
 public:
  PunchOnLayer(double a_over_h, double nu);
  /// Factor kappa in F = 4 G a d / (1 - nu) kappa at the depth d.
  double factor() const { return w_.dot(phi_); }
  /// Sinking of the surface at the distance r > 1 from the axis, relative to d:
  ///     u(r) = 2/pi int_0^1 phi(t) (1 / sqrt(r^2 - t^2) - int_0^inf (1 - L(x H)) cos(x t) J0(x r) dx) dt
  /// On a half-space L is 1, phi is 1, and u is 2/pi asin(1/r) (Sneddon 1965).
  double sinks(double r) const;

 private:
  double H_, k_;
  Eigen::VectorXd t_, w_, phi_;
  /// Calls `add` with x and (1 - L(x H)) dx.
  void over_x(const std::function<void(double, double)>& add) const;
};
inline double hayes_factor(double a_over_h, double nu) {
  return PunchOnLayer(a_over_h, nu).factor();
}

/// Zero of a growing function between two bounds.
double root(double low, double high, const std::function<double(double)>& value);

/// Row that compares a result with a reference.
VerifyCase compared(std::string name, std::string what, double ours, double reference, double tolerance,
                    std::string unit, std::string source);
/// Row for an order of convergence: a higher order is no error.
VerifyCase order_reached(std::string name, std::string what, double ours, double expected, double tolerance,
                         std::string source);

/// Functions for the groups; each appends its rows.
using Rows = std::vector<VerifyCase>;
void verify_scene_a(Rows& rows, Index nodes);
void verify_scene_b(Rows& rows, Index nodes);
void verify_compressibility(Rows& rows, Index nodes);
void verify_hayes(Rows& rows, Index nodes);
void verify_homogeneous(Rows& rows, Index nodes);
void verify_cook(Rows& rows, Index nodes);
void verify_torsion(Rows& rows, Index nodes);
void verify_manufactured(Rows& rows, Index nodes);
void verify_ogden(Rows& rows, Index nodes);
void verify_viscoelastic(Rows& rows, Index nodes);
void verify_layers(Rows& rows, Index nodes);
void verify_inclusion(Rows& rows, Index nodes);

}  // namespace dimple
