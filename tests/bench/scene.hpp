#pragma once

#include <tbb/global_control.h>

#include <string>

#include "apps/run/model_options.hpp"
#include "preprocess/surface/label_surface.hpp"
#include "solver/terms/internal_force.hpp"

namespace dimple {

/// Measured scene: a block of 60 x 60 x 30 mm from a label image of 1 mm, with the program's defaults for all
/// options not given here.
struct MeasuredBlock {
  Scene run;
  LabelImage image;
  Material material;
  Model model;
  ForceSystem::Nodal u;  ///< [N] m: a dent like that under the tool, for force evaluations
};

/// Complete model from an image, ready for a solver.
Model whole_model(const LabelImage& image, const Scene& run);

/// Scene of this scheme and size, made on first use and kept. For the converging scheme the product's force
/// is compared with the reference's; if they differ, the program ends with a message.
const MeasuredBlock& scene(const std::string& scheme, Index nodes);

/// One line for each scene made so far, with its size.
std::string scene_facts();

/// Limits the number of threads during its lifetime.
class Threads {
 public:
  explicit Threads(int count)
      : limit_(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(count)) {}

 private:
  tbb::global_control limit_;
};

}  // namespace dimple
