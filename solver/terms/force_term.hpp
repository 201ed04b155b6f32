#pragma once

#include <memory>
#include <vector>

#include "solver/constraints.hpp"

namespace dimple {

/// How far a load has come: all that a force may depend on beside the displacements.
struct Instant {
  double t = 0.0;      ///< [s]
  double depth = 0.0;  ///< how far the tool, or what moves in its place, has come in this step of a scene [m]
  double share = 1.0;  ///< of the loads that act before the tool touches: 0 while none does, 1 when all do
};

/// A bound of how stiff a force is, for preconditioners [N/m]: of each node against the room, and between two
/// nodes.
struct StiffnessBound {
  struct Edge {
    int a, b;
    double weight;
  };
  Eigen::VectorXd node;  ///< [N]
  std::vector<Edge> edge;
  std::vector<Edge> directed;  ///< of what resists in some directions alone, see NodeStiffness
};

/// How stiff a node is in each direction, while its neighbours rest [9xN] N/m, a symmetric matrix each.
using NodeStiffness = Eigen::Matrix<double, 9, Eigen::Dynamic>;

/// A force on the body beside what its tissue resists with: a load, a membrane, a contact. An object belongs
/// to one run, and keeps what it needs of the run's past. The same bits for any number of threads.
class ForceTerm {
 public:
  virtual ~ForceTerm() = default;
  /// Adds to f [4xN] N the derivative of the energy by u [4xN] m: as of the tissue, what resists the
  /// displacement.
  virtual void add_force(const Nodal& u, const Instant& now, Nodal& f) = 0;
  /// [J] at u; of a force without one, minus its work on the accepted states and from the last of them to u.
  virtual double energy(const Nodal& u, const Instant& now) = 0;
  virtual void add_stiffness_bound(StiffnessBound&) const {}
  /// At u, of StiffnessBound::directed alone.
  virtual void add_node_stiffness(const Nodal&, NodeStiffness&) const {}
  /// Whether it acts from outside, as gravity does. Such forces are a measure of what is left unbalanced;
  /// those within the body, as its tissue's, are not.
  virtual bool is_load() const { return true; }
  /// Of a pressure on all of the surface that follows it [Pa]; see ForceState::press_around().
  virtual double pressure_around() const { return 0.0; }
  /// u ends a step.
  virtual void accept(const Nodal&, const Instant&) {}
  /// All that accepted steps have left; any number of numbers.
  virtual std::vector<double> past() const { return {}; }
  virtual void restore_past(const std::vector<double>&) {}
};
using ForceTerms = std::vector<std::unique_ptr<ForceTerm>>;

}  // namespace dimple
