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

/// What a command has come to, for people and programs.
struct Outcome {
  std::string summary_json;  ///< what summary.json holds
  std::string headline;      ///< one line: the force, and where the pictures are
  std::string further = {};  ///< another: the displacement that was asked for
  bool interrupted = false;
  std::string ended_by = {};                               ///< where and by what, if it was
  std::vector<std::pair<std::string, double>> times = {};  ///< where the time went [s]
};

/// What is heard while it goes, beside the lines: how far the march has come, in [0, 1], and a few words.
struct RecordObserver {
  std::function<void(RunObserver::Line, const std::string&)> line = {};
  std::function<void(Part, const Work&)> part = {};
  std::function<void(double share, const std::string& state)> progress = {};
  std::function<void(const Frame&)> frame = {};
  std::function<void()> after_cut = {};  ///< of a step: frames are of another model from then on
  /// When all is written, also of a march that was stopped: for who goes on with it in memory.
  std::function<void(Result&)> result = {};
  double waited_s =
      0.0;  ///< before this, by who started the program: libraries were loaded, options were read

  void tell(RunObserver::Line kind, const std::string& text) const {
    if (line) line(kind, text);
  }
};

// simulate() with its results written to a folder as they come: frames, tables, picture, summary, and now and
// then a checkpoint to go on from. Each throws Error; Stopped too if there is nothing to keep.

/// From the image to the force curve. `image`, if given, stands for the file that image.file names.
Outcome record_run(const Description& options, const std::filesystem::path& folder, Existing existing,
                   const RecordObserver& observer = {}, const LabelImage* image = nullptr);
/// From a model's files.
Outcome record_solve(const Description& options, const std::filesystem::path& model,
                     const std::filesystem::path& folder, Existing existing,
                     const RecordObserver& observer = {});
/// From the image to a model's files.
Outcome record_model(const Description& options, const std::filesystem::path& folder, Existing existing,
                     const RecordObserver& observer = {});

/// What came of a run after its summary had been written, for so long, is in the summary and on the page too:
/// the chart of what the force depends on, and how it ended. `ended_by`: what stopped it, or nothing. Throws
/// OutputError.
void add_explained(Outcome& outcome, const std::filesystem::path& folder, double seconds,
                   const std::string& ended_by);

}  // namespace dimple
