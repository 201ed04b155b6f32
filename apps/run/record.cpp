#include "apps/run/record.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "apps/run/headline.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/recorder.hpp"
#include "apps/run/report.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/scene/resolve.hpp"
#include "apps/scene/tool_words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Line = RunObserver::Line;

// Outcome of an earlier run that has finished with the same image or model and the same options. Throws
// UsageError: it was another run.
Outcome finished_already(const fs::path& folder, const Scene& scene, const std::string& input_key,
                         const RunIdentity& identity, const RecordObserver& observer) {
  Outcome outcome;
  outcome.summary_json = read_file(folder / "summary.json", most_bytes_of_text);
  auto before = option_values_in(folder / "config.resolved.toml");
  const Json summary = Json::parse(outcome.summary_json, nullptr, false);
  // Number of nodes that folds or the tool required, and not the user.
  const Index for_error_bounds = summary.value("model", Json::object()).value("nodes_for_band", Index{0});
  if (!scene.given.nodes && std::to_string(for_error_bounds) == before["cloud.nodes"])
    before["cloud.nodes"] = identity.options.at("cloud.nodes");
  require_same_run({summary.value("version", ""), before, summary.value(input_key, "")}, identity);
  std::error_code ignored;
  fs::remove(folder / checkpoint_file, ignored);  // left if the run was killed after its last file
  remove_temporaries_in(folder);
  const Json error_bounds = summary.value("band", Json::object());
  const double force = summary.value("force_N", 0.0);
  const std::string unknown = error_bounds.value("unknown", "");
  const std::optional<double> half =
      unknown.empty() ? std::optional(error_bounds.value("half_N", 0.0)) : std::nullopt;
  const Json largest = summary.value("largest_force", Json());
  const std::string title =
      largest.is_object() ? scene_title(largest.value("force_N", 0.0), largest.value("indentation_mm", 0.0),
                                        largest.value("step", ""), force, half)
                          : force_title(force, summary.value("indentation_mm", 0.0), half);
  outcome.headline = headline_of(title, force, unknown, summary.value("image_error", Json::object()),
                                 scene.material.mu_spread);
  if (summary.contains("displacement")) outcome.further = displacement_title(summary["displacement"]);
  observer.report_to(Line::said,
                     fmt::format("resume   {} holds the finished run: nothing to do", folder.string()));
  return outcome;
}

// Checkpoint to resume in the folder, if any. Throws UsageError: it was another run.
std::optional<Checkpoint> resumed_in(const ResultFolder& folder, const RunIdentity& identity) {
  if (!folder.resumable()) return std::nullopt;
  Checkpoint checkpoint = read_checkpoint(folder.path() / checkpoint_file);
  require_same_run(checkpoint.run, identity);
  return checkpoint;
}

// Reads the measured curve before anything is computed, so that its errors are reported first.
std::optional<MeasuredCurve> compared_curve(const Scene& scene) {
  const std::string& name = scene.output.compare;
  if (name.empty()) return std::nullopt;
  if (name != paper_word) return read_measured_curve(name);
  return paper_curve();
}

}  // namespace

Outcome record_run(const Description& options, const fs::path& folder, Existing existing,
                   const RecordObserver& observer, const LabelImage* image) {
  const Stopwatch whole(observer.waited_s);
  const Scene scene = resolve(options);
  check_pairs(scene, Feature::run);
  ResultFolder results(folder, existing);
  RunIdentity identity{DIMPLE_VERSION, option_values(options), ""};
  Recording how{.folder = folder,
                .options = options,
                .identity = identity,
                .compared = compared_curve(scene),
                .images = requested_images(scene),
                .whole = whole};
  if (existing == Existing::resume && !scene.image.file.empty() &&
      (results.finished() || results.resumable())) {
    identity.input_sha256 = sha256_of_file(scene.image.file);
    if (results.finished()) return finished_already(folder, scene, "image_sha256", identity, observer);
    how.resumed = resumed_in(results, identity);
  }
  how.write_model = [&](const Result& result) {
    results.prepare();
    const Requested requested = result.history.interrupted ? tables_alone : requested_by(scene);
    if (requested.model)
      write_model(folder / "model", result.model, result.model.scheme, result.provenance,
                  result.facing_fraction);
    if (requested.label) write_vti(folder / "label.vti", result.image);
  };
  how.summary = [&](const Result& result) { return summary_of_image(scene, result); };
  how.facts = [](const Result& result) {
    const ModelReport& report = result.report;
    const Model& model = result.model;
    return std::vector<std::string>{
        fmt::format("{}; {}; {} integration points", volume_in_words(result.segment.voxel_volume_mm3),
                    nodes_in_words(model.node_count(), report), model.point_count()),
        fmt::format("base: {} nodes, {}", model.base.size(), report.boundary.base_reason),
        result.loading.indenter
            ? fmt::format("tool: {}, its tip at first contact at {}, {}",
                          in_words(result.loading.indenter->shape),
                          in_words(1e3 * result.loading.indenter->pose.tip), report.boundary.patch_reason)
            : fmt::format("contact patch: {} nodes at {}, {}", report.patch_nodes,
                          in_words(model.tool.centre * 1e3), report.boundary.patch_reason)};
  };
  how.subject = fs::path(name_of_image(scene)).filename().string();
  if (!image) how.command = {"run"};
  return record({.scene = scene, .image = image, .error_bounds = scene.error_bounds}, std::move(how),
                observer);
}

void add_explained(Outcome& outcome, const fs::path& folder, double seconds, const std::string& ended_by) {
  if (!ended_by.empty()) {
    outcome.interrupted = true;
    outcome.ended_by = ended_by + "; explain.md has the comparisons made before";
  }
  Json summary = Json::parse(outcome.summary_json);
  outcome.times.emplace_back("comparing", seconds);
  Json& parts = summary["parts_wall_s"];
  const double before_s = parts.is_object() ? parts.value("comparing", 0.0) : 0.0;  // from a finished run
  parts["comparing"] = seconds;
  summary["total_wall_s"] = summary["total_wall_s"].get<double>() + seconds - before_s;
  if (outcome.interrupted) end_otherwise(summary, Stopped(stop_requested()));
  outcome.summary_json = as_text(summary);
  amend_report(folder / "report.html", summary, read_file(folder / "explain.svg"));
  write_file(folder / "summary.json", outcome.summary_json);
}

Outcome record_solve(const Description& options, const fs::path& model, const fs::path& folder,
                     Existing existing, const RecordObserver& observer) {
  const Stopwatch whole(observer.waited_s), reading;
  fs::path model_folder = fs::is_directory(model) ? model : model.parent_path();
  if (model_folder.empty()) model_folder = ".";
  const Scene scene = resolve(options);
  check_pairs(scene, Feature::solve);
  ResultFolder results(folder, existing, model_folder);
  Case given{.scene = scene, .model = read_model(model)};
  const ModelFiles& files = *given.model;
  Recording how{
      .folder = folder,
      .options = options,
      .identity = {DIMPLE_VERSION, option_values(options), sha256_of_model(files.places, files.scheme)},
      .compared = compared_curve(scene),
      .images = requested_images(scene),
      .read_s = reading.seconds(),
      .whole = whole};
  if (existing == Existing::resume && results.finished())
    return finished_already(folder, scene, "model_sha256", how.identity, observer);
  how.resumed = resumed_in(results, how.identity);
  how.write_model = [&](const Result&) {
    results.prepare();
    const fs::path label = model_folder / "label.vti";
    if (requested_by(scene).label && fs::exists(label) && !fs::equivalent(folder, model_folder))
      write_file(folder / "label.vti", read_file(label));
  };
  how.summary = [&, sha256 = how.identity.input_sha256](const Result&) {
    Json summary;
    summary["made_from"] = files.provenance;
    summary["model_sha256"] = sha256;
    return summary;
  };
  how.facts = [&](const Result&) {
    std::vector<std::string> facts;
    for (const char* key : {"image", "base", "circle"})
      if (const auto found = files.provenance.find(key); found != files.provenance.end())
        facts.push_back(fmt::format("{}: {}", key, found->second));
    return facts;
  };
  how.subject = model.filename().string();
  how.command = {"solve", model.string()};
  given.error_bounds = true;  // it then reports why there is none
  return record(given, std::move(how), observer);
}

Outcome record_model(const Description& options, const fs::path& folder, Existing existing,
                     const RecordObserver& observer) {
  const Stopwatch whole;
  const Scene scene = resolve(options);
  check_pairs(scene, Feature::model);
  ResultFolder results(folder, existing);
  Result result;
  build_case({.scene = scene}, {.line = observer.line, .part = observer.part}, result);
  stop_if_requested();
  const double before_writing_s = whole.seconds();
  observer.report_to(Line::doing, "writing the model");
  results.prepare();
  write_vti(folder / "label.vti", result.image);
  write_model(folder, result.model, result.model.scheme, result.provenance, result.facing_fraction);
  auto times = times_of(result, 0.0);
  times.emplace_back("writing", whole.seconds() - before_writing_s);
  return {.summary_json = as_text(summary_of_model(scene, result)),
          .headline = fmt::format("{} nodes, {} integration points", result.model.node_count(),
                                  result.model.point_count()),
          .times = std::move(times)};
}

}  // namespace dimple
