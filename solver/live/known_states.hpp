#pragma once

#include <vector>

#include "solver/terms/internal_force.hpp"
#include "solver/terms/tool_force.hpp"

namespace dimple {

/// Equilibria of an elastic body over the depth of its tool, independent of the path. The polynomial through
/// those around a depth is a first guess there; its derivative gives the effect of unbalanced forces on the
/// tool.
struct KnownStates {
  struct State {
    double at = 0.0;  ///< depth [m]
    ForceSystem::Nodal u;
    Eigen::VectorXd lambda;  ///< pressures x volumes, see MixedIteration
    double residual = 0.0, force = 0.0;
    Wrench per_force = Wrench::Zero();  ///< see LiveFrame
  };
  std::vector<State> state;  ///< ascending
  double apart = 0.0;        ///< least distance of two states [m]

  /// Adds a state, unless one as good is nearer than `apart`; it replaces worse ones nearby.
  void add(State state);
  double deepest() const { return state.empty() ? 0.0 : state.back().at; }
  const State& nearest(double at) const;  ///< needs one
  /// First guess of the equilibrium at a depth. Needs two states.
  void guess(double at, ForceSystem::Nodal& u, Eigen::VectorXd& lambda) const;
  /// d/d depth of displacements [-], pressures x volumes [N] and of the force [N/m] there. Needs two states.
  struct Slope {
    ForceSystem::Nodal u;
    Eigen::VectorXd lambda;
    double force = 0.0;
  };
  Slope slope(double at) const;
};

}  // namespace dimple
