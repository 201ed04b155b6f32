#pragma once

#include <string_view>

#include "solver/march/steps.hpp"

namespace dimple {

/// Time integration.
enum class TimeMode {
  quasi_static,  ///< equilibrium at each depth: march_quasi_statically()
  explicit_      ///< with inertia, by central differences: march_explicitly()
};
std::string_view name_of(TimeMode mode);

/// Number of times that a shear wave crosses the body during the load.
double shear_crossings(const Model& model, const Tissues& tissues, const Loading& loading);

/// Cheapest time integration without loss: quasi-static if the load is slow and inertia negligible (slow_load
/// crossings or more), else central differences. The paper's scheme has only those.
///
/// A load to less than half a radius of the bonded patch counts as one to that depth. However slow its tool,
/// it would end before the tissue moves, and its force would be that of a wave, rho c v pi R^2. For the
/// speeds v that pass, at half a radius, this is at most pi / 64 R / L of a flat punch's 8 mu R d: R is the
/// radius, c the shear wave's speed, L its path.
TimeMode choose_time(const Model& model, const Tissues& tissues, const Loading& loading);

/// Finds the equilibrium under the loads that move the body, if any, and moves the tool to its first contact
/// there. Throws SolveError: the body does not carry them.
void equilibrium_under_loads(const ForceSystem& tissue, const Model& model, Loading& loading,
                             double tolerance = 1e-4);

/// Marches from rest, or from `from` of an earlier run of the same case, to the depth of the load. `history`
/// receives the force curve during the march. `part`: of a scene whose body changes between steps. Throws
/// SolveError: the reason for an early end.
void solve(TimeMode mode, const ForceSystem& tissue, const Model& model, const Loading& loading,
           const SolverOptions& options, const Observer& observer, History& history,
           const MarchState* from = nullptr, ScenePart* part = nullptr);

/// Solves a case with default observers and returns its history; `interrupted` if it was stopped.
History solve(const Model& model, const Tissues& tissues, const Loading& loading,
              const SolverOptions& options = {}, Precision precision = Precision::single_);

}  // namespace dimple
