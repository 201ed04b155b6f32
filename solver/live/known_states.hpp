#pragma once

#include <vector>

#include "solver/terms/internal_force.hpp"
#include "solver/terms/tool_force.hpp"

namespace dimple {

/// Equilibria of an elastic body under a tool whose way is one number: points of a curve over the depth,
/// whichever way and however often the tool went. The polynomial through those around a depth is where to
/// look for the equilibrium there, and its derivative says what an unbalanced force does to that on the tool.
struct KnownStates {
  struct State {
    double at = 0.0;  ///< depth [m]
    ForceSystem::Nodal u;
    Eigen::VectorXd lambda;  ///< pressures x volumes, see MixedIteration
    double residual = 0.0, force = 0.0;
    Wrench per_force = Wrench::Zero();  ///< see LiveFrame
  };
  std::vector<State> state;  ///< ascending
  double apart = 0.0;        ///< as near as that two of them do not stand [m]

  /// Takes it up, unless one as good stands nearer than `apart`; in the place of those nearby that are worse.
  void add(State state);
  double deepest() const { return state.empty() ? 0.0 : state.back().at; }
  const State& nearest(double at) const;  ///< needs one
  /// Where to look for the equilibrium at a depth. Needs two states.
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
