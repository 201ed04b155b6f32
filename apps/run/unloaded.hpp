#pragma once

#include <vector>

#include "apps/run/pipeline.hpp"

namespace dimple {

/// Checks before anything is built. Throws UsageError: no load acts on a body that was imaged under its loads
/// (load.imaged), or they were removed before. `model`: one that was made before, perhaps without its loads.
void check_imaged(const Scene& scene, const ModelFiles* model);

/// Load-free configuration of a body that was imaged under its loads: result.model becomes the one that the
/// loads bring back to the image. Nodes, points with their cells, and the surface are corrected by their
/// distance to the image. The model is completed again until the distance is small:
///
///     X <- X - (X + u(X) - x),   x the place in the image, u the equilibrium under the loads from X.
///
/// Throws UsageError: folds of the body are in contact. Throws SolveError: the rounds do not converge, or the
/// body cannot carry its loads.
///
/// Source:   Sellier, Comput. Methods Appl. Mech. Eng. 200 (2011) 1843 (the inverse problem by fixed points).
void take_loads_off(const Scene& scene, const std::vector<HeldSet>& further,
                    const std::vector<double>& density, const RunLog& log, LoadedModel& result);

}  // namespace dimple
