#pragma once

#include <tbb/global_control.h>

#include <string>

#include "apps/run/model_options.hpp"
#include "preprocess/surface/label_surface.hpp"
#include "solver/terms/internal_force.hpp"

namespace dimple {

/// What is measured: a block of 60 x 60 x 30 mm from a label image of 1 mm, with all options as the program
/// has them unless given here.
struct MeasuredBlock {
  Scene run;
  LabelImage image;
  Material material;
  Model model;
  ForceSystem::Nodal u;  ///< [N] m: a dent as under the tool, for force evaluations
};

/// From the image to a model that a solver can take.
Model whole_model(const LabelImage& image, const Scene& run);

/// Made when first asked for and kept. In the converging scheme's, the product's force has been compared with
/// the reference's; if they differ, the program ends and says so.
const MeasuredBlock& scene(const std::string& scheme, Index nodes);

/// A line for each scene made so far: how large it is.
std::string scene_facts();

/// While it lives, so many threads.
class Threads {
 public:
  explicit Threads(int count)
      : limit_(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(count)) {}

 private:
  tbb::global_control limit_;
};

}  // namespace dimple
