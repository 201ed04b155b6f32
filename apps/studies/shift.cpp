#include "apps/studies/shift.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "apps/run/folds.hpp"
#include "apps/run/images.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/membranes.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/other_tools.hpp"
#include "apps/run/pipeline.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"
#include "io/vtk_files.hpp"
#include "preprocess/scene/sides.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr const char* skull_name = "skull";
constexpr double usual_gap_mm = 2.0;    // where a skull is derived and nobody says one
constexpr double usual_mu_Pa = 1000.0;  // of brain, where no material is given
constexpr double usual_nodes = 4000;
constexpr double usual_close_mm = 4.0;  // sulci narrower than this hold together
constexpr double held_share = 0.15;     // of the brain's smallest extent, and at most that
constexpr double held_depth_mm = 20.0;  // of the brain's lowest part
constexpr double finest_mm = 5.0;       // spacing of the nodes around the opening
constexpr double fold_reach_mm = 5.0;   // half of the widest gap that is watched with --self-contact
constexpr double profile_step_mm = 5.0;
constexpr double least_shift_mm = 2.5, most_shift_mm = 21.0;  // published: 16 craniotomies, PMC4834281

[[noreturn]] void refuse_shift(const std::string& flag, const std::string& fact, const std::string& why,
                               const std::string& remedy) {
  throw UsageError({.fact = fact, .where = flag, .why = why, .remedy = remedy});
}

std::vector<double> numbers_of_shift(const std::string& text, const std::string& flag, std::size_t count,
                                     const std::string& what) {
  std::vector<double> numbers;
  set_value({.key = flag, .value = &numbers, .least = -1e6, .most = 1e6, .help = what}, text, flag);
  if (numbers.size() != count)
    refuse_shift(flag, fmt::format("'{}' has {} numbers", text, numbers.size()), "it is " + what,
                 fmt::format("give {} numbers, separated by commas", count));
  return numbers;
}

Eigen::Vector4d opening_of(const ShiftOptions& options) {
  const auto n = numbers_of_shift(options.opening, "--opening", 4, "x,y,z,radius in mm, LPS");
  if (!(n[3] > 0.0))
    refuse_shift("--opening", "the opening has no radius", "nothing would be open",
                 "give x,y,z,radius in mm");
  return {n[0], n[1], n[2], n[3]};
}

Vec3 up_of(const ShiftOptions& options) {
  if (const auto side = side_named(options.up)) return *side;
  const auto n = numbers_of_shift(options.up, "--up", 3, "a side, such as anterior, or x,y,z, LPS");
  const Vec3 up(n[0], n[1], n[2]);
  if (!(up.norm() > 0.0))
    refuse_shift("--up", "three zeros are no direction", "gravity acts against it", "give a side, or x,y,z");
  return up.normalized();
}

double gap_of(const ShiftOptions& options) {
  double gap = usual_gap_mm;
  if (!options.gap.empty())
    set_value({.key = "--gap", .unit = "mm", .value = &gap, .most = 100.0, .help = "a gap"}, options.gap,
              "--gap");
  return gap;
}

std::vector<Vec3> targets_of(const ShiftOptions& options) {
  std::vector<Vec3> targets;
  for (const std::string& one : options.target) {
    const auto n = numbers_of_shift(one, "--target", 3, "x,y,z in mm, LPS");
    targets.emplace_back(n[0], n[1], n[2]);
  }
  return targets;
}

// What is asked for lies on or in the brain, before anything expensive is done.
void require_on_brain(const Organ& organ, const Eigen::Vector4d& opening, const std::vector<Vec3>& targets) {
  const BodySurface& surface = organ.body->surface;
  const auto closest = [&](const Vec3& place) {
    return surface.closest(surface.to_world().inverse() * place);
  };
  const auto nearest = closest(opening.head<3>());
  if (nearest.distance > opening[3])
    throw UsageError(
        {.fact = fmt::format("the opening at {} is {} from the brain's surface",
                             dimple::in_words(Vec3(opening.head<3>())), length_in_words(nearest.distance)),
         .where = "--opening",
         .why = fmt::format("nothing of the brain lies in it; the nearest place is {}",
                            dimple::in_words(surface.to_world() * nearest.place)),
         .remedy = "give a place on the brain's surface, in LPS mm; 3D Slicer's coordinates are RAS"});
  for (const Vec3& target : targets)
    if (!surface.contains(surface.to_world().inverse() * target))
      throw UsageError(
          {.fact = fmt::format("the target {} lies outside of the brain", dimple::in_words(target)),
           .where = "--target",
           .why = fmt::format("its surface is {} away", length_in_words(closest(target).distance)),
           .remedy = "give a place of the brain at rest, in LPS mm"});
}

// Nodes are as fine around the opening as opposite to the base, where a tool would stand: none presses here,
// and no node is held.
void grade_around(const Eigen::Vector4d& opening, Organ& organ) {
  BoundaryOptions& boundary = organ.options.boundary;
  const BodySurface& surface = organ.body->surface;
  if (!(boundary.base_depth_mm > 0.0))
    boundary.base_depth_mm =
        std::min(held_depth_mm, held_share * (surface.upper() - surface.lower()).minCoeff());
  boundary.is_pressed = false;
  boundary.contact_radius_mm = finest_mm;
  boundary.other_tools = {Vec3(opening.head<3>())};
  GradingOptions& grading = organ.options.cloud.grading;
  grading.whole_circle = true;
  grading.least = 1.0;  // the spacing there is that radius
}

// [3xM] mm, moved and at rest, with the component along gravity.
Table table_of(const Points& place_mm, const Points& shift_mm, const Vec3& up) {
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
  return table;
}

// From the brain's surface at the opening towards its middle, as far as its middle.
Points line_into(const BodySurface& surface, const Vec3& opening) {
  const Eigen::Isometry3d to_body = surface.to_world().inverse();
  const Vec3 from = surface.closest(to_body * opening).place, to = surface.centroid();
  std::vector<Vec3> places;
  const double length = (to - from).norm();
  for (double way = 0.5; way < length; way += profile_step_mm) {
    const Vec3 x = from + way / length * (to - from);
    if (surface.contains(x)) places.push_back(surface.to_world() * x);
  }
  Points result(3, static_cast<Index>(places.size()));
  for (Index k = 0; k < result.cols(); ++k) result.col(k) = places[static_cast<std::size_t>(k)];
  return result;
}

Points shifts_at(const Model& model, const Points& places_mm, const Nodal& u) {
  if (places_mm.cols() == 0) return Points(3, 0);
  return 1e3 * inner_interpolation(model, 1e-3 * places_mm)(u.topRows<3>());
}

constexpr const char* by_shift = "dimple shift";

// What nobody has said.
std::vector<std::string> assumptions_of(const Config& config, const ShiftOptions& options) {
  const auto assumed = [&](const char* key) {
    const auto source = config.source.find(key);
    return source != config.source.end() && source->second == by_shift;
  };
  std::vector<std::string> all;
  if (assumed("material.mu_Pa"))
    all.push_back(fmt::format("the brain's shear modulus is {}", stress_in_words(usual_mu_Pa)));
  if (assumed("image.close_mm"))
    all.push_back(fmt::format("sulci narrower than {} are filled with tissue, as their walls hold together",
                              length_in_words(usual_close_mm)));
  if (options.skull == "derived")
    all.push_back(
        fmt::format("the skull is the brain's outer hull at a gap of {} mm", plain(gap_of(options))));
  all.push_back("the skull holds the brain back without friction");
  return all;
}

const char* shift_leaves_out =
    "Left out: the falx and the tentorium, vessels, drugs and swelling, flow in the tissue, what is "
    "resected, and "
    "adhesion to the skull. Folds pass through each other unless --self-contact is on.";

// What is known once the brain has come to rest.
struct Shifted {
  std::unique_ptr<System> system;
  Nodal f;
  ForceSystem::Sweep sweep;
  Points surface_mm;   // [3xV] the shift of the surface's vertices
  Index largest = -1;  // the vertex in the opening that moves most
};

Shifted come_to_rest(const Config& config, const ForceSystem& tissue, const Result& result,
                     const Eigen::Vector4d& opening) {
  const Loading& loading = result.loading;
  Shifted now;
  now.system = make_system(tissue, result.model, loading.contact, loading.further, loading.loads,
                           config.solver.tolerance, nullptr, loading.folds, loading.walls);
  const Rest& rest = now.system->at_rest();
  now.f.setZero(4, rest.u.cols());
  now.system->set({});
  now.sweep = now.system->force_at(rest.u, rest.lambda, now.f);
  now.surface_mm = 1e3 * surface_interpolation(result.model)(rest.u.topRows<3>());
  const Points& vertex = result.model.surface.vertex_mm;
  for (Index v = 0; v < vertex.cols(); ++v)
    if ((vertex.col(v) - opening.head<3>()).norm() <= opening[3] &&
        (now.largest < 0 || now.surface_mm.col(v).norm() > now.surface_mm.col(now.largest).norm()))
      now.largest = v;
  return now;
}

void warn_of_shift(const RunLog& log, const Model& model, Shifted& now, double shift_mm) {
  if (now.sweep.inverted > 0)
    log.warn(fmt::format("{} of {} integration points are inverted: the shift is not to be trusted there",
                         now.sweep.inverted, model.point_count()));
  for (const TouchingTool* wall : now.system->walls()) {
    const double in = wall->audit(now.system->at_rest().u, now.system->now()).penetration,
                 apart = wall->touch().surface.spacing.mean();
    if (in > 0.15 * apart)
      log.warn(
          fmt::format("the brain's surface reaches {} into the skull between the places where contact is "
                      "looked for, which are {} apart; give more --nodes",
                      length_in_words(1e3 * in), length_in_words(1e3 * apart)));
  }
  if (shift_mm < least_shift_mm || shift_mm > most_shift_mm)
    log.warn(fmt::format(
        "the largest shift at the opening, {}, is outside of what was measured in 16 craniotomies, "
        "{:g} to {:g} mm: the fluid lost, the stiffness, the gap or the part that is held decide it",
        length_in_words(shift_mm), least_shift_mm, most_shift_mm));
}

}  // namespace

Config config_of_shift(Config config, const ShiftOptions& options) {
  const Eigen::Vector4d opening = opening_of(options);
  const Vec3 up = up_of(options);
  targets_of(options);
  if (!options.brain.empty()) set_option(config, "image.label", options.brain, "--brain");
  Config::Wall& skull = config.wall[skull_name];
  const double gap = gap_of(options);
  const bool derived = options.skull == "derived";
  skull.shape = derived ? fmt::format("around:{}mm", plain(gap)) : "label:" + options.skull;
  if (!derived && !options.gap.empty()) skull.gap = plain(gap);
  skull.opening = fmt::format("{},{},{},{}", opening[0], opening[1], opening[2], opening[3]);
  config.load.fluid_lost = fmt::format("{},{},{},{}", up.x(), up.y(), up.z(), options.fluid_lost);
  fluid_lost_of(config);
  if (!was_given(config, "boundary.base")) config.boundary.base = "inferior";
  if (!was_given(config, "material.mu_Pa") && !was_given(config, "material.young_Pa") &&
      config.material.preset == "none")
    set_option(config, "material.mu_Pa", plain(usual_mu_Pa), by_shift);
  if (default_nodes(config)) set_option(config, "cloud.nodes", plain(usual_nodes), by_shift);
  if (!was_given(config, "image.close_mm"))
    set_option(config, "image.close_mm", plain(usual_close_mm), by_shift);
  config.load.depth_mm = fold_reach_mm;
  config.solver.time = "quasi-static";
  config.accuracy.band = "off";
  config.output.write = {"images"};
  return config;
}

namespace {

void write_fields(const fs::path& folder, const Model& model, const Shifted& now) {
  const auto field = [](const Points& shift_mm) {
    return Field{.name = "displacement_mm", .unit = "mm", .values = shift_mm};
  };
  write_vtp(folder / "surface.vtp",
            {.position_mm = model.surface.vertex_mm,
             .triangles = model.surface.triangles,
             .fields = {field(now.surface_mm)}},
            0.0);
  const Points u_mm = 1e3 * now.system->at_rest().u.topRows<3>();
  write_vtu(folder / "nodes.vtu", {.position_mm = 1e3 * model.X, .fields = {field(u_mm)}}, 0.0);
}

Json json_of(const Vec3& v) {
  return Json::array({v.x(), v.y(), v.z()});
}

}  // namespace

namespace {

Json shift_json(const Config& config, const ShiftOptions& options, const Result& result, const Shifted& now,
                const Vec3& most) {
  const Eigen::Vector4d opening = opening_of(options);
  const Vec3 up = up_of(options);
  return {{"largest_at_opening_mm", most.norm()},
          {"along_gravity_mm", -most.dot(up)},
          {"components_mm", json_of(most)},
          {"at_mm", now.largest < 0 ? Json() : json_of(result.model.surface.vertex_mm.col(now.largest))},
          {"largest_of_all_mm", now.surface_mm.colwise().norm().maxCoeff()},
          {"up", json_of(up)},
          {"fluid_lost", options.fluid_lost},
          {"fluid_level_mm", 1e3 * result.loading.loads.fluid->level},
          {"skull", options.skull},
          {"opening_mm", {opening[0], opening[1], opening[2], opening[3]}},
          {"mu_Pa", config.material.mu_Pa},
          {"base", result.report.boundary.base_reason},
          {"band", "unknown: it was measured for forces under a tool"},
          {"left_out", shift_leaves_out}};
}

Json walls_json(const RunLog& log, const System& system) {
  Json walls = Json::object();
  for (const TouchingTool* wall : system.walls()) {
    const TouchingTool::Touched touched = wall->touched();
    log.say("wall     " + dimple::in_words(wall->touch().name, touched));
    walls[wall->touch().name] = {{"places", wall->count()},
                                 {"places_that_touch", touched.samples},
                                 {"force_N", json_of(touched.force)},
                                 {"area_that_touches_mm2", 1e6 * touched.area},
                                 {"largest_penetration_mm", 1e3 * touched.penetration}};
  }
  return walls;
}

// The shift at the targets, and along a line into the brain.
void write_tables(const fs::path& folder, const Model& model, const std::vector<Vec3>& targets,
                  const Points& line, const Nodal& u, const Vec3& up) {
  Points places(3, static_cast<Index>(targets.size()));
  for (Index k = 0; k < places.cols(); ++k) places.col(k) = targets[static_cast<std::size_t>(k)];
  write_csv(folder / "targets.csv", table_of(places, shifts_at(model, places, u), up));
  write_csv(folder / "profile.csv", table_of(line, shifts_at(model, line, u), up));
}

}  // namespace

Outcome shift(const Config& config, const ShiftOptions& options, const fs::path& folder, Existing existing,
              const RecordObserver& observer) {
  const Stopwatch whole;
  const Eigen::Vector4d opening = opening_of(options);
  const Vec3 up = up_of(options);
  const std::vector<Vec3> targets = targets_of(options);
  ResultFolder results(folder, existing);
  ImageTask task = images_asked_for(config, false);
  require_circle(config, "dimple shift");
  require_one_tool(config, "dimple shift");
  require_no_steps(config, "dimple shift");
  require_no_goal(config, "dimple shift");
  check_loads(config);
  check_supports(config);
  check_folds(config);
  check_walls(config);

  Result result;
  const RunObserver hears{.line = observer.line, .part = observer.part};
  const RunLog log{hears, result};
  const Case given{.config = config};
  Organ organ = read_organ(given, model_options(config), log, result);
  require_on_brain(organ, opening, targets);
  grade_around(opening, organ);
  result.provenance = {{"image", name_of_image(config)},
                       {"image_sha256", sha256_of_image(config, result.image)}};
  find_site(config, log, organ, result);
  const std::optional<Organ> brain = std::move(organ);
  Placed placed = place(given, brain, log, result);
  require_overlap(task, placed.places);
  const Points line = line_into(brain->body->surface, opening.head<3>());
  result.origin = std::make_shared<Origin>(Origin{
      .config = config, .organ = *brain, .image = {}, .facts = result, .image_warnings = {}, .boundary = {}});
  make_ready(given, std::move(placed), log, result);
  stop_if_asked();
  log.begin(Part::solving, config);
  const Stopwatch solving;
  const ForceSystem tissue(result.model, result.tissues, precision_of(config));
  Shifted now = come_to_rest(config, tissue, result, opening);
  const double solve_s = solving.seconds();
  const Model& model = result.model;
  const Nodal& u = now.system->at_rest().u;

  results.prepare();
  write_fields(folder, model, now);
  write_tables(folder, model, targets, line, u, up);
  std::vector<int> labels;
  for (const LabelMeasure& label : result.labels) labels.push_back(label.value);
  ImageWriter images(task, folder, model, labels, result.cut);
  images.keep({.number = 1, .t = 1.0, .depth = 0.0, .u = u, .f = now.f, .forces = now.system->tissue()});
  images.write();
  log.say("images   " + images.told());

  const Vec3 most = now.largest < 0 ? Vec3::Zero().eval() : Vec3(now.surface_mm.col(now.largest));
  warn_of_shift(log, model, now, most.norm());
  Json summary = summary_of_image(config, result);
  summary["status"] = "finished";
  summary["version"] = DIMPLE_VERSION;
  summary["shift"] = shift_json(config, options, result, now, most);
  summary["walls"] = walls_json(log, *now.system);
  const std::vector<std::string> assumed = assumptions_of(config, options);
  log.say("assumed  " + fmt::format("{}", fmt::join(assumed, "; ")));
  summary["shift"]["assumed"] = assumed;
  log.say(std::string("shift    ") + shift_leaves_out);
  summary["images"] = images.summary();
  summary["solve_wall_s"] = solve_s;
  summary["total_wall_s"] = whole.seconds();
  summary["warnings"] = result.warnings;
  Outcome outcome;
  outcome.summary_json = as_text(summary);
  write_file(folder / "summary.json", outcome.summary_json);
  outcome.headline = fmt::format("largest shift at the opening {}, {} of it along gravity; no band is known",
                                 length_in_words(most.norm()), length_in_words(-most.dot(up)));
  return outcome;
}

}  // namespace dimple
