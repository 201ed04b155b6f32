#pragma once

#include "solver/constraints.hpp"

namespace dimple {

/// One step of central differences in leapfrog form, with damping c proportional to the mass:
///
///     v(t + dt/2) = ((1 - c k/2) v(t - dt/2) - k f / m) / (1 + c k/2),   u(t + dt) = u(t) + dt v(t + dt/2)
///
/// k: the time between the middles of the last step and of this one.
///
/// Source:   Belytschko, Liu, Moran, Nonlinear Finite Elements, 2nd ed., box 6.1.
struct CentralDifferences {
  double dt;             ///< [s]
  double kick;           ///< k [s]
  double rate;           ///< of the tool [m/s]
  double depth;          ///< of the tool at the end of the step [m]
  double damping = 0.0;  ///< c [1/s]

  /// Advances nodes [first, last) by one step; f [4xN] N at u(t), v [4xN] m/s, u [4xN] m. Held nodes get
  /// their prescribed motion.
  void operator()(Index first, Index last, const Constraints& held, const Eigen::VectorXd& inverse_mass,
                  const Nodal& f, Nodal& v, Nodal& u) const {
    const double keep = (1.0 - 0.5 * damping * kick) / (1.0 + 0.5 * damping * kick);
    const double impulse = kick / (1.0 + 0.5 * damping * kick);
    for (Index a = first; a < last; ++a) {
      if (!held.is_held_wholly(a)) {
        v.col(a) = keep * v.col(a) - f.col(a) * (impulse * inverse_mass[a]);
        u.col(a) += v.col(a) * dt;
      }
      held.speed(a, v.col(a), rate);
      held.place(a, u.col(a), depth);
    }
  }
};

}  // namespace dimple
