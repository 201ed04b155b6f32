#include "tests/verification/scenes.hpp"

#include <fmt/format.h>

#include "tests/helpers/shapes.hpp"

namespace dimple {

namespace {

// How well a reference is known is derived by tests/verification/reference/references.py; a test compares.
// Beyond one radius it is a guess: no code converges there, because the sharp rim makes every mesh's force
// its own.
std::array<std::string, 8> labelled(const std::array<std::string, 8>& source,
                                    const std::array<double, 8>& known) {
  std::array<std::string, 8> result;
  for (std::size_t k = 0; k < 8; ++k)
    result[k] = fmt::format("{}; known to {:.2g} %", source[k], 100.0 * known[k]);
  return result;
}

}  // namespace

Scene scene_a() {
  const std::string fine = "P2/P1 tetrahedra, rim 0.3 mm, code not here",
                    coarser = "P2/P1 tetrahedra, rim 0.6 mm, code not here";
  const std::array<double, 8> known = {0.004, 0.007, 0.011, 0.027, 0.03, 0.03, 0.04, 0.04};
  return {.name = "a",
          .title = "Scene A: block 60 x 60 x 30 mm",
          .reference = {0.00975, 0.0193, 0.0288, 0.0383, 0.0480, 0.0576, 0.0672, 0.0769},
          .known_to = known,
          .tolerance = {0.01, 0.01, 0.01, 0.01, 0.01, 0.02, 0.03, 0.04},
          .source = labelled({fine, fine, fine, fine, fine, fine, coarser, coarser}, known),
          .phantom = {.shape = "block", .size_mm = {60.0, 60.0, 30.0}, .spacing_mm = 1.0}};
}

// The tetrahedral code has one mesh of this body, with a rim of 1.2 mm, which from 5 mm on is stiffer against
// the block than on any pair of matching meshes: see tests/verification/reference. Both are held against.
Scene scene_b() {
  const std::array<double, 8> known = {0.007, 0.009, 0.013, 0.029, 0.034, 0.033, 0.05, 0.045};
  std::array<std::string, 8> source;
  source.fill("block's x ratio of both by hexahedra.cpp");
  return {.name = "b",
          .title = "Scene B: cut ellipsoid 92.5 x 62.5 x 28.5 mm",
          .reference = {0.00972, 0.01923, 0.02867, 0.03807, 0.04764, 0.05708, 0.06639, 0.0759},
          .known_to = known,
          .tolerance = {0.015, 0.015, 0.015, 0.015, 0.015, 0.02, 0.03, 0.04},
          .source = labelled(source, known),
          .phantom = {.shape = "cut-ellipsoid", .size_mm = {92.5, 62.5, 28.5}, .spacing_mm = 1.0}};
}

BodySurface exact_surface(const Scene& scene) {
  if (scene.name == "a") return block_surface({-30, -30, 0}, {30, 30, 30});
  return cut_ellipsoid_surface({46.25, 31.25, 16.7647}, -11.7353);
}

}  // namespace dimple
