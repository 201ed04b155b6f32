#pragma once

#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/solve.hpp"
#include "solver/system.hpp"

namespace dimple::testing_bodies {

/// Stable step of a body without loads.
inline StableStep stable_step(const ForceSystem& tissue, const Model& model, const Eigen::VectorXd& mass,
                              Constraints held, const Nodal& u) {
  System body(tissue, model, std::move(held));
  return stable_time_step(body, mass, u);
}

/// March from rest to its end, for one material or several tissues.
template <class Matter>
History marched(TimeMode time, const Model& model, const Matter& matter, const Loading& loading,
                const SolverOptions& options = {}, Precision precision = Precision::double_) {
  History history;
  solve(time, ForceSystem(model, matter, precision), model, loading, options, {}, history);
  return history;
}

}  // namespace dimple::testing_bodies
