#pragma once

#include <vector>

#include "apps/run/pipeline.hpp"

namespace dimple {

/// Before anything is built: throws UsageError where no load acts on a body that was imaged under its loads
/// (load.imaged), or where they were taken off before. `model`: one that was made before; from it they may
/// have been taken off already.
void check_imaged(const Scene& scene, const ModelFiles* model);

/// Of a body that was imaged under its loads: makes result.model that of the shape without them, from which
/// they bring it back to the image's. Nodes, points with their cells, and the surface go back by as much as
/// they come to lie beside where the image has them, and the model is completed anew, until they do not:
///
///     X <- X - (X + u(X) - x),   x the place in the image, u the equilibrium under the loads from X.
///
/// Throws UsageError: folds of the body touch. Throws SolveError: it does not come closer, or the body does
/// not carry its loads.
///
/// Source:   Sellier, Comput. Methods Appl. Mech. Eng. 200 (2011) 1843 (the inverse problem by fixed points).
void take_loads_off(const Scene& scene, const std::vector<HeldSet>& further,
                    const std::vector<double>& density, const RunLog& log, LoadedModel& result);

}  // namespace dimple
