#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

#include "apps/run/simulate.hpp"
#include "io/error.hpp"

namespace dimple {

// What summary.json holds.

using Json = nlohmann::ordered_json;

/// Indented, with a newline at its end; what is no UTF-8 (a file's name may be none) is replaced.
std::string as_text(const Json& json);

/// A report as an object with its five parts: code, fact, where, why, remedy.
Json report_json(const Report& report);

/// Of a run that began with an image: what was taken from it, and the model's report.
Json summary_of_image(const Scene& scene, const LoadedModel& result);
/// Of `dimple model`.
Json summary_of_model(const ModelChoices& choices, const Result& result);

/// [s] Where the time of a run went that has made its own model, up to its march; `read_s`: before that.
std::vector<std::pair<std::string, double>> times_of(const LoadedModel& result, double read_s);

/// [s] Of all parts of a run that was resumed together.
struct RunTimes {
  double solve_s = 0.0, write_s = 0.0, total_s = 0.0;
  std::vector<std::pair<std::string, double>> parts = {};  ///< where the total went; what they lack is added
};
/// Adds what came of the march. `reason`: why it ended before its depth, or nullptr.
void add_run(Json& summary, const Scene& scene, const Result& result, const RunTimes& times,
             const std::string& status, ExitCode code, const Report* reason);

/// What add_run() says of the body and of what surrounds it, of a case without a march.
void add_scene(Json& summary, const Scene& scene, const Result& result);

/// What the image's resolution leaves open of the last force: half_N and its parts, or why it is unknown.
Json image_error_json(const ImageError& error);

/// Force evaluations of the march.
double evaluations_of(const History& history);
/// Largest imbalance of the energies, as a part of the largest work of the tool.
double largest_energy_error(const History& history);

}  // namespace dimple
