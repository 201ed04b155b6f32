#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/checkpoint.hpp"
#include "apps/run/compare.hpp"
#include "apps/run/images.hpp"
#include "apps/run/record.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/summary.hpp"

namespace dimple {

/// Differences between a run from an image and one from a model's files.
struct Recording {
  std::filesystem::path folder;
  Description options;  ///< written to a file of the folder
  RunIdentity identity;
  std::optional<Checkpoint> resumed = {};
  /// Writes the model, once model and load are accepted; nothing is written before.
  std::function<void(const Result&)> write_model = {};
  std::function<Json(const Result&)> summary = {};                    ///< beginning of the summary
  std::function<std::vector<std::string>(const Result&)> facts = {};  ///< for the picture
  std::string subject = {};
  std::vector<std::string> command = {};       ///< repeats the run; none: its image is in memory only
  std::optional<MeasuredCurve> compared = {};  ///< for comparison with the force
  ImageTask images = {};
  double read_s = 0.0;  ///< before simulate()
  Stopwatch whole = {};
};

/// simulate() with its results written to the folder at once. Throws Error; Stopped if there is nothing to
/// keep.
Outcome record(Case given, Recording how, const RecordObserver& observer);

}  // namespace dimple
