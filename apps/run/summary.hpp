#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "apps/run/simulate.hpp"
#include "io/error.hpp"

namespace dimple {

// The content of summary.json.

using Json = nlohmann::ordered_json;

/// Indented text with a newline at its end; bytes that are no UTF-8, as in a file's name, are replaced.
std::string as_text(const Json& json);

/// A report as an object with its five parts: code, fact, where, why, remedy.
Json report_json(const Report& report);

/// Summary of a run that began with an image: input, labels and the model's report.
Json summary_of_image(const Scene& scene, const LoadedModel& result);
/// Summary of `dimple model`.
Json summary_of_model(const ModelChoices& choices, const Result& result);

/// Durations of a run that has made its own model, up to its march [s]; `read_s`: before that.
std::vector<std::pair<std::string, double>> times_of(const LoadedModel& result, double read_s);

/// Durations of all parts of a resumed run together [s].
struct RunTimes {
  double solve_s = 0.0, write_s = 0.0, total_s = 0.0;
  std::vector<std::pair<std::string, double>> parts = {};  ///< of the total; the rest is added
};
/// Adds the results of the march. `reason`: why it ended before its depth, or nullptr.
void add_run(Json& summary, const Scene& scene, const Result& result, const RunTimes& times,
             const std::string& status, ExitCode code, const Report* reason);

/// Adds what add_run() reports on the body and its surroundings, for a case without a march.
void add_scene(Json& summary, const Scene& scene, const Result& result);

/// Error of the last force by the image's resolution: half_N and its parts, or why it is unknown.
Json image_error_json(const ImageError& error);

/// Force evaluations of the march.
double evaluations_of(const History& history);
/// Largest error of the energy balance, as a part of the tool's largest work.
double largest_energy_error(const History& history);

}  // namespace dimple
