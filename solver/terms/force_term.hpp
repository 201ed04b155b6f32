#pragma once

#include <memory>
#include <vector>

#include "solver/constraints.hpp"

namespace dimple {

/// Progress of a load: all that a force may depend on besides the displacements.
struct Instant {
  double t = 0.0;         ///< [s]
  double depth = 0.0;     ///< travel of the tool, or of the set that moves instead, in this step [m]
  double fraction = 1.0;  ///< fraction of the loads that act before contact
};

/// Bound of the stiffness of a force, for preconditioners [N/m]: of each node against the ground, and between
/// two nodes.
struct StiffnessBound {
  struct Edge {
    int a, b;
    double weight;
  };
  Eigen::VectorXd node;  ///< [N]
  std::vector<Edge> edge;
  std::vector<Edge> directed;  ///< forces that resist in some directions alone, see NodeStiffness
};

/// Stiffness of each node while its neighbours are fixed [9xN] N/m, a symmetric matrix each.
using NodeStiffness = Eigen::Matrix<double, 9, Eigen::Dynamic>;

/// Force on the body other than that of its tissue: a load, a membrane, a contact. An object belongs to one
/// run and keeps its own history. The same bits for any number of threads.
class ForceTerm {
 public:
  virtual ~ForceTerm() = default;
  /// Adds the derivative of the energy by u [4xN] m to f [4xN] N, with the sign of a resistance.
  virtual void add_force(const Nodal& u, const Instant& now, Nodal& f) = 0;
  /// [J] at u; without an energy, minus the work on the accepted states and from the last of them to u.
  virtual double energy(const Nodal& u, const Instant& now) = 0;
  virtual void add_stiffness_bound(StiffnessBound&) const {}
  /// Adds the stiffness at u of StiffnessBound::directed alone.
  virtual void add_node_stiffness(const Nodal&, NodeStiffness&) const {}
  /// True for external loads, such as gravity. They scale the residual; forces within the body do not.
  virtual bool is_load() const { return true; }
  /// Pressure on the entire surface that follows its normals [Pa]; see ForceState::press_around().
  virtual double pressure_around() const { return 0.0; }
  /// Ends a step at u.
  virtual void accept(const Nodal&, const Instant&) {}
  /// History of accepted steps; any number of values.
  virtual std::vector<double> past() const { return {}; }
  virtual void restore_past(const std::vector<double>&) {}
};
using ForceTerms = std::vector<std::unique_ptr<ForceTerm>>;

}  // namespace dimple
