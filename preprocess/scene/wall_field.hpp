#pragma once

#include "preprocess/surface/body_surface.hpp"
#include "preprocess/surface/distance_grid.hpp"

namespace dimple {

/// Signed distances from a wall in world coordinates [m], negative within it, for every place between `low`
/// and `high` [mm]. `wall`: the solid; with `hollow` the cavity in it. Exact to `margin_mm` from its surface,
/// and bounded by that beyond. About 0.7 million points, at least `finest_mm` apart. Throws Stopped.
DistanceGrid wall_field(const BodySurface& wall, bool hollow, const Vec3& low, const Vec3& high,
                        double finest_mm, double margin_mm);

}  // namespace dimple
