#include "apps/studies/shift.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "apps/run/images.hpp"
#include "apps/run/report.hpp"
#include "apps/run/result_folder.hpp"
#include "apps/run/results.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/resolve.hpp"
#include "apps/studies/shift_error_bounds.hpp"
#include "apps/studies/shift_page.hpp"
#include "apps/studies/shift_run.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"
#include "io/vtk_files.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

const char* shift_leaves_out =
    "Not modelled: the falx and the tentorium, vessels, drugs and swelling, flow in the tissue, resection, "
    "and adhesion to the skull (no cohesion). Sulci that stay open pass through each other, unless they are "
    "many or --self-contact is on.";
Json json_of(const Vec3& v) {
  return Json::array({v.x(), v.y(), v.z()});
}

// Table of positions and displacements [3xM] mm, with the component along gravity and, if available, the
// error bounds.
Table table_of(const Points& place_mm, const Points& shift_mm, const Vec3& up,
               const ShiftErrorBounds& error_bounds) {
  Table table{.header = {"x_mm", "y_mm", "z_mm", "shift_x_mm", "shift_y_mm", "shift_z_mm", "shift_mm",
                         "along_gravity_mm"},
              .column = std::vector<std::vector<double>>(8)};
  for (Index k = 0; k < place_mm.cols(); ++k) {
    for (Index d = 0; d < 3; ++d) {
      table.column[static_cast<std::size_t>(d)].push_back(place_mm(d, k));
      table.column[static_cast<std::size_t>(d) + 3].push_back(shift_mm(d, k));
    }
    table.column[6].push_back(shift_mm.col(k).norm());
    table.column[7].push_back(-shift_mm.col(k).dot(up));
  }
  if (error_bounds.known()) {
    table.header.push_back("band_mm");
    table.column.emplace_back(static_cast<std::size_t>(place_mm.cols()), error_bounds.half_mm);
  }
  return table;
}

Json json_of(const Points& place_mm, const Points& shift_mm, const Vec3& up, bool with_depth) {
  Json list = Json::array();
  for (Index k = 0; k < place_mm.cols(); ++k) {
    Json one = {{"place_mm", json_of(Vec3(place_mm.col(k)))},
                {"components_mm", json_of(Vec3(shift_mm.col(k)))},
                {"shift_mm", shift_mm.col(k).norm()},
                {"along_gravity_mm", -shift_mm.col(k).dot(up)}};
    if (with_depth) one["depth_mm"] = (place_mm.col(k) - place_mm.col(0)).norm();
    list.push_back(one);
  }
  return list;
}

// Warns of an opening between the vertices of the surface's triangles.
void warn_of_narrow_opening(const RunLog& log, const Shifted& now, const Eigen::Vector4d& opening) {
  const Vec3 at = now.result.model.surface.vertex_mm.col(now.largest_in(opening)), middle = opening.head<3>();
  if (const double away = (at - middle).norm(); away > opening[3])
    log.warn(
        fmt::format("the opening of {} radius is between the vertices of the surface: the shift at the "
                    "opening is that of the nearest vertex, {}, which is {} from its middle",
                    length_in_words(opening[3]), dimple::in_words(at), length_in_words(away)));
}

void warn_of_shift(const RunLog& log, const Shifted& now, double shift_mm) {
  if (now.sweep.inverted > 0)
    log.warn(fmt::format("{} of {} integration points are inverted: do not use the shift there",
                         now.sweep.inverted, now.result.model.point_count()));
  for (std::size_t k = 0; k < now.result.history.walls.size(); ++k) {
    const RigidBody& wall = now.result.loading.walls[k];
    const double in = now.result.history.walls[k].penetration, apart = wall.surface.spacing.mean();
    if (in > 0.15 * apart)
      log.warn(
          fmt::format("the brain's surface penetrates by {} into the wall '{}' between contact points, which "
                      "are {} apart; give more --nodes",
                      length_in_words(1e3 * in), wall.name, length_in_words(1e3 * apart)));
  }
  if (shift_mm < least_measured_mm || shift_mm > most_measured_mm)
    log.warn(fmt::format(
        "the largest shift at the opening, {}, is outside of the measured range of 16 craniotomies, {:g} to "
        "{:g} mm: check the fluid lost, the stiffness, the gap and the fixed part",
        length_in_words(shift_mm), least_measured_mm, most_measured_mm));
}

void write_fields(const fs::path& folder, const Shifted& now) {
  const Model& model = now.result.model;
  const auto field = [](const Points& shift_mm) {
    return Field{.name = "displacement_mm", .unit = "mm", .values = shift_mm};
  };
  write_vtp(folder / "surface.vtp",
            {.position_mm = model.surface.vertex_mm,
             .triangles = model.surface.triangles,
             .fields = {field(now.surface_mm)},
             .even_if_stopped = true},
            0.0);
  const Points u_mm = 1e3 * now.u().topRows<3>();
  write_vtu(folder / "nodes.vtu",
            {.position_mm = 1e3 * model.X, .fields = {field(u_mm)}, .even_if_stopped = true}, 0.0);
}

Json shift_json(const ShiftOptions& options, const ShiftScene& requested, const Scene& scene,
                const Shifted& now, const ShiftErrorBounds& error_bounds) {
  const Index largest = now.largest_in(requested.opening);
  const Vec3 middle = now.at_middle(requested.opening), most = now.surface_mm.col(largest);
  const Points targets = points_of(requested.targets);
  return {{"middle_mm", middle.norm()},
          {"middle_along_gravity_mm", -middle.dot(requested.up)},
          {"largest_at_opening_mm", most.norm()},
          {"along_gravity_mm", -most.dot(requested.up)},
          {"components_mm", json_of(most)},
          {"at_mm", json_of(Vec3(now.result.model.surface.vertex_mm.col(largest)))},
          {"largest_of_all_mm", now.surface_mm.colwise().norm().maxCoeff()},
          {"targets", json_of(targets, now.targets_mm, requested.up, false)},
          {"profile", json_of(now.line, now.line_mm, requested.up, true)},
          {"up", json_of(requested.up)},
          {"fluid_lost", options.fluid_lost},
          {"fluid_level_mm", 1e3 * now.result.loading.loads.fluid->level},
          {"skull", options.skull},
          {"opening_mm",
           {requested.opening[0], requested.opening[1], requested.opening[2], requested.opening[3]}},
          {"mu_Pa", scene.material.mu_Pa},
          {"base", now.result.report.boundary.base_reason},
          {"band", in_words(error_bounds)},
          {"band_mm", error_bounds.known() ? Json(error_bounds.half_mm) : Json()},
          {"left_out", shift_leaves_out}};
}

// Writes the displacements at the targets and along a line into the brain.
void write_tables(const fs::path& folder, const Shifted& now, const ShiftScene& requested,
                  const ShiftErrorBounds& error_bounds) {
  write_csv(folder / "targets.csv",
            table_of(points_of(requested.targets), now.targets_mm, requested.up, error_bounds));
  write_csv(folder / "profile.csv", table_of(now.line, now.line_mm, requested.up, error_bounds));
}

void warp_images(const RunLog& log, const ImageTask& task, const fs::path& folder, Shifted& now,
                 Json& reported) {
  std::vector<int> labels;
  for (const LabelMeasure& label : now.result.labels) labels.push_back(label.value);
  ImageWriter images(task, folder, now.result.model, labels, now.result.cut);
  log.doing("warping images");
  images.keep(
      {.number = 1, .t = 1.0, .depth = 0.0, .u = now.u(), .f = now.f, .forces = now.system->tissue()});
  images.write();
  log.say("images   " + images.reported());
  if (const std::string warning = images.warning(); !warning.empty()) log.warn(warning);
  reported = images.summary();
}

// Command line that repeats the run, with the options that are in no file.
std::string command_of(const ShiftOptions& options, const fs::path& folder) {
  std::vector<std::string> words = {"shift"};
  const auto add = [&](const char* flag, const std::string& value) {
    if (!value.empty()) words.push_back(fmt::format("{}={}", flag, value));  // a value may begin with a minus
  };
  add("--brain", options.brain);
  add("--skull", options.skull);
  add("--opening", options.opening);
  add("--up", options.up);
  add("--fluid-lost", options.fluid_lost);
  add("--gap", options.gap);
  for (const std::string& target : options.target) add("--target", target);
  return run_again(words, folder);
}

std::string title_of(const Scene& scene, const Json& shift) {
  const auto length = [&](const char* key) { return length_in_words(shift[key].get<double>()); };
  return fmt::format("{}: {} at the middle of the opening, {} of it along gravity; largest at the opening {}",
                     fs::path(name_of_image(scene)).filename().string(), length("middle_mm"),
                     length("middle_along_gravity_mm"), length("largest_at_opening_mm"));
}

// Headline of a shift: "shift at the middle of the opening 8.51 mm (6.0 to 11.0 mm), 8.40 mm of it along
// gravity; largest at the opening 10.00 mm".
std::string headline_of(const Json& shift, const ShiftErrorBounds& error_bounds) {
  const auto length = [&](const char* key) { return length_in_words(shift[key].get<double>()); };
  const double middle = shift["middle_mm"];
  return fmt::format(
      "shift at the middle of the opening {}{}, {} of it along gravity; largest at the opening {}{}",
      length("middle_mm"),
      error_bounds.known()
          ? fmt::format(" ({:.1f} to {:.1f} mm)", std::max(0.0, middle - error_bounds.half_mm),
                        middle + error_bounds.half_mm)
          : "",
      length("middle_along_gravity_mm"), length("largest_at_opening_mm"),
      error_bounds.known() ? "" : "; error " + in_words(error_bounds));
}

Json times_json(const Shifted& now, double comparing_s, double images_s, double pictures_s, double total_s) {
  const Result& result = now.result;
  const double surface_s = result.stages.seconds("close gaps") + result.stages.seconds("surface");
  Json parts = {{"reading", result.read_s},
                {"surface", surface_s},
                {"cloud", std::max(0.0, result.build_s - surface_s)},
                {"supports and walls", result.complete_s},
                {"solving", now.solve_s},
                {"band", comparing_s},
                {"images", images_s},
                {"pictures and tables", pictures_s}};
  double remaining_s = total_s;
  for (const auto& [name, s] : parts.items()) remaining_s -= s.get<double>();
  parts["starting and ending"] = std::max(0.0, remaining_s);
  return parts;
}

}  // namespace

Outcome shift(const Description& described, const ShiftOptions& options, const fs::path& folder,
              Existing existing, const RecordObserver& observer) {
  const Stopwatch whole;
  const Scene scene = resolve(described);
  const ShiftScene requested = scene_of(options);
  ResultFolder results(folder, existing);
  const ImageTask task = requested_images(scene);
  Shifted now;
  const RunObserver hears{.line = observer.line, .part = observer.part};
  const RunLog log{hears, now.result};
  find_equilibrium(
      scene, requested,
      {.observer = hears, .placed = [&](const Discretisation& places) { require_overlap(task, places); }},
      now);
  Result& result = now.result;
  for (std::size_t k = 0; k < result.history.walls.size(); ++k)
    log.say("wall     " + in_words(result.loading.walls[k].name, result.history.walls[k]));

  const Stopwatch comparing;
  const ShiftErrorBounds error_bounds = error_bounds_of_shift(scene, requested, now);
  const double comparing_s = comparing.seconds();
  const bool tables_alone = options.tables_alone || error_bounds.stopped;

  results.prepare();
  write_fields(folder, now);
  write_tables(folder, now, requested, error_bounds);
  Json images;
  const Stopwatch warping;
  if (!tables_alone) warp_images(log, task, folder, now, images);
  const double images_s = warping.seconds();
  const Stopwatch drawing;
  Json summary = summary_of_image(scene, result);
  summary["status"] = error_bounds.stopped ? "interrupted" : "finished";
  summary["version"] = DIMPLE_VERSION;
  Json reported = shift_json(options, requested, scene, now, error_bounds);
  warn_of_narrow_opening(log, now, requested.opening);
  warn_of_shift(log, now, reported["largest_at_opening_mm"]);
  const std::vector<std::string> assumed = assumptions_of(described, options);
  log.say("assumed  " + fmt::format("{}", fmt::join(assumed, "; ")));
  reported["assumed"] = assumed;
  log.say(std::string("shift    ") + shift_leaves_out);
  add_scene(summary, scene, result);
  summary["images"] = images;
  const std::string options_text = to_toml(described, result.chosen);
  write_file(folder / "config.resolved.toml", options_text);
  Json page;
  if (!tables_alone) {
    std::string pictured;
    const std::string picture =
        before_and_after(now, requested, scene, task, folder, title_of(scene, reported), pictured);
    reported["pictured"] = pictured;
    write_file(folder / "overview.png", picture);
    page = page_of_shift(now, requested, scene, options_text, command_of(options, folder), picture);
  }
  summary["shift"] = reported;
  summary["solve_wall_s"] = now.solve_s;
  summary["total_wall_s"] = whole.seconds();
  summary["parts_wall_s"] = times_json(now, comparing_s, images_s, drawing.seconds(), whole.seconds());
  summary["warnings"] = result.warnings;
  Outcome outcome;
  outcome.interrupted = error_bounds.stopped;
  outcome.summary_json = as_text(summary);
  if (!tables_alone) write_report(folder / "report.html", summary, page);
  write_file(folder / "summary.json", outcome.summary_json);
  outcome.headline = headline_of(reported, error_bounds);
  return outcome;
}

}  // namespace dimple
