#pragma once

#include <filesystem>
#include <string>

#include "apps/config.hpp"
#include "apps/model_files.hpp"
#include "apps/results.hpp"
#include "preprocess/label_surface.hpp"

namespace dimple {

/// What the commands do, without the command line. Each throws Error, Stopped too if there is nothing to
/// keep; none but describe_image() prints to stdout. `existing`: what to do with results that are in the
/// folder already.
struct Outcome {
  std::string summary_json;  ///< what summary.json holds
  std::string headline;      ///< one line: the force, and where the pictures are
  bool interrupted = false;
  std::string ended_by = {};  ///< where and by what, if it was
};

void describe_image(const std::filesystem::path& image, const std::filesystem::path& label_names,
                    bool as_json);
Outcome make_model(const Config& config, const std::filesystem::path& folder,
                   Existing existing = Existing::refuse);
Outcome solve_model(const Config& config, const std::filesystem::path& model,
                    const std::filesystem::path& folder, Existing existing = Existing::refuse);
Outcome run(const Config& config, const std::filesystem::path& folder, Existing existing = Existing::refuse);

/// A force curve and what it cost, without any files.
struct Measured {
  Index nodes = 0, points = 0;
  double spacing_mm = 0.0, rim_spacing_mm = 0.0;
  History history;
  double build_s = 0.0, solve_s = 0.0;
};
Measured measure(const Config& config);

/// The body of an image and no more: for other programs' meshes.
SegmentedBody segment(const Config& config);

}  // namespace dimple
