#include "apps/scenes.hpp"

#include "preprocess/shapes.hpp"

namespace dimple {

Scene scene_a() {
  return {.name = "a",
          .title = "Scene A: block 60 x 60 x 30 mm",
          .reference = {0.00975, 0.0193, 0.0288, 0.0383, 0.0480, 0.0576, 0.0672, 0.0769},
          .source = "P2/P1 tetrahedra, rim 0.3 mm, known to 1 %",
          .phantom = {.shape = "block", .size_mm = {60.0, 60.0, 30.0}, .spacing_mm = 1.0}};
}

// The tetrahedral code has one mesh of this body, with a rim of 1.2 mm, which from 5 mm on is stiffer against
// the block than on any pair of matching meshes: see tests/verification/reference.
Scene scene_b() {
  return {.name = "b",
          .title = "Scene B: cut ellipsoid 92.5 x 62.5 x 28.5 mm",
          .reference = {0.00972, 0.01923, 0.02867, 0.03807, 0.04764, 0.05708, 0.06639, 0.0759},
          .source = "the block's x ratio of both by hexahedra",
          .phantom = {.shape = "cut-ellipsoid", .size_mm = {92.5, 62.5, 28.5}, .spacing_mm = 1.0}};
}

BodySurface exact_surface(const Scene& scene) {
  if (scene.name == "a") return block_surface({-30, -30, 0}, {30, 30, 30});
  return cut_ellipsoid_surface({46.25, 31.25, 16.7647}, -11.7353);
}

}  // namespace dimple
