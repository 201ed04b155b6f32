#pragma once

#include "preprocess/surface/body_surface.hpp"
#include "preprocess/surface/distance_grid.hpp"

namespace dimple {

/// Signed distances from a wall in the frame of the world [m], negative within it, for every place between
/// `low` and `high` [mm]. `wall`: what is solid; or with `hollow` what is not, and all around it is. Exact to
/// `band_mm` from its surface, and no farther than that beyond. About 0.7 million points, but none nearer to
/// each other than `finest_mm`. Throws Stopped.
DistanceGrid wall_field(const BodySurface& wall, bool hollow, const Vec3& low, const Vec3& high,
                        double finest_mm, double band_mm);

}  // namespace dimple
