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

/// What differs between a run from an image and one from a model's files.
struct Recording {
  std::filesystem::path folder;
  Description options;  ///< of which the folder gets a file
  RunIdentity identity;
  std::optional<Checkpoint> resumed = {};
  /// Nothing is written before the model and the load are accepted.
  std::function<void(const Result&)> write_model = {};
  std::function<Json(const Result&)> summary = {};                    ///< what it begins with
  std::function<std::vector<std::string>(const Result&)> facts = {};  ///< for the picture
  std::string subject = {};
  std::vector<std::string> command = {};     ///< what repeats it; none: its image is in memory alone
  std::optional<MeasuredCurve> beside = {};  ///< what the force is compared with
  ImageTask images = {};
  double read_s = 0.0;  ///< before simulate()
  Stopwatch whole = {};
};

/// simulate() with what comes of it written to the folder as it comes. Throws Error; Stopped if there is
/// nothing to keep.
Outcome record(Case given, Recording how, const RecordObserver& observer);

}  // namespace dimple
