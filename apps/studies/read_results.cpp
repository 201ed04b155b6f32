#include "apps/studies/read_results.hpp"

#include <fmt/format.h>

#include <cmath>
#include <set>

#include "apps/run/result_folder.hpp"
#include "apps/scene/description.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/text.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const std::string& fact, const std::string& where, const std::string& why,
                         const std::string& remedy) {
  throw InputError({.fact = fact, .where = where, .why = why, .remedy = remedy});
}

// Summary of a folder; not an object if the file is not JSON.
Json summary_of(const fs::path& folder) {
  return Json::parse(read_small_file(folder / "summary.json"), nullptr, false);
}

// Part of a summary as a field of a table.
std::string field(const Json& json, std::initializer_list<const char*> names) {
  const Json* at = part_of(json, names);
  if (!at) return {};
  if (at->is_string()) return at->get<std::string>();
  if (at->is_number_integer()) return std::to_string(at->get<std::int64_t>());
  return at->is_number() ? shortest(at->get<double>()) : "";
}

Report failure_of(const Json& summary) {
  const auto say = [&](const char* name) { return field(summary, {"failure", name}); };
  return {.fact = say("fact"),
          .where = say("where"),
          .why = say("why"),
          .remedy = say("remedy"),
          .code = say("code")};
}

Json finished_summary(const fs::path& folder, const std::string& name) {
  const std::string remedy = "give a folder written by `dimple run -o`";
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored))
    refuse(fmt::format("there is no folder {}", name), "command line", "a run's results are a folder",
           remedy);
  if (!fs::is_regular_file(folder / "summary.json", ignored)) {
    if (fs::exists(folder / checkpoint_file, ignored))
      refuse(fmt::format("the run in {} is not finished", name), name,
             "it has left a checkpoint and no summary.json", "end it with --resume, then compare");
    refuse(fmt::format("{} holds no run", name), name, "there is no summary.json in it", remedy);
  }
  const Json summary = summary_of(folder);
  const Json* ended = part_of(summary, {"status"});
  if (!ended || !ended->is_string())
    refuse(fmt::format("{} holds no run", name), (fs::path(name) / "summary.json").string(),
           "its summary.json has no status", remedy);
  const std::string status = *ended;
  if (status != "finished")
    refuse(fmt::format("the run in {} is not finished", name), (fs::path(name) / "summary.json").string(),
           fmt::format("its status is '{}', and its curve may be incomplete", printable(status)),
           "run it to its end, then compare");
  for (const char* key : {"force_N", "indentation_mm"})
    if (const Json* number = part_of(summary, {key}); !number || !number->is_number())
      refuse(fmt::format("{} holds no run", name), (fs::path(name) / "summary.json").string(),
             fmt::format("its summary.json has no {}", key), remedy);
  if (summary.contains("scene"))
    refuse(fmt::format("the run in {} is a scene of steps", name), (fs::path(name) / "summary.json").string(),
           "its tool moves back or sideways, so the force at a depth is not unique",
           "compare the ends of the steps in `scene` of each summary.json");
  return summary;
}

void read_curve(const fs::path& folder, FinishedRun& run) {
  const std::string where = (fs::path(run.folder) / "force.csv").string();
  const Table table = force_table_in(folder);
  const auto* depth = table.find("indentation_mm");
  const auto* force = table.find("force_N");
  const auto* high = table.find("high_N");
  if (!depth || !force)
    refuse("the force curve cannot be read", where, "it has no columns indentation_mm and force_N",
           "run the scene again with --force");
  for (std::size_t k = 0; k < table.rows(); ++k) {
    if ((*depth)[k] <= 0.0) continue;
    if (!run.curve.empty() && (*depth)[k] <= 1e3 * run.curve.back().depth) continue;  // a dwell
    run.curve.push_back({0.0, 1e-3 * (*depth)[k], (*force)[k], 0.0});
    if (high) run.half.push_back((*high)[k] - (*force)[k]);
  }
  const double last = table.rows() > 0 ? force->back() : 0.0, reported = run.summary.at("force_N");
  if (run.curve.empty() || std::abs(last - reported) > 1e-9 * std::abs(reported))
    refuse(fmt::format("the files in {} are not of one run", run.folder), where,
           "its last force is not that of summary.json", "run the scene again with --force");
}

// Reads the cut area and stored energy, from which the energy released by a cut follows.
void read_energy(const fs::path& folder, FinishedRun& run) {
  if (const Json* area = part_of(run.summary, {"model", "cut", "area_mm2"}); area && area->is_number())
    run.cut_area = 1e-6 * area->get<double>();
  std::error_code ignored;
  if (!fs::is_regular_file(folder / "energy.csv", ignored)) return;
  const Table table = read_csv(folder / "energy.csv");
  if (const auto* stored = table.find("stored_J"); stored && !stored->empty()) run.stored = stored->back();
}

void take_failure(const Report& report, CollectedCase& one) {
  one.code = report.code;
  one.fact = report.fact;
  one.where = report.where;
  one.remedy = report.remedy;
}

std::string labels_in(const Json& summary) {
  std::string text;
  if (!summary.contains("labels") || !summary.at("labels").is_array()) return text;
  for (const Json& label : summary.at("labels")) {
    const std::string name = field(label, {"name"});
    text += (text.empty() ? "" : "; ") + field(label, {"value"}) + (name.empty() ? "" : " " + name);
  }
  return text;
}

// Value of a column at a depth, interpolated between rows or between rest and the first row; empty if the
// rows end before.
std::string between_rows(const std::vector<double>& depth, const std::vector<double>& value, double at) {
  for (std::size_t k = 0; k < depth.size(); ++k) {
    const double rounding = 1e-9 * at;  // depths were converted from metres
    if (depth[k] < at - rounding) continue;
    if (depth[k] <= at + rounding) return shortest(value[k]);
    const double before = k > 0 ? depth[k - 1] : 0.0, first = k > 0 ? value[k - 1] : 0.0;
    return shortest(first + (value[k] - first) * (at - before) / (depth[k] - before));
  }
  return {};
}

std::vector<CollectedCase::Force> forces_at(const fs::path& folder, const std::vector<double>& depths_mm) {
  std::vector<CollectedCase::Force> forces(depths_mm.size());
  const Table table = force_table_in(folder);
  const std::vector<double>* depth = table.find("indentation_mm");
  if (!depth) return forces;
  constexpr std::array columns = {"force_N", "low_N", "high_N"};
  for (std::size_t c = 0; c < columns.size(); ++c)
    if (const std::vector<double>* value = table.find(columns[c]))
      for (std::size_t d = 0; d < depths_mm.size(); ++d)
        forces[d][c] = between_rows(*depth, *value, depths_mm[d]);
  return forces;
}

void read_summary(const fs::path& folder, const std::vector<double>& depths_mm, CollectedCase& one) {
  const Json summary = summary_of(folder);
  if (!summary.is_object())
    refuse("summary.json is damaged", (folder / "summary.json").string(), "it is no JSON object",
           "run the case again with --force");
  one.status = field(summary, {"status"});
  take_failure(failure_of(summary), one);
  one.image = field(summary, {"image"});
  one.labels = labels_in(summary);
  one.volume_mm3 = field(summary, {"volume_mm3"});
  if (summary.contains("material") && summary.at("material").is_array() && !summary.at("material").empty())
    one.mu_Pa = field(summary.at("material").front(), {"mu_Pa"});
  one.indentation_mm = field(summary, {"indentation_mm"});
  one.force = {field(summary, {"force_N"}), field(summary, {"band", "low_N"}),
               field(summary, {"band", "high_N"})};
  for (std::size_t k = 0; const char* key : {"force_N", "indentation_mm", "step"})
    one.largest[k++] = field(summary, {"largest_force", key});
  // The force at rest is no result of a run that found no equilibrium.
  if (one.status == "failed" && one.indentation_mm == "0") one.indentation_mm = one.force[0] = "";
  one.total_s = field(summary, {"total_wall_s"});
  one.nodes = field(summary, {"counts", "nodes"});
  if (summary.contains("warnings") && summary.at("warnings").is_array())
    one.warnings = std::to_string(summary.at("warnings").size());
  one.version = field(summary, {"version"});
  const std::string diameter = field(summary, {"counts", "circle_diameter_mm"});
  one.tool = field(summary, {"tool", "words"});
  if (one.tool.empty() && !diameter.empty())
    one.tool = fmt::format("a contact patch of {} mm diameter", diameter);
  if (!depths_mm.empty() && !one.force[0].empty()) one.at_depth = forces_at(folder, depths_mm);
}

CollectedCase case_in(const fs::path& folder, const std::vector<double>& depths_mm) {
  std::error_code ignored;
  CollectedCase one;
  one.id = folder.filename().string();
  try {
    if (fs::exists(folder / "summary.json", ignored)) {
      read_summary(folder, depths_mm, one);
    } else if (fs::is_directory(folder, ignored)) {
      one.status = "unfinished";
      one.fact = "the run is not finished";
      one.remedy = "start the batch again: it continues from there";
    } else {
      one.status = "missing";
      one.fact = "the case has not been run";
      one.remedy = "start the batch again";
    }
  } catch (const Stopped&) {
    throw;
  } catch (const Error& error) {
    one.status = "failed";
    take_failure(error.report, one);
  }
  one.at_depth.resize(depths_mm.size());
  one.picture = fs::exists(folder / "overview.png", ignored);
  one.report = fs::exists(folder / "report.html", ignored);
  return one;
}

}  // namespace

const Json* part_of(const Json& summary, std::initializer_list<const char*> names) {
  const Json* at = &summary;
  for (const char* name : names) {
    if (!at->is_object() || !at->contains(name)) return nullptr;
    at = &at->at(name);
  }
  return at;
}

std::optional<Report> failure_in(const fs::path& folder, int exit_code) try {
  const Json summary = summary_of(folder);
  // A different code is from an older run, as not every failure can write there.
  if (field(summary, {"exit_code"}) != std::to_string(exit_code) || !part_of(summary, {"failure"}))
    return std::nullopt;
  return failure_of(summary);
} catch (const std::exception&) {
  return std::nullopt;
}

std::string read_small_file(const fs::path& file) {
  require_regular_file(file);
  if (fs::file_size(file) > most_bytes_of_text)
    refuse(fmt::format("{} is larger than {} MB", file.filename().string(), most_bytes_of_text / 1'000'000),
           file.string(), "no run writes a file of this size", "run the case again with --force");
  return read_file(file);
}

Table force_table_in(const fs::path& folder) {
  require_regular_file(folder / "force.csv");
  return read_csv(folder / "force.csv");
}

FinishedRun read_finished_run(const std::string& given) {
  const fs::path folder = given;
  FinishedRun run;
  run.folder = printable(given);
  run.summary = finished_summary(folder, run.folder);
  run.options = option_values_in(folder / "config.resolved.toml");
  run.contacting = part_of(run.summary, {"tool", "contact_samples"}) != nullptr;
  read_curve(folder, run);
  read_energy(folder, run);
  if (run.half.empty()) {
    const Json* unknown = part_of(run.summary, {"band", "unknown"});
    run.no_error_bounds = unknown && unknown->is_string() ? printable(unknown->get<std::string>())
                                                          : "force.csv has no column high_N";
  }
  for (const Json* image : {part_of(run.summary, {"image_sha256"}),
                            part_of(run.summary, {"made_from", "image_sha256"})})  // of `dimple solve`
    if (image && image->is_string()) run.image_sha256 = *image;
  return run;
}

std::vector<CollectedCase> collect(const fs::path& out, const std::vector<double>& depths_mm,
                                   const std::vector<std::string>& expected) {
  std::error_code error;
  if (!fs::is_directory(out, error))
    refuse(fmt::format("there is no folder {}", out.string()), "command line",
           "the cases of a batch are folders in one", "give a folder written by `dimple batch -o`");
  std::set<std::string> ids(expected.begin(), expected.end());
  for (const auto& entry : fs::directory_iterator(out)) {
    stop_if_requested();
    if (fs::exists(entry.path() / "summary.json", error) || fs::exists(entry.path() / checkpoint_file, error))
      ids.insert(entry.path().filename().string());
  }
  if (ids.empty())
    refuse(fmt::format("{} holds no case", out.string()), "command line",
           "no folder in it has a summary.json", "give a folder written by `dimple batch -o`");
  std::vector<CollectedCase> cases;
  for (const std::string& id : ids) {
    stop_if_requested();
    cases.push_back(case_in(out / id, depths_mm));
  }
  return cases;
}

}  // namespace dimple
