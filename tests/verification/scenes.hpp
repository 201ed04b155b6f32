#pragma once

#include <array>
#include <string>
#include <vector>

#include "preprocess/image/phantom.hpp"
#include "preprocess/surface/body_surface.hpp"

namespace dimple {

/// A body whose force is known from independent finite elements: a circle of 5 mm radius, bonded, pressed
/// onto its top at x = y = 0, its flat base held; neo-Hookean, mu 210 Pa, nu 0.499. How they were made, and
/// how well they are known: tests/verification/reference/README.md.
struct Scene {
  std::string name;                   ///< a, b
  std::string title;                  ///< for people
  std::array<double, 8> reference{};  ///< [N] at 1, 2, ... 8 mm
  std::array<double, 8> known_to{};   ///< uncertainty of the reference, as a part of it
  std::array<double, 8>
      tolerance{};  ///< how far our force may be from it, likewise; does not grow with known_to
  std::array<std::string, 8> source;  ///< of the reference, and how well it is known
  PhantomOptions phantom;             ///< the same body as an image
};
Scene scene_a();
Scene scene_b();

/// The body itself, without voxels between.
BodySurface exact_surface(const Scene& scene);

}  // namespace dimple
