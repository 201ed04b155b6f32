#include "apps/studies/shift_run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apps/run/folds.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/model_options.hpp"
#include "apps/run/pipeline.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/scene/resolve_parts.hpp"
#include "apps/studies/markups.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/scene/sides.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

constexpr double usual_gap_mm = 2.0;    // of a derived skull, by default
constexpr double held_fraction = 0.15;  // of the brain's smallest extent, as an upper limit
constexpr double held_depth_mm = 20.0;  // of the brain's lowest part
constexpr double unheld_mm = 5.0;       // radius without held nodes, around the position of no tool
constexpr double fold_reach_mm = 5.0;   // half of the largest gap with contact under --self-contact
constexpr double profile_step_mm = 5.0;
constexpr double brain_mu_Pa = 1000.0;   // default
constexpr double closed_sulci_mm = 4.0;  // default; narrower sulci hold together
constexpr const char* by_shift = "dimple shift";

Eigen::Vector4d opening_of(const ShiftOptions& options) {
  const OptionWord word = parse_word({"the opening", {{"", ball_numbers()}}}, options.opening, "--opening");
  return Eigen::Vector4d(word.number.data());
}

Vec3 up_of(const ShiftOptions& options) {
  const OptionWord word = parse_word({"the direction",
                                      {{.numbers = direction_numbers(),
                                        .example = "a side, such as anterior, or x,y,z, LPS",
                                        .is_side = true}}},
                                     options.up, "--up");
  const Vec3 up = word.three();
  if (up.isZero(0.0)) refuse_word(word, "is no direction", "gravity acts against it");
  return word.is_side ? up : Vec3(up.stableNormalized());
}

std::vector<Vec3> targets_of(const ShiftOptions& options) {
  std::vector<Vec3> targets;
  for (const std::string& one : options.target) {
    if (is_markups_file(one)) {
      const std::vector<Vec3> read = read_markups(one);
      targets.insert(targets.end(), read.begin(), read.end());
      continue;
    }
    targets.push_back(parse_word({"the target", {{"", place_numbers()}}}, one, "--target").three());
  }
  return targets;
}

// Offset as text, "20.0 mm left, 10.0 mm posterior of the brain's middle", which shows RAS given as LPS.
std::string from_middle(const BodySurface& surface, const Vec3& place) {
  constexpr double nothing_mm = 0.05;
  const Vec3 away = place - surface.to_world() * surface.centroid();
  std::string text;
  for (Index d = 0; d < 3; ++d)
    if (std::abs(away[d]) >= nothing_mm)
      text += fmt::format("{}{:.1f} mm {}", text.empty() ? "" : ", ", std::abs(away[d]),
                          side_towards(away[d] * Vec3::Unit(d)));
  return text.empty() ? "at the brain's middle" : text + " of the brain's middle";
}

void say_places(const RunLog& log, const BodySurface& surface, const ShiftScene& requested) {
  const Vec3 opening = requested.opening.head<3>();
  log.say(fmt::format("opening  {}, of {} radius: {}", dimple::in_words(opening),
                      length_in_words(requested.opening[3]), from_middle(surface, opening)));
  for (const Vec3& target : requested.targets)
    log.say(fmt::format("target   {}: {}", dimple::in_words(target), from_middle(surface, target)));
}

// Checks that the opening and the targets are on or in the brain, before the expensive steps.
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
         .why = fmt::format("no part of the brain is in it; the nearest place is {}",
                            dimple::in_words(surface.to_world() * nearest.place)),
         .remedy = "give a place on the brain's surface, in LPS mm; 3D Slicer's coordinates are RAS"});
  for (const Vec3& target : targets)
    if (!surface.contains(surface.to_world().inverse() * target))
      throw UsageError(
          {.fact = fmt::format("the target {} is outside of the brain", dimple::in_words(target)),
           .where = "--target",
           .why = fmt::format("its surface is {} away", length_in_words(closest(target).distance)),
           .remedy = "give a place of the brain at rest, in LPS mm"});
}

// Without a tool, nodes are spread evenly: contact with the skull decides the shift and may be anywhere.
void spread_evenly(Organ& organ) {
  BoundaryOptions& boundary = organ.options.boundary;
  const BodySurface& surface = organ.body->surface;
  if (!(boundary.base_depth_mm > 0.0))
    boundary.base_depth_mm =
        std::min(held_depth_mm, held_fraction * (surface.upper() - surface.lower()).minCoeff());
  boundary.is_pressed = false;
  boundary.contact_radius_mm = unheld_mm;
  organ.options.node_set.grading.patch_edge = 1.0;
}

// Points from the brain's surface at the opening to its centre.
Points line_into(const BodySurface& surface, const Vec3& opening) {
  const Eigen::Isometry3d to_body = surface.to_world().inverse();
  const Vec3 from = surface.closest(to_body * opening).place, to = surface.centroid();
  std::vector<Vec3> places;
  const double length = (to - from).norm();
  for (double travelled = 0.5; travelled < length; travelled += profile_step_mm) {
    const Vec3 x = from + travelled / length * (to - from);
    if (surface.contains(x)) places.push_back(surface.to_world() * x);
  }
  Points result(3, static_cast<Index>(places.size()));
  for (Index k = 0; k < result.cols(); ++k) result.col(k) = places[static_cast<std::size_t>(k)];
  return result;
}

Index nearest_to(const Points& places, const Vec3& place) {
  Index nearest = 0;
  (places.colwise() - place).colwise().squaredNorm().minCoeff(&nearest);
  return nearest;
}

}  // namespace

double gap_of_skull(const ShiftOptions& options) {
  double gap = usual_gap_mm;
  if (!options.gap.empty())
    set_value({.key = "--gap", .unit = "mm", .value = &gap, .most = 100.0, .help = "a gap"}, options.gap,
              "--gap");
  return gap;
}

ShiftScene scene_of(const ShiftOptions& options) {
  return {opening_of(options), up_of(options), targets_of(options)};
}

Index Shifted::largest_in(const Eigen::Vector4d& ball) const {
  const Points& vertex = result.model.surface.vertex_mm;
  Index largest = -1;
  for (Index v = 0; v < vertex.cols(); ++v)
    if ((vertex.col(v) - ball.head<3>()).norm() <= ball[3] &&
        (largest < 0 || surface_mm.col(v).norm() > surface_mm.col(largest).norm()))
      largest = v;
  return largest < 0 ? nearest_to(vertex, ball.head<3>()) : largest;
}

Vec3 Shifted::at_middle(const Eigen::Vector4d& opening) const {
  if (line_mm.cols() > 0) return line_mm.col(0);
  return surface_mm.col(nearest_to(result.model.surface.vertex_mm, opening.head<3>()));
}

Points points_of(const std::vector<Vec3>& list) {
  Points places(3, static_cast<Index>(list.size()));
  for (Index k = 0; k < places.cols(); ++k) places.col(k) = list[static_cast<std::size_t>(k)];
  return places;
}

Points Shifted::at(const Points& places_mm) const {
  if (places_mm.cols() == 0) return Points(3, 0);
  return 1e3 * inner_interpolation(result.model, 1e-3 * places_mm)(u().topRows<3>());
}

void find_equilibrium(const Scene& scene, const ShiftScene& requested, const ShiftHooks& hooks,
                      Shifted& now) {
  check_pairs(scene, Feature::shift);
  Result& result = now.result;
  const RunLog log{hooks.observer, result};
  const Case given{.scene = scene, .change = hooks.change};
  Organ organ = read_organ(given, model_options(scene), log, result);
  require_on_brain(organ, requested.opening, requested.targets);
  say_places(log, organ.body->surface, requested);
  spread_evenly(organ);
  result.provenance = {{"image", name_of_image(scene)},
                       {"image_sha256", sha256_of_image(scene, result.image)}};
  find_site(scene, log, organ, result);
  const std::optional<Organ> brain = std::move(organ);
  NodePlacement placed = place(given, brain, log, result);
  if (hooks.placed) hooks.placed(placed.places);
  now.line = line_into(brain->body->surface, requested.opening.head<3>());
  result.origin = std::make_shared<Origin>(Origin{
      .choices = scene, .organ = *brain, .image = {}, .facts = result, .image_warnings = {}, .boundary = {}});
  make_ready(given, std::move(placed), log, result);
  stop_if_requested();
  log.begin(Part::solving, scene);
  const Stopwatch solving;
  now.tissue = std::make_unique<ForceSystem>(result.model, result.tissues, scene.solver.precision);
  const Loading& loading = result.loading;
  now.system = make_system(*now.tissue, result.model, loading.contact, loading.further, loading.loads,
                           scene.solver.tolerance, nullptr, loading.folds, loading.walls);
  const EquilibriumState& state = now.system->step_start();
  now.f.setZero(4, state.u.cols());
  now.system->set({});
  now.sweep = now.system->force_at(state.u, state.lambda, now.f);
  now.surface_mm = 1e3 * surface_interpolation(result.model)(state.u.topRows<3>());
  result.history.preload_displacement = 1e-3 * now.surface_mm.colwise().norm().maxCoeff();
  now.line_mm = now.at(now.line);
  now.targets_mm = now.at(points_of(requested.targets));
  for (const RigidContact* wall : now.system->walls()) {
    RigidContact::ContactSummary& contact_summary =
        result.history.walls.emplace_back(wall->contact_summary());
    contact_summary.penetration =
        std::max(contact_summary.penetration, wall->audit(state.u, now.system->now()).penetration);
  }
  now.solve_s = solving.seconds();
}

// Sentences on the assumed options.
std::vector<std::string> assumptions_of(const Description& described, const ShiftOptions& options) {
  const auto assumed = [&](const char* key) { return source_of(described, key) == by_shift; };
  std::vector<std::string> all;
  if (assumed("material.mu_Pa"))
    all.push_back(fmt::format("the brain's shear modulus is {}", stress_in_words(brain_mu_Pa)));
  if (assumed("image.close_mm"))
    all.push_back(fmt::format("sulci narrower than {} are filled with tissue, as if their walls were bonded",
                              length_in_words(closed_sulci_mm)));
  if (assumed("boundary.base")) all.push_back("the brain is held at its inferior side, whichever side is up");
  if (options.skull == "derived")
    all.push_back(
        fmt::format("the skull is the brain's outer hull at a gap of {} mm", plain(gap_of_skull(options))));
  if (was_given(described, "material.density_kg_per_m3"))
    all.push_back(
        "the given density of the tissue has no effect: the image shows the brain under its weight, and only "
        "the buoyancy of the fluid (1007 kg/m3) is lost");
  all.push_back("contact with the skull is without friction");
  return all;
}

namespace {

void check_fluid_lost(const ShiftOptions& options) {
  parse_word({"the lost fluid", {{"", {fraction_of_lost_fluid()}, "60%"}}}, options.fluid_lost,
             "--fluid-lost");
}

}  // namespace

std::map<std::string, std::string> defaults_of_shift() {
  return {{"material.mu_Pa", plain(brain_mu_Pa)},
          {"cloud.nodes", "4000"},
          {"image.close_mm", plain(closed_sulci_mm)},
          {"boundary.base", "inferior"}};
}

Description describe_shift(Description brain, const ShiftOptions& options) {
  const auto [opening, up, targets] = scene_of(options);
  check_fluid_lost(options);
  const auto set = [&](const char* key, const std::string& text) { set_option(brain, key, text, by_shift); };
  if (!options.brain.empty()) set_option(brain, "image.label", options.brain, "--brain");
  const double gap = gap_of_skull(options);
  const bool derived = options.skull == "derived";
  set("wall.skull.shape", derived ? fmt::format("around:{}mm", plain(gap)) : "label:" + options.skull);
  if (!derived && !options.gap.empty()) set("wall.skull.gap", plain(gap));
  set("wall.skull.opening", fmt::format("{},{},{},{}", opening[0], opening[1], opening[2], opening[3]));
  const std::string fluid_lost = fmt::format("{},{},{},{}", up.x(), up.y(), up.z(), options.fluid_lost);
  fluid_named(fluid_lost);
  set_option(brain, "load.fluid_lost", fluid_lost, "--up, --fluid-lost");
  const auto set_default = [&](const std::string& key) {
    set_option(brain, key, defaults_of_shift().at(key), by_shift);
  };
  if (!was_given(brain, "boundary.base")) set_default("boundary.base");
  if (!was_given(brain, "material.mu_Pa") && !was_given(brain, "material.young_Pa") &&
      value_of(brain, "material.preset") == OptionValue("none"))
    set_default("material.mu_Pa");
  const bool has_goal = was_given(brain, "accuracy.goal") || was_given(brain, "accuracy.budget_s");
  if (default_nodes(brain) && !has_goal)  // a goal is refused by the table of pairs, with its own message
    set_default("cloud.nodes");
  if (!was_given(brain, "image.close_mm")) set_default("image.close_mm");
  put_numbers(brain, "load.depth_mm", {fold_reach_mm}, by_shift);
  set("solver.time", "quasi-static");
  set("output.write", options.tables_alone ? "force" : "images");
  return brain;
}

}  // namespace dimple
