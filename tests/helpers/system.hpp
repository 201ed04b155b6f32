#pragma once

#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/system.hpp"

namespace dimple::testing_bodies {

/// The stable step of a body without loads.
inline StableStep stable_step(const ForceSystem& tissue, const Model& model, const Eigen::VectorXd& mass,
                              Constraints held, const Nodal& u) {
  System body(tissue, model, std::move(held));
  return stable_time_step(body, mass, u);
}

}  // namespace dimple::testing_bodies
