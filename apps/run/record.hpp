#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "apps/run/result_folder.hpp"
#include "apps/run/results.hpp"
#include "apps/run/simulate.hpp"
#include "apps/scene/description.hpp"

namespace dimple {

/// Result of a command, for people and programs.
struct Outcome {
  std::string summary_json;  ///< as in summary.json
  std::string headline;      ///< one line: the force, and the place of the pictures
  std::string further = {};  ///< one more: the requested displacement
  bool interrupted = false;
  std::string ended_by = {};                               ///< place and reason, if interrupted
  std::vector<std::pair<std::string, double>> times = {};  ///< durations by part [s]
};

/// Callbacks during a run. `progress`: part of the load done, in [0, 1], and a few words.
struct RecordObserver {
  std::function<void(RunObserver::Line, const std::string&)> line = {};
  std::function<void(Part, const Work&)> part = {};
  std::function<void(double fraction, const std::string& state)> progress = {};
  std::function<void(const Frame&)> frame = {};
  std::function<void()> after_cut = {};  ///< of a step: later frames belong to another model
  /// Called when all is written, also after a stop, to continue the run in memory.
  std::function<void(Result&)> result = {};
  double waited_s = 0.0;  ///< before this, by the program: loading libraries, reading options

  void report_to(RunObserver::Line kind, const std::string& text) const {
    if (line) line(kind, text);
  }
};

// simulate() with its results written to a folder at once: frames, tables, picture, summary, and at intervals
// a checkpoint from which to resume. Each function throws Error; Stopped too if there is nothing to keep.

/// Run from the image to the force curve. `image`, if given, replaces the file of image.file.
Outcome record_run(const Description& options, const std::filesystem::path& folder, Existing existing,
                   const RecordObserver& observer = {}, const LabelImage* image = nullptr);
/// Run from a model's files.
Outcome record_solve(const Description& options, const std::filesystem::path& model,
                     const std::filesystem::path& folder, Existing existing,
                     const RecordObserver& observer = {});
/// Writes a model's files from the image.
Outcome record_model(const Description& options, const std::filesystem::path& folder, Existing existing,
                     const RecordObserver& observer = {});

/// Adds the comparison after a run to its summary and page: time, chart of what the force depends on, and
/// end. `ended_by`: what stopped it, or nothing. Throws OutputError.
void add_explained(Outcome& outcome, const std::filesystem::path& folder, double seconds,
                   const std::string& ended_by);

}  // namespace dimple
