#include <fmt/format.h>

#include <utility>

#include "apps/run/folds.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/membranes.hpp"
#include "apps/run/model_options.hpp"
#include "apps/run/other_tools.hpp"
#include "apps/run/pipeline.hpp"
#include "apps/run/run_words.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/unloaded.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "preprocess/supports/support.hpp"
#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/march/quasi_static.hpp"

namespace dimple {
namespace {

using Line = RunObserver::Line;

// Extent of the body along the press direction, from the centre of the tool [m].
double reach_beneath(const Discretisation& places) {
  return (places.X.transpose() * places.tool.approach).maxCoeff() -
         places.tool.centre.dot(places.tool.approach);
}

void require_room_beneath(const Scene& scene, const Discretisation& places) {
  const double beneath = reach_beneath(places);
  const double depth = deepest(scene, places.tool);
  require_tool_as_long(scene, 1e3 * depth);
  if (turns(scene)) require_tool_as_long_turned(scene, most_of_tool_below(scene, places.tool));
  if (depth >= beneath)
    throw ModelError(
        {.fact = fmt::format("an indentation of {} is deeper than the organ beneath the contact patch, {}",
                             length_in_words(1e3 * depth), length_in_words(1e3 * beneath)),
         .where = scene.steps.empty() ? "--depth (load.depth_mm)" : "step",
         .why = "the tool would pass through to the other side",
         .remedy = "give a smaller --depth, or another place with --indent-at"});
}

// Reports depths at which the contact is small. Its force was up to 4 % too high with a radius below four
// node spacings, and up to 12 % below two (spheres compared with finite elements).
void report_first_contact(const RunLog& log, const Scene& scene, const Model& model,
                          const RigidBody& indenter) {
  constexpr double enough = 4.0;
  const double radius = enough * model.spacing.minCoeff(), depth = 1e-3 * scene.depth_mm;
  if (indenter.shape.edge > 0.0) return;
  double until = depth;
  if (contact_radius(indenter.shape, depth) > radius) {
    double low = 0.0;
    for (int k = 0; k < 40; ++k) {
      const double middle = 0.5 * (low + until);
      (contact_radius(indenter.shape, middle) < radius ? low : until) = middle;
    }
  }
  if (until < 0.01 * depth) return;  // a flat end is in contact with all of its area at once
  if (until < 0.2 * depth)
    return log.say(
        fmt::format("contact  up to a depth of {} the contact radius is less than {:g} node spacings; the "
                    "force may be 4 % too high there",
                    length_in_words(1e3 * until), enough));
  log.warn(
      fmt::format("up to a depth of {} the contact radius is less than {:g} node spacings; the force may be "
                  "12 % too high there; give more --nodes",
                  length_in_words(1e3 * until), enough));
}

// Warns of steps so short that inertia would matter: steps go from equilibrium to equilibrium.
void report_fast_steps(const RunLog& log, const LoadedModel& result) {
  const double crossing = shear_crossing_time(result.tissues, result.model);
  for (const Step& step : result.loading.steps)
    if (step.duration > 0.0 && step.duration < slow_load * crossing && !step.holds())
      return log.warn(
          fmt::format("the step '{}' lasts {:.3g} s, and a shear wave crosses the organ in {:.3g} s: "
                      "inertia, which steps neglect, would change its force",
                      step.name, step.duration, crossing));
}

// Refuses features that need equilibrium, in a march with inertia.
void check_without_equilibrium(const Scene& scene) {
  for (const Feature feature : {Feature::membrane, Feature::free_base, Feature::wall})
    check_pair(scene, feature, Feature::inertia);
}

// Time mode of scene.solver.time; "auto" depends on the duration of the load.
TimeMode time_of(const Scene& scene, const RunLog& log, const LoadedModel& result) {
  using Time = Scene::Numerics::Time;
  const Time requested = scene.solver.time;
  if (requested == Time::quasi_static) return TimeMode::quasi_static;
  if (requested == Time::explicit_ || !result.model.scheme.pressure_patches) {
    check_without_equilibrium(scene);
    return TimeMode::explicit_;
  }
  Loading at_the_rate = result.loading;  // without steps of a given duration
  std::erase_if(at_the_rate.steps, [](const Step& step) { return step.duration > 0.0; });
  TimeMode mode = choose_time(result.model, result.tissues, at_the_rate);
  // Without a given speed, the force is that of equilibrium.
  if (!scene.given.rate || (!result.loading.steps.empty() && at_the_rate.steps.empty()))
    mode = TimeMode::quasi_static;
  if (mode != TimeMode::quasi_static && result.loading.indenter)
    throw UsageError({.fact = "the tool is too fast for contact in equilibrium",
                      .where = "--rate (load.rate_mm_per_s)",
                      .why = "its force includes inertia, which is modelled for the bonded indenter only",
                      .remedy = "give a lower --rate, or --time quasi-static"});
  if (mode != TimeMode::quasi_static && !scene.further_tools.empty())
    throw UsageError({.fact = "the load is too fast for the contact of further tools",
                      .where = "--rate (load.rate_mm_per_s)",
                      .why = "contact is solved in equilibrium, without inertia",
                      .remedy = "give a lower --rate, or --time quasi-static"});
  if (result.loading.indenter) return mode;
  if (mode != TimeMode::quasi_static && !scene.steps.empty())
    throw UsageError({.fact = "the tool is too fast for a scene of steps",
                      .where = "--rate (load.rate_mm_per_s)",
                      .why = "its force includes inertia, and each step goes from an equilibrium to the next",
                      .remedy = "give a lower --rate, or --time quasi-static"});
  if (mode != TimeMode::quasi_static) check_without_equilibrium(scene);
  const double crossings = shear_crossings(result.model, result.tissues, result.loading);
  const bool shallow = mode == TimeMode::quasi_static && crossings < slow_load;
  log.line(mode == TimeMode::quasi_static && !shallow ? Line::detail : Line::said,
           time_in_words(mode, crossings, shallow));
  return mode;
}

// Warns of damping that a quasi-static march does not use.
void report_damping(const Scene& scene, const RunLog& log, TimeMode mode) {
  if (mode == TimeMode::quasi_static && scene.solver.damping_per_s > 0.0)
    log.warn(
        fmt::format("{} 1/s of damping is not used: the force is that of equilibrium at each depth, which "
                    "nothing damps (--time explicit does)",
                    plain(scene.solver.damping_per_s)));
}

// Adds the walls of the scene, from the image where they are labels.
void place_walls(const Case& given, const RunLog& log, LoadedModel& result) {
  if (given.scene.walls.empty()) return;
  log.doing("walls");
  const LabelImage& image = result.image.run.empty() && result.origin ? result.origin->image : result.image;
  Walls walls = walls_of(given.scene, result.model, &image, result.origin ? &result.origin->organ : nullptr);
  for (const std::string& words : walls.words) log.say("wall     " + words);
  for (RigidBody& wall : walls.rigid_body) result.loading.walls.push_back(std::move(wall));
  result.stages.done("walls");
}

// Moves the tool to its first contact.
void place_tool(const Scene& scene, const RunLog& log, LoadedModel& result) {
  const Model& model = result.model;
  const bool moved = result.loading.loads.move_the_body();
  if (moved) {
    log.doing("loads");
    const ForceSystem tissue(model, result.tissues, scene.solver.precision);
    equilibrium_under_loads(tissue, model, result.loading, scene.solver.tolerance);
    result.stages.done("loads");
  }
  const RigidBody& indenter = *result.loading.indenter;
  log.say(fmt::format("tool     {}{}, {}; its tip at first contact at {}{}; {} contact points on the surface",
                      in_words(indenter.shape), depth_of_tool_in_words(scene),
                      friction_in_words(indenter.friction), in_words(1e3 * indenter.pose.tip),
                      moved ? ", moved by the loads" : "", indenter.surface.count()));
  if (indenter.shape.mesh && indenter.shape.mesh->turned)
    log.say("tool     some of its triangles faced inward in the file, and were flipped");
  report_first_contact(log, scene, model, indenter);
}

// Warns of a large contrast in stiffness, which shape functions smooth. With a soft layer on a tissue a
// thousand times as stiff, the force was 16 % too high with 1500 nodes and 9 % with 6000.
void warn_of_stiff_tissue(const RunLog& log, const Tissues& tissues) {
  constexpr double like_bone = 50.0;
  const std::vector<Material> used = in_use(tissues);
  const auto [softest, stiffest] = std::minmax_element(
      used.begin(), used.end(), [](const Material& a, const Material& b) { return a.mu < b.mu; });
  if (used.empty() || !(stiffest->mu > like_bone * softest->mu)) return;
  log.warn(
      fmt::format("one tissue (mu {}) is {:.3g} times as stiff as another (mu {}): coarse nodes make the "
                  "soft tissue too thin at the interface, and an equilibrium may not be found; hold a nearly "
                  "rigid tissue instead: --set support.bone.on=label:NAME",
                  stress_in_words(stiffest->mu), stiffest->mu / softest->mu, stress_in_words(softest->mu)));
}

// Supports, loads, steps, tools and walls of the scene, on the complete model.
void make_loading(const Case& given, Supports supports, const RunLog& log, LoadedModel& result) {
  const Scene& scene = given.scene;
  const Model& model = result.model;
  Loading& loading = result.loading = loading_of(scene);
  loading.further = std::move(supports.sets);
  loading.loads = loads_of(scene, model, result.unloaded ? result.unloaded->imaged_surface : model.surface);
  OtherTools others = other_tools_of(scene, model, loading.further);
  for (const std::string& words : others.words) log.say("tool     " + words);
  std::map<std::string, Vec3> approach_of_others;
  for (const RigidBody& other : others.rigid_body) approach_of_others[other.name] = other.pose.points_at;
  loading.steps = steps_of(scene, model.tool, approach_of_others);
  require_near(loading.steps, model.X);
  if (!scene.poses_words.empty()) log.say("poses    " + scene.poses_words);
  for (const Step& step : loading.steps) log.say("step     " + in_words(step));
  loading.indenter =
      given.change.tool ? indenter_of(scene, model, *given.change.tool) : indenter_of(scene, model);
  const double down = deepest(scene, model.tool);
  if (loading.indenter) require_free_under(*loading.indenter, down, loading.further, model);
  loading.walls = std::move(others.rigid_body);
  result.time = time_of(scene, log, result);
  report_damping(scene, log, result.time);
  report_fast_steps(log, result);
  if (result.time == TimeMode::quasi_static || scene.self_contact == Scene::SelfContact::on)
    loading.folds = folds_of(scene, result.facing_fraction, model, down);
  if (loading.folds)
    log.say("folds    " + in_words(*loading.folds, down));
  else if (scene.self_contact == Scene::SelfContact::on)
    log.say(
        "folds    no contact possible: nowhere does the surface face itself across twice the tool's "
        "displacement or less");
  place_walls(given, log, result);
  if (loading.indenter) place_tool(scene, log, result);
}

void report_tissues(const Scene& scene, const RunLog& log, const Tissues& tissues) {
  auto own = scene.tissues.begin();
  for (std::size_t t = 0; t < tissues.material.size(); ++t) {
    const Material& m = tissues.material[t];
    const std::string label = t == 0 ? "" : (own++)->label;
    // The default stiffness was reported before.
    log.line(t == 0 && !scene.given.stiffness ? Line::detail : Line::said, describe(tissues, t, label));
    log.detail(fmt::format("waves    kappa {}, so {:.2f} and {:.3f} m/s", stress_in_words(m.kappa),
                           pressure_wave_speed(m), shear_wave_speed(m)));
  }
  warn_of_stiff_tissue(log, tissues);
  if (const std::string preset = scene.material.deviations_from_preset; !preset.empty())
    log.say("preset   " + preset);
}

void report_load(const Scene& scene, const RunLog& log, const LoadedModel& result) {
  const Loading& loading = result.loading;
  const SolverOptions options = solver_options(scene);
  for (const Membrane& film : loading.loads.membrane) log.say("membrane " + in_words(film));
  if (const std::string loads = in_words(loading.loads); !loads.empty())
    log.say("loads    " + loads + "; the body is in equilibrium under it first" +
            (relaxes(result.tissues.material) ? ", as relaxed tissue" : ""));
  log.detail(
      fmt::format("load     {} at {} mm/s: {} s, {}, {}", length_in_words(scene.depth_mm),
                  plain(scene.rate_mm_per_s), three_digits(loading.duration()),
                  !loading.indenter                   ? std::string(name_of(scene.contact))
                  : loading.indenter->friction == 0.0 ? "frictionless"
                                                      : friction_in_words(loading.indenter->friction),
                  result.time == TimeMode::quasi_static
                      ? fmt::format("equilibrium in {} steps", steps_of_load(result.model, loading, options))
                      : "with inertia, by central differences"));
  if (!is_as_printed(result.tissues.material.front())) return;
  log.warn("the printed stress has no energy: energy.csv shows that of the consistent form");
  if (options.damping == 0.0)
    log.warn(
        "the printed stress does work on closed paths, so undamped vibration grows: give --damping, for "
        "instance 20");
}

}  // namespace

void make_ready(const Case& given, NodePlacement placed, const RunLog& log, Result& result) {
  const Scene& scene = given.scene;
  require_room_beneath(scene, placed.places);
  check_loads(scene, placed.places.surface);
  Supports supports = supports_of(scene, placed.places, placed.label_names);
  for (const std::string& words : supports.words) log.say("support  " + words);
  const Stopwatch preparing;
  const std::map<std::string, int> names = placed.label_names;
  complete(scene, std::move(placed), log, result);
  if (!scene.base_is_held) {
    result.model.base.clear();
    log.say("base     is free: the body rests on walls by contact only");
  }
  take_loads_off(scene, supports.sets, tissues_of(scene, names, result.model, result.cut.labels).density, log,
                 result);
  make_loading(given, std::move(supports), log, result);
  result.findings = check_model(result.model, result.model.support_report, result.loading.depth);
  for (const Finding& finding : result.findings) log.warn(in_words(finding));
  report_tissues(scene, log, result.tissues);
  report_load(scene, log, result);
  if (result.time != TimeMode::quasi_static && scene.material.mu_spread > 0.0)
    throw UsageError(
        {.fact = "mu has an uncertainty, and the force includes inertia",
         .where = "--mu (material.mu_spread_percent)",
         .why = "the load is so short that the run is dynamic, and its force not proportional to mu",
         .remedy = "run once with the smallest and once with the largest modulus, or slower"});
  result.spread = scene.material.mu_spread;
  result.model_warnings = result.warnings.size();
  ask_for_units(log, scene, result);
  result.complete_s = preparing.seconds();
}

}  // namespace dimple
