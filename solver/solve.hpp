#pragma once

#include <string_view>

#include "solver/march/steps.hpp"

namespace dimple {

/// How time is followed.
enum class TimeMode {
  quasi_static,  ///< equilibrium at each depth: march_quasi_statically()
  explicit_      ///< with inertia, by central differences: march_explicitly()
};
std::string_view name_of(TimeMode mode);

/// How many times a shear wave crosses the body while the load lasts.
double shear_crossings(const Model& model, const Tissues& tissues, const Loading& loading);

/// The cheapest way that loses nothing: equilibrium where the load is slow, so that inertia plays no part
/// (slow_load crossings or more), else central differences. The paper's scheme knows only those.
///
/// A load that ends before half a radius of the circle is taken to last as long as one that deep: however
/// slow its tool, it would be over before the tissue has moved, and its force would be that of a wave, rho c
/// v pi R^2, however small the depth. At the speeds v that pass so, and half a radius deep, that is at most
/// pi / 64 R / L of a flat punch's 8 mu R d: R is the circle's radius, c the shear wave's speed, L its way.
TimeMode choose_time(const Model& model, const Tissues& tissues, const Loading& loading);

/// Lets the body come to rest under the loads that move it, if any do, and brings the tool of the load to
/// where it first touches it then. Throws SolveError: the body does not carry them.
void rest_under_loads(const ForceSystem& tissue, const Model& model, Loading& loading,
                      double tolerance = 1e-4);

/// Marches from rest, or from where an earlier run of the same case stood, to the depth of the load.
/// `history` receives the force curve as it goes. `part`: of a scene whose body changes between its steps.
/// Throws SolveError: why it ended before.
void solve(TimeMode mode, const ForceSystem& tissue, const Model& model, const Loading& loading,
           const SolverOptions& options, const Observer& observer, History& history,
           const MarchState* from = nullptr, ScenePart* part = nullptr);

/// The same for who wants only the curve. `interrupted` if it was asked to stop.
History solve(const Model& model, const Tissues& tissues, const Loading& loading,
              const SolverOptions& options = {}, Precision precision = Precision::single_);

}  // namespace dimple
