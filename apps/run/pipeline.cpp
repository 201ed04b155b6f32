#include "apps/run/pipeline.hpp"

#include <fmt/format.h>

#include <utility>

#include "apps/run/bending.hpp"
#include "apps/run/closing_cut.hpp"
#include "apps/run/cut_scene.hpp"
#include "apps/run/cuts.hpp"
#include "apps/run/folds.hpp"
#include "apps/run/grading.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/membranes.hpp"
#include "apps/run/model_options.hpp"
#include "apps/run/other_tools.hpp"
#include "apps/run/rocking.hpp"
#include "apps/run/run_words.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/unless_stopped.hpp"
#include "apps/run/unloaded.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/memory.hpp"
#include "io/stop.hpp"
#include "preprocess/supports/support.hpp"
#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/march/quasi_static.hpp"

namespace dimple {
namespace {

using Line = RunObserver::Line;

// Where nobody has chosen, a folded body takes as many as its band needs, and a punch as its edge does.
void take_nodes_for_band(const Scene& scene, const RunLog& log, ModelOptions& options, Result& result) {
  const Index of_tool = fewest_nodes_under_tool(scene), of_body = fewest_nodes_with_band(result.facing_share),
              fewest = std::max(of_tool, of_body);
  if (scene.given.nodes || !options.scheme.pressure_patches || options.cloud.count >= fewest) return;
  log.say(of_tool >= of_body ? nodes_for_edge_in_words(fewest, options.cloud.count)
                             : nodes_for_band_in_words(fewest, options.cloud.count, result.facing_share));
  options.cloud.count = result.nodes_for_band = fewest;
}

template <class Named, class Same>
bool are_same(const std::vector<Named>& a, const std::vector<Named>& b, const Same& same) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), same);
}

bool move_alike(const Scene::Step& a, const Scene::Step& b) {
  return a.moves == b.moves && a.move_mm == b.move_mm && a.turn_deg == b.turn_deg &&
         a.about_mm == b.about_mm && a.cut.text == b.cut.text;
}

// All that a place for the tool and the base depends on. How deep the tool goes says how much of it touches;
// a circle does whole.
bool asks_for_same_site(const Scene& a, const Scene& b) {
  ModelChoices::Image image = a.image;
  image.file = b.image.file;
  const bool depth_counts = a.tool || !a.supports.empty();
  return image == b.image && a.cut.text == b.cut.text && a.scheme == b.scheme &&
         a.cloud.spacing_mm == b.cloud.spacing_mm && a.cloud.rim == b.cloud.rim &&
         a.support_radius_factor == b.support_radius_factor && a.boundary == b.boundary &&
         a.base_is_held == b.base_is_held && a.tool_words.shape == b.tool_words.shape &&
         (!depth_counts || a.depth_mm == b.depth_mm) &&
         are_same(a.tissues, b.tissues, [](const auto& x, const auto& y) { return x.label == y.label; }) &&
         are_same(a.supports, b.supports,
                  [](const auto& x, const auto& y) { return x.on_words == y.on_words; }) &&
         are_same(a.further_tools, b.further_tools,
                  [](const auto& x, const auto& y) { return x.at_mm == y.at_mm; }) &&
         are_same(a.steps, b.steps, move_alike);
}

// And what nodes and points depend on besides.
bool asks_for_same_places(const Scene& a, const Scene& b) {
  return asks_for_same_site(a, b) && a.cloud == b.cloud && a.grid == b.grid;
}

// The organ that was read before, under the options of this case.
Organ taken_again(const Case& given, Result& result) {
  Organ organ = given.organ->organ;
  const double voxel_mm = organ.options.boundary.voxel_mm;
  organ.options = model_options(given.scene);
  organ.options.boundary.voxel_mm = voxel_mm;
  grade_to_size(organ.body->surface, organ.options);
  organ.site = {};  // the case may ask for another
  check_materials(given.scene, organ.options.scheme);
  check_words(organ.options.boundary);
  result = given.organ->read;
  result.stages = {};  // whose clock begins here
  result.stages.add(given.organ->read.stages);
  if (const auto& made = given.organ->made; made && asks_for_same_site(made->scene, given.scene)) {
    organ.site = made->site;
    result.build_s += made->site_s;
  }
  return organ;
}

// How far the body reaches along the push, from the middle of the tool's place [m].
double reach_beneath(const Discretisation& places) {
  return (places.X.transpose() * places.tool.push).maxCoeff() - places.tool.centre.dot(places.tool.push);
}

void require_room_beneath(const Scene& scene, const Discretisation& places) {
  const double beneath = reach_beneath(places);
  const double depth = deepest(scene, places.tool);
  require_tool_as_long(scene, 1e3 * depth);
  if (turns(scene)) require_tool_as_long_turned(scene, most_of_tool_below(scene, places.tool));
  if (depth >= beneath)
    throw ModelError(
        {.fact = fmt::format("an indentation of {} is deeper than the organ beneath the circle, {}",
                             length_in_words(1e3 * depth), length_in_words(1e3 * beneath)),
         .where = scene.steps.empty() ? "--depth (load.depth_mm)" : "step",
         .why = "the tool would come out on the other side",
         .remedy = "give a smaller --depth, or another place with --indent-at"});
}

// Where the contact's radius is less than four node spacings the force was up to 4 % too high, and where it
// is less than two up to 12 % (spheres beside finite elements).
void tell_of_first_touch(const RunLog& log, const Scene& scene, const Model& model, const Touch& touch) {
  constexpr double enough = 4.0;
  const double radius = enough * model.spacing.minCoeff(), depth = 1e-3 * scene.depth_mm;
  if (touch.shape.edge > 0.0) return;
  double until = depth;
  if (contact_radius(touch.shape, depth) > radius) {
    double low = 0.0;
    for (int k = 0; k < 40; ++k) {
      const double middle = 0.5 * (low + until);
      (contact_radius(touch.shape, middle) < radius ? low : until) = middle;
    }
  }
  if (until < 0.01 * depth) return;  // a flat end touches with all of it at once
  if (until < 0.2 * depth)
    return log.say(
        fmt::format("touch    up to a depth of {} the contact is less than {:g} node spacings in radius, and "
                    "the force may be 4 % too high there",
                    length_in_words(1e3 * until), enough));
  log.warn(
      fmt::format("up to a depth of {} the contact is less than {:g} node spacings in radius, and the "
                  "force was up to 12 % too high with such; give more --nodes",
                  length_in_words(1e3 * until), enough));
}

// Steps go from equilibrium to equilibrium, whatever they last.
void tell_of_fast_steps(const RunLog& log, const Result& result) {
  const double crossing = shear_crossing_time(result.tissues, result.model);
  for (const Step& step : result.loading.steps)
    if (step.lasts > 0.0 && step.lasts < slow_load * crossing && !step.holds())
      return log.warn(fmt::format(
          "the step '{}' lasts {:.3g} s, and a shear wave takes {:.3g} s through the organ: inertia, "
          "which is left out in steps, would take part in its force",
          step.name, step.lasts, crossing));
}

// Whatever decides that the march has inertia.
void check_without_equilibrium(const Scene& scene) {
  for (const Feature feature : {Feature::membrane, Feature::free_base, Feature::wall})
    check_pair(scene, feature, Feature::inertia);
}

// As scene.solver.time asks: "auto" looks at how long the load lasts.
TimeMode time_of(const Scene& scene, const RunLog& log, const Result& result) {
  using Time = Scene::Numerics::Time;
  const Time asked = scene.solver.time;
  if (asked == Time::quasi_static) return TimeMode::quasi_static;
  if (asked == Time::explicit_ || !result.model.scheme.pressure_patches) {
    check_without_equilibrium(scene);
    return TimeMode::explicit_;
  }
  Loading at_the_rate = result.loading;  // without what says how long it lasts
  std::erase_if(at_the_rate.steps, [](const Step& step) { return step.lasts > 0.0; });
  TimeMode mode = choose_time(result.model, result.tissues, at_the_rate);
  // Whoever names no speed asks for the force of equilibrium.
  if (!scene.given.rate || (!result.loading.steps.empty() && at_the_rate.steps.empty()))
    mode = TimeMode::quasi_static;
  if (mode != TimeMode::quasi_static && result.loading.touch)
    throw UsageError({.fact = "the tool is too fast for its contact to be solved for in equilibrium",
                      .where = "--rate (load.rate_mm_per_s)",
                      .why = "its force holds inertia, which is modelled for the circle alone",
                      .remedy = "give a lower --rate, or --time quasi-static"});
  if (mode != TimeMode::quasi_static && !scene.further_tools.empty())
    throw UsageError({.fact = "the load is too fast for the contact of further tools to be solved for",
                      .where = "--rate (load.rate_mm_per_s)",
                      .why = "contact is solved for in equilibrium, without inertia",
                      .remedy = "give a lower --rate, or --time quasi-static"});
  if (result.loading.touch) return mode;
  if (mode != TimeMode::quasi_static && !scene.steps.empty())
    throw UsageError({.fact = "the tool is too fast for a scene of steps",
                      .where = "--rate (load.rate_mm_per_s)",
                      .why = "its force holds inertia, and each step goes from an equilibrium to the next",
                      .remedy = "give a lower --rate, or --time quasi-static"});
  if (mode != TimeMode::quasi_static) check_without_equilibrium(scene);
  const double crossings = shear_crossings(result.model, result.tissues, result.loading);
  const bool shallow = mode == TimeMode::quasi_static && crossings < slow_load;
  log.line(mode == TimeMode::quasi_static && !shallow ? Line::detail : Line::said,
           time_in_words(mode, crossings, shallow));
  return mode;
}

// What only a march with inertia knows.
void tell_of_damping(const Scene& scene, const RunLog& log, TimeMode mode) {
  if (mode == TimeMode::quasi_static && scene.solver.damping_per_s > 0.0)
    log.warn(
        fmt::format("{} 1/s of damping is not used: the force is that of equilibrium at each depth, which "
                    "nothing damps (--time explicit does)",
                    plain(scene.solver.damping_per_s)));
}

std::unique_ptr<ForceSystem> force_system(const Scene& scene, Result& result) {
  const Stopwatch readying;
  auto system = std::make_unique<ForceSystem>(result.model, result.tissues, scene.solver.precision);
  result.model.dphi.resize(
      3, 0);  // the system has them in a layout of its own; twice is 0.4 GB at 100,000 nodes
  give_back_memory();
  stop_if_asked();
  result.complete_s += readying.seconds();
  return system;
}

// Where it was lifted, or slid beyond what it had touched.
void tell_of_lost_contact(const RunLog& log, const Result& result) {
  constexpr double nothing = 1e-6;  // of the largest force: the search for equilibrium has a tolerance
  const std::vector<ForceSample>& force = result.history.force;
  if (!result.loading.touch || force.empty()) return;
  const auto size = [](const ForceSample& sample) {  // one that sticks may pull, and across its push
    return Eigen::Map<const Wrench>(sample.on_tool.data()).head<3>().norm();
  };
  double largest = 0.0;
  for (const ForceSample& sample : force) largest = std::max(largest, size(sample));
  const auto last = std::find_if(force.rbegin(), force.rend(),
                                 [&](const ForceSample& sample) { return size(sample) > nothing * largest; });
  if (largest == 0.0 && force.size() > 1 && !result.history.interrupted)
    log.warn("the tool never touches the body: its force is 0 at every depth; check its place and direction");
  if (last != force.rend() && last != force.rbegin())
    log.say(
        fmt::format("touch    the tool has left the body: it touched last at a depth of {}, after {:.3g} s",
                    length_in_words(1e3 * last->depth), last->t));
}

// The force is said along the push; what of it is across is said where it is more than a little.
void tell_of_lateral_force(const RunLog& log, const Result& result) {
  constexpr double little = 0.2;
  if (result.history.force.empty()) return;
  const Eigen::Map<const Wrench> on_tool(result.history.force.back().on_tool.data());
  const double share = lateral_share(on_tool, result.model.tool.push);
  if (!(share > little)) return;
  const Written written = force_written(on_tool.head<3>().norm());
  log.say(fmt::format("across   {} of the force on the tool is across its push: x {}, y {}, z {} {} (LPS)",
                      percent(share), written.number(on_tool[0]), written.number(on_tool[1]),
                      written.number(on_tool[2]), written.unit));
}

// Of all that is rigid beside the tool: further tools and walls.
void tell_of_rigid(const RunLog& log, const Result& result) {
  for (std::size_t k = 0; k < result.history.walls.size(); ++k) {
    const Touch& rigid = result.loading.walls[k];
    const TouchingTool::Touched& now = result.history.walls[k];
    log.say(rigid.is_tool ? "tool     " + at_the_end_in_words(rigid.name, now)
                          : "wall     " + in_words(rigid.name, now));
  }
}

// What no step of the march sees alone: of a tool that touches, unless it is known why.
void find_jump(Result& result) {
  constexpr double much = 0.2;  // of the largest force
  History& history = result.history;
  if (!result.loading.touch ||
      std::any_of(history.guards.begin(), history.guards.end(), [](const Finding& f) {
        return f.report.code == "limit-point" || f.report.code == "tool-left";
      }))
    return;
  double largest = 0.0;
  for (const ForceSample& sample : history.force) largest = std::max(largest, std::abs(sample.force));
  const Jump jump = largest_jump(history.force);
  if (!(jump.force > much * largest)) return;
  const ForceSample& at = history.force[jump.sample];
  const Vec3 aside(at.aside[0], at.aside[1], at.aside[2]);
  history.guards.push_back(
      {{.fact = fmt::format("the force jumps by {:.0f} % of the largest from one equilibrium to the next",
                            100.0 * jump.force / largest),
        .where = fmt::format("t = {:.4g} s, indentation {:.4g} mm, {:.4g} mm across the push", at.t,
                             1e3 * at.depth, 1e3 * aside.norm()),
        .why = "few nodes touch the tool there, or it comes over an edge or a step of the surface",
        .remedy = "use more nodes (--nodes), a larger tool, or a shorter way; shorter steps (--set "
                  "solver.step_radii=0.05) show whether the force goes there smoothly",
        .code = "jagged"},
       jump.force / largest});
}

void keep_findings(const RunLog& log, Result& result) {
  for (const Finding& finding : result.history.guards)
    if (finding.is_minor)
      log.detail(in_words(finding));
    else
      log.warn(in_words(finding));
  result.findings.insert(result.findings.end(), result.history.guards.begin(), result.history.guards.end());
}

// What moves the place that is followed, in this model.
std::optional<Interpolation> to_followed(const Result& result) {
  if (!result.followed) return std::nullopt;
  return inner_interpolation(result.model, result.followed->place);
}

Vec3 displacement_at(const Interpolation& place, const ForceSystem::Nodal& u) {
  return place(u.topRows<3>()).col(0);
}

// A place that meets nothing may be on a piece that was dropped.
void find_site_on_kept(const Scene& scene, const RunLog& log, Organ& organ, Result& result) {
  try {
    find_site(scene, log, organ, result);
  } catch (const ModelError& error) {
    Report report = error.report;
    if (result.segment.pieces > 1 && report.where.starts_with("--indent-at"))
      report.why += fmt::format(
          "; the labels form {} pieces, and all but the largest were dropped: the place may be on one of "
          "them",
          result.segment.pieces);
    throw ModelError(report);
  }
}

}  // namespace

Organ organ_of(const Case& given, const RunLog& log, Result& result, std::optional<Organ>* before_cuts) {
  Organ organ =
      given.organ ? taken_again(given, result) : read_organ(given, model_options(given.scene), log, result);
  result.provenance = {{"image", name_of_image(given.scene)},
                       {"image_sha256", sha256_of_image(given.scene, result.image)}};
  if (before_cuts) *before_cuts = organ;
  result.stages.done("checksum");  // which is no part of finding the site
  find_site_on_kept(given.scene, log, organ, result);
  for (const std::string& warning : warnings_of_small_sheets(given.scene, organ.body->surface))
    log.warn(warning);
  return organ;
}

Placed place(const Case& given, const std::optional<Organ>& organ, const RunLog& log, Result& result) {
  if (!organ) {
    check_materials(given.scene, given.model->scheme);
    for (const std::string& note : given.model->notes) log.warn(note);
    say_default_stiffness(log, given.scene);
    result.provenance = given.model->provenance;
    result.facing_share = given.model->facing_share;
    return {given.model->places, given.model->scheme, given.model->label_names};
  }
  ModelOptions options = organ->options;
  take_nodes_for_band(given.scene, log, options, result);
  const ReadOrgan::Made* made = given.organ ? given.organ->made.get() : nullptr;
  if (made && !(organ->site == made->site && asks_for_same_places(made->scene, given.scene) &&
                made->nodes == options.cloud.count))
    made = nullptr;
  Placed placed{
      place_nodes(given.scene, *organ, options, result.image, log, result, made ? &made->at : nullptr),
      options.scheme, organ->label_names};
  if (made) result.build_s += made->places_s;
  if (result.nodes_for_band > 0)
    result.chosen["cloud.nodes"] += result.nodes_for_band == fewest_nodes_under_tool(given.scene)
                                        ? ", as the tool's edge asks for them and none were given"
                                        : ", as the body is folded and none were given";
  return placed;
}

Placed place(Index nodes, const Scene& scene, const Organ& organ, const LabelImage& image, const RunLog& log,
             Result& result) {
  ModelOptions options = organ.options;
  options.cloud.count = nodes;
  options.cloud.spacing_mm = 0.0;
  return {place_nodes(scene, organ, options, image, log, result), options.scheme, organ.label_names};
}

void complete(const Scene& scene, Placed placed, const RunLog& log, Result& result) {
  const Stopwatch completing;
  const TissueOptions tissues = tissues_of(scene, placed.label_names, placed.places, result.cut.labels);
  log.begin(Part::supports, scene);
  Eigen::VectorXi of_point = tissue_of_points(placed.places, tissues);
  result.model = make_model(std::move(placed.places), placed.scheme, std::move(of_point), tissues.density,
                            &result.stages);
  result.tissues = {materials_of(scene), result.model.tissue};
  tell_of_supports(log, result.model);
  result.complete_s = completing.seconds();
}

void stand_walls(const Case& given, const RunLog& log, Result& result) {
  if (given.scene.walls.empty()) return;
  log.doing("walls");
  const LabelImage& image = result.image.run.empty() && result.origin ? result.origin->image : result.image;
  Walls walls =
      walls_beside(given.scene, result.model, &image, result.origin ? &result.origin->organ : nullptr);
  for (const std::string& words : walls.words) log.say("wall     " + words);
  for (Touch& wall : walls.touch) result.loading.walls.push_back(std::move(wall));
  result.stages.done("walls");
}

// To where it first touches.
void bring_tool(const Scene& scene, const RunLog& log, Result& result) {
  const Model& model = result.model;
  const bool moved = result.loading.loads.move_the_body();
  if (moved) {
    log.doing("loads");
    const ForceSystem tissue(model, result.tissues, scene.solver.precision);
    rest_under_loads(tissue, model, result.loading, scene.solver.tolerance);
    result.stages.done("loads");
  }
  const Touch& touch = *result.loading.touch;
  log.say(fmt::format(
      "tool     {}{}, {}; its tip at first touch at {}{}; contact is looked for at {} parts of the "
      "surface",
      in_words(touch.shape), depth_of_tool_in_words(scene), friction_in_words(touch.friction),
      in_words(1e3 * touch.pose.tip), moved ? ", where the loads have moved it" : "", touch.surface.count()));
  if (touch.shape.mesh && touch.shape.mesh->turned)
    log.say("tool     some of its triangles faced inward in the file, and were turned");
  tell_of_first_touch(log, scene, model, touch);
}

// The shape functions smooth the step from one tissue to another. A soft layer on one a thousand times as
// stiff: 16 % too much force with 1500 nodes, 9 % with 6000.
void warn_of_stiff_tissue(const RunLog& log, const Tissues& tissues) {
  constexpr double like_bone = 50.0;
  const std::vector<Material> used = in_use(tissues);
  const auto [softest, stiffest] = std::minmax_element(
      used.begin(), used.end(), [](const Material& a, const Material& b) { return a.mu < b.mu; });
  if (used.empty() || !(stiffest->mu > like_bone * softest->mu)) return;
  log.warn(
      fmt::format("one tissue (mu {}) is {:.3g} times as stiff as another (mu {}): nodes too far apart for "
                  "the step between them "
                  "make the soft one too thin by a part of their spacing, and an equilibrium may not be "
                  "found; a tissue that hardly "
                  "bends is better held: --set support.bone.on=label:NAME",
                  stress_in_words(stiffest->mu), stiffest->mu / softest->mu, stress_in_words(softest->mu)));
}

// From places to a model that is complete, and a load that is accepted.
void make_ready(const Case& given, Placed placed, const RunLog& log, Result& result) {
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
    log.say("base     is not held: the body lies on its walls, by contact alone");
  }
  take_loads_off(scene, supports.sets, tissues_of(scene, names, result.model, result.cut.labels).density, log,
                 result);
  const Model& model = result.model;
  const Loading& loading = result.loading = loading_of(scene);
  result.loading.further = std::move(supports.sets);
  result.loading.loads =
      loads_of(scene, model, result.unloaded ? result.unloaded->imaged_surface : model.surface);
  OtherTools others = other_tools_of(scene, model, loading.further);
  for (const std::string& words : others.words) log.say("tool     " + words);
  std::map<std::string, Vec3> push_of_others;
  for (const Touch& other : others.touch) push_of_others[other.name] = other.pose.points_at;
  result.loading.steps = steps_of(scene, model.tool, push_of_others);
  require_near(loading.steps, model.X);
  if (!scene.poses_words.empty()) log.say("poses    " + scene.poses_words);
  for (const Step& step : result.loading.steps) log.say("step     " + in_words(step));
  result.loading.touch =
      given.change.tool ? touch_of(scene, model, *given.change.tool) : touch_of(scene, model);
  const double down = deepest(scene, model.tool);
  if (loading.touch) require_free_under(*loading.touch, down, loading.further, model);
  result.loading.walls = std::move(others.touch);
  result.time = time_of(scene, log, result);
  tell_of_damping(scene, log, result.time);
  tell_of_fast_steps(log, result);
  if (result.time == TimeMode::quasi_static || scene.self_contact == Scene::SelfContact::on)
    result.loading.folds = folds_of(scene, result.facing_share, model, down);
  if (result.loading.folds)
    log.say("folds    " + in_words(*result.loading.folds, down));
  else if (scene.self_contact == Scene::SelfContact::on)
    log.say(
        "folds    nothing can touch: the surface nowhere faces itself across twice the tool's way or less");
  stand_walls(given, log, result);
  if (loading.touch) bring_tool(scene, log, result);
  const SolverOptions options = solver_options(scene);
  result.findings = check_model(model, model.support_report, loading.depth);
  for (const Finding& finding : result.findings) log.warn(in_words(finding));
  auto own = scene.tissues.begin();
  for (std::size_t t = 0; t < result.tissues.material.size(); ++t) {
    const Material& m = result.tissues.material[t];
    const std::string label = t == 0 ? "" : (own++)->label;
    // The stiffness that nobody has chosen was told of before.
    log.line(t == 0 && !scene.given.stiffness ? Line::detail : Line::said,
             describe(result.tissues, t, label));
    log.detail(fmt::format("waves    kappa {}, so {:.2f} and {:.3f} m/s", stress_in_words(m.kappa),
                           pressure_wave_speed(m), shear_wave_speed(m)));
  }
  warn_of_stiff_tissue(log, result.tissues);
  if (const std::string preset = scene.material.beside_preset; !preset.empty()) log.say("preset   " + preset);
  for (const Membrane& film : loading.loads.membrane) log.say("membrane " + in_words(film));
  if (const std::string loads = in_words(loading.loads); !loads.empty())
    log.say("loads    " + loads + "; the body comes to rest under it first" +
            (relaxes(result.tissues.material) ? ", as tissue that has relaxed" : ""));
  log.detail(fmt::format("load     {} at {} mm/s: {} s, {}, {}", length_in_words(scene.depth_mm),
                         plain(scene.rate_mm_per_s), three_digits(loading.duration()),
                         !loading.touch                   ? std::string(name_of(scene.contact))
                         : loading.touch->friction == 0.0 ? "frictionless"
                                                          : friction_in_words(loading.touch->friction),
                         result.time == TimeMode::quasi_static
                             ? fmt::format("equilibrium in {} steps", steps_of_load(model, loading, options))
                             : "with inertia, by central differences"));
  if (is_as_printed(result.tissues.material.front())) {
    log.warn("the printed stress has no energy: energy.csv shows that of the consistent form");
    if (options.damping == 0.0)
      log.warn(
          "the printed stress does work on closed paths, so undamped vibration grows: give --damping, for "
          "instance 20");
  }
  if (result.time != TimeMode::quasi_static && scene.material.mu_spread > 0.0)
    throw UsageError(
        {.fact = "mu is given as known to a share of it, and inertia takes part in the force",
         .where = "--mu (material.mu_spread_percent)",
         .why = "the load is so short that the run is dynamic, and its force not proportional to mu",
         .remedy = "run it once with the smallest and once with the largest modulus, or slower"});
  result.spread = scene.material.mu_spread;
  result.model_warnings = result.warnings.size();
  ask_for_units(log, scene, result);
  result.complete_s = preparing.seconds();
}

// A place outside of the body moves nowhere. Throws UsageError.
std::optional<Followed> followed_in(const Scene& scene, const Organ& organ) {
  const std::optional<Vec3> place = scene.followed;
  if (!place) return std::nullopt;
  const BodySurface& surface = organ.body->surface;
  const Vec3 there = surface.to_world().inverse() * (*place * 1e3);
  if (!surface.contains(there)) {
    const BodySurface::Closest closest = surface.closest(there);
    throw UsageError({.fact = fmt::format("the place {} lies outside of the body", in_words(*place * 1e3)),
                      .where = "--quantity (accuracy.quantity)",
                      .why = fmt::format("its surface is {:.1f} mm away, at {}", closest.distance,
                                         in_words(surface.to_world() * closest.place)),
                      .remedy = "give a place of the body at rest, in LPS mm"});
  }
  return Followed{.place = *place};
}

namespace {

// What the supports feel where the tool is at that depth [m].
void feel_supports(const ForceSystem::Nodal& f, double depth, Result& result) {
  result.on_support.clear();
  for (const HeldSet& support : result.loading.further) result.on_support.push_back(force_on(support, f));
  result.on_support_at = depth;
}

}  // namespace

namespace {

// What is seen of one body while it is marched.
class Watched {
 public:
  Watched(const Scene& scene, const Observer& observer, const MarchState* from, Result& result)
      : result_(result),
        observer_(observer),
        hears_(observer),
        place_(to_followed(result)),
        bending_(result.model),
        rocking_(result.model),
        closing_(result.model, 1e-3 * scene.image.cut_gap_mm) {
    if (place_ && from && from->u.cols() > 0)
      result.followed->u = displacement_at(*place_, from->u);  // no frame may be left
    hears_.frame = [this](const Frame& frame) { see(frame); };
  }
  Watched(const Watched&) = delete;
  Watched& operator=(const Watched&) = delete;
  const Observer& hears() const { return hears_; }
  // Between the places where folds touch the banks of a cut are looked at too.
  void tell(const RunLog& log) {
    FoldContact::Audit& folds = result_.history.folds;
    const bool touch = result_.loading.folds != nullptr;
    folds.penetration = std::max(folds.penetration, touch ? closing_.deepest() : 0.0);
    const std::string bends = bending_.warning(), rocks = bends.empty() ? rocking_.warning() : bends;
    for (const std::string& warning : {rocks, touch ? std::string() : closing_.warning()})
      if (!warning.empty()) log.warn(warning);
    if (result_.loading.loads.move_the_body()) tell_of_settling(log);
  }

 private:
  // Far from the image's shape the image says little of the body.
  void tell_of_settling(const RunLog& log) const {
    const double way = 1e3 * result_.history.settled;
    log.say(fmt::format("settled  by {} at most, under the loads alone", length_in_words(way)));
    if (result_.unloaded) return;  // they bring it back to the image
    const Model& model = result_.model;
    const double size = 1e3 * (model.X.rowwise().maxCoeff() - model.X.rowwise().minCoeff()).minCoeff();
    if (way > 0.5 * size)
      log.warn(
          fmt::format("the loads alone move the body by up to {}, more than half of its smallest extent, {}: "
                      "it has little of the image's shape left; see whether the loads and moduli are right, "
                      "or say with load.imaged=loaded that the image shows it under them",
                      length_in_words(way), length_in_words(size)));
  }

  void see(const Frame& frame) {
    if (place_) result_.followed->u = displacement_at(*place_, frame.u);
    // The solver knows the nodes' parameters alone, which are no displacements.
    if (frame.number == 0 && result_.loading.loads.move_the_body())
      result_.history.settled = node_interpolation(result_.model)(frame.u).colwise().norm().maxCoeff();
    feel_supports(frame.f, frame.depth, result_);
    bending_.see(frame);
    rocking_.see(frame);
    closing_.see(frame);
    if (observer_.frame) observer_.frame(frame);
  }

  Result& result_;
  const Observer& observer_;
  Observer hears_;
  std::optional<Interpolation> place_;
  BendingOfPart bending_;
  RockingOfBody rocking_;
  ClosingCut closing_;
};

// The scene on one body after another.
std::unique_ptr<ForceSystem> march_cut(const Scene& scene, const SolverOptions& options,
                                       const Observer& observer, const MarchState* from, const RunLog& log,
                                       Result& result, CutScene& cuts, const RunObserver& watching) {
  ScenePart part = cuts.part(0);
  Observer later = observer;
  later.between_steps = {};  // a run that is taken up again makes its cuts again
  for (std::size_t k = 0;; ++k) {
    std::unique_ptr<ForceSystem> system = force_system(scene, result);
    {
      Watched watched(scene, k == 0 ? observer : later, k == 0 ? from : nullptr, result);
      part.has_settled = [&] { cuts.tell(part, log, result); };
      const Stopwatch solving;
      try {
        solve(result.time, *system, result.model, result.loading, options, watched.hears(), result.history,
              k == 0 ? from : nullptr, &part);
      } catch (...) {
        result.solve_s += solving.seconds();
        throw;
      }
      result.solve_s += solving.seconds();
      watched.tell(log);
    }
    if (k == cuts.count() || result.history.interrupted) return system;
    if (watching.before_cut) watching.before_cut(result);
    ScenePart next;
    cuts.cut(k, part, log, result, next);
    part = std::move(next);
    if (watching.after_cut) watching.after_cut(result);
  }
}

}  // namespace

std::unique_ptr<ForceSystem> march(const Scene& scene, const SolverOptions& options, const Observer& observer,
                                   const MarchState* from, const RunLog& log, Result& result, CutScene* cuts,
                                   const RunObserver* watching) {
  std::optional<Watched> watched;
  std::unique_ptr<ForceSystem> system;
  if (!cuts) {
    watched.emplace(scene, observer, from, result);
    system = force_system(scene, result);
  }
  const Stopwatch solving;
  try {
    unless_stopped([&] {
      if (cuts)
        system = march_cut(scene, options, observer, from, log, result, *cuts, *watching);
      else
        solve(result.time, *system, result.model, result.loading, options, watched->hears(), result.history,
              from);
    });
  } catch (const Stopped&) {
    result.history.interrupted = true;
  } catch (const Error&) {
    if (!cuts) result.solve_s = solving.seconds();
    keep_findings(log, result);  // they count also where the march ends by an error
    throw;
  }
  if (!cuts) result.solve_s = solving.seconds();
  find_jump(result);
  keep_findings(log, result);
  tell_of_lost_contact(log, result);
  tell_of_lateral_force(log, result);
  tell_of_rigid(log, result);
  warn_of_inertia(log, result);
  if (watched) watched->tell(log);
  return system;
}

std::shared_ptr<const ReadOrgan::Made> made_in(const Scene& scene, const Result& found) {
  if (has_cuts(scene) || found.unloaded || !found.origin || !scene.base_is_held) return {};
  ReadOrgan::Made made{.scene = scene,
                       .site = found.origin->organ.site,
                       .nodes = found.origin->organ.options.cloud.count,
                       .at = {.places = found.model, .report = found.report},
                       .site_s = found.stages.seconds("boundary"),
                       .places_s = found.report.stages.seconds("")};
  made.at.report.stages = {};
  return std::make_shared<const ReadOrgan::Made>(std::move(made));
}

std::shared_ptr<Origin> origin_of(const Scene& scene, Organ organ, const Result& result) {
  const auto of_image = result.warnings.begin() + static_cast<std::ptrdiff_t>(result.image_warnings);
  return std::make_shared<Origin>(Origin{.choices = scene,
                                         .organ = std::move(organ),
                                         .image = {},
                                         .facts = result,
                                         .image_warnings = {result.warnings.begin(), of_image},
                                         .boundary = result.report.boundary});
}

Scene with_model_of(const Scene& scene, const ModelChoices& made) {
  Scene result = scene;
  static_cast<ModelChoices&>(result) = made;
  return result;
}

}  // namespace dimple
