#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "preprocess/image/phantom.hpp"
#include "preprocess/scene/boundary_conditions.hpp"
#include "preprocess/surface/label_surface.hpp"
#include "solver/material.hpp"

namespace dimple {

// Random scenes of dimple_calibrate. A scene's number determines all that is drawn.

/// True for scenes that prove the bounds; the others up to `first_large` calibrate. The second range was
/// drawn after the multipliers proved with the first one were known.
constexpr bool proves(int number) {
  return (number >= 51 && number <= 120) || (number >= 166 && number <= 225);
}
inline constexpr int second_proof = 166, first_folded = 256;
/// First numbers of two groups that do not enter the multiplier: large bodies of 20 to 320 patch radii, and
/// thin ones of 0.8 to 3 radii. The largest were added so that more than four are larger than 200 radii.
inline constexpr int first_large = 2001, first_largest = 2020, first_thin = 3001;

struct CalibrationScene {
  int number = 0;
  std::string body, law = "neo-Hookean";
  std::function<SegmentedBody()> surface;
  std::filesystem::path image = {};
  bool core = false;  ///< stiffer than its surroundings
  BoundaryOptions boundary = {};
  double depth_mm = 0.0, nu = 0.499;
};

/// Phantom of the scenes with a core.
extern const PhantomOptions phantom_with_core;

/// Scene with this number, of any group. `data`: folder of the label images, `atlases`: of the folded brains.
CalibrationScene scene_of(int number, const std::filesystem::path& data,
                          const std::filesystem::path& atlases);

Material material_of(const CalibrationScene& scene, double mu);

/// Group of the scene, as in column `set` of the tables.
std::string set_of(const CalibrationScene& scene);

}  // namespace dimple
