#include "apps/run/simulate.hpp"

#include <fmt/format.h>

#include <memory>
#include <utility>

#include "apps/run/cut_scene.hpp"
#include "apps/run/cuts.hpp"
#include "apps/run/folds.hpp"
#include "apps/run/image_error_of_run.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/membranes.hpp"
#include "apps/run/model_options.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/other_tools.hpp"
#include "apps/run/pipeline.hpp"
#include "apps/run/refine.hpp"
#include "apps/run/run_error_bounds.hpp"
#include "apps/run/run_words.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/unloaded.hpp"
#include "apps/run/walls.hpp"
#include "apps/scene/compatibility.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

// The case's own nodes, and for an image the source of further node sets. `before_cuts` gets the body as it
// is before anything is cut, for a scene whose later steps cut it again.
std::pair<NodePlacement, std::shared_ptr<Origin>> placed_by(const Case& given, const RunObserver& observer,
                                                            const RunLog& log, Result& result,
                                                            std::optional<Organ>* before_cuts = nullptr) {
  std::optional<Organ> organ;
  if (!given.model) organ = organ_of(given, log, result, before_cuts);
  NodePlacement placed = place(given, organ, log, result);
  std::shared_ptr<Origin> of_image;
  if (organ) of_image = origin_of(given.scene, std::move(*organ), result);
  if (observer.placed) observer.placed(placed.places, placed.scheme);
  return {std::move(placed), std::move(of_image)};
}

// Error bounds of the result by its discretisation come from a march on coarser nodes, which begins
// here beside the finer one. Null: there can be none, and the result says why.
std::unique_ptr<CoarserMarch> begin_error_bounds(const Case& given, Result& result) {
  const Scene scene = given.origin ? with_model_of(given.scene, given.origin->choices) : given.scene;
  result.error_bounds.unknown = why_no_error_bounds_after(scene, result);
  if (!result.error_bounds.known()) return {};
  result.error_bounds.unknown = "the run ended first";  // what stays if find_error_bounds() is never reached
  return std::make_unique<CoarserMarch>(scene, result);
}

void find_error_bounds(const Case& given, CoarserMarch& coarser, const RunLog& log, Result& result) {
  log.begin(Part::error_bounds, given.scene);
  RunErrorBounds found = error_bounds_of_run(given.scene, result, coarser);
  result.error_bounds = std::move(found.error_bounds);
  if (result.followed) result.followed->half = found.half_of_displacement;
  if (found.stopped) result.history.interrupted = true;
}

// Estimates the error by half a voxel of the image, and warns if it is large.
void find_image_error(const Scene& scene, const RunLog& log, Result& result) {
  result.image_error = image_error_of(scene, result);
  const History& history = result.history;
  if (history.force.empty()) return;
  const double discretisation = result.error_bounds.known() ? result.error_bounds.half.back() : 0.0;
  if (const std::string words = image_warning(result.image_error, history.force.back().force,
                                              history.force.back().depth, discretisation);
      !words.empty())
    log.warn(words);
}

// The case with the choices of the model that it begins with, except the number of nodes.
Case with_origin(const Case& given) {
  Case result = given;
  if (!given.origin) return result;
  result.scene = with_model_of(given.scene, given.origin->choices);
  result.scene.node_set.nodes = Scene::NodeSet{}.nodes;
  result.scene.node_set.spacing_mm = Scene::NodeSet{}.spacing_mm;
  return result;
}

// Source of the levels of a refinement: the image, or its data kept with a model in memory. Adds the facts of
// the image to the result.
std::shared_ptr<Origin> origin_of_levels(const Case& given, const RunLog& log, Result& result) {
  if (!given.model) {
    std::shared_ptr<Origin> origin = origin_of(given.scene, organ_of(given, log, result), result);
    origin->image = std::move(result.image);
    return origin;
  }
  auto origin = std::make_shared<Origin>(*given.origin);
  origin->choices = given.scene;
  refuse_without_error_bounds(why_no_labels(given.scene, *origin));
  check_materials(given.scene, given.model->scheme);
  static_cast<ImageFacts&>(result) = origin->facts;
  result.provenance = given.model->provenance;
  result.warnings = origin->image_warnings;
  result.image_warnings = result.warnings.size();
  say_default_stiffness(log, given.scene);
  return origin;
}

void report_how_it_ended(const Scene& scene, const Goal& goal, Refinement& found,
                         const RunObserver& observer) {
  Result& finest = found.finest->result;
  const RunLog log{observer, finest};
  const bool known = finest.error_bounds.known();
  const std::string why = found.stopped_short ? in_words(*found.stopped_short, goal) : "";
  if (found.stopped_short && (goal.fraction > 0.0 || goal.absolute > 0.0)) {
    const auto [value, half] = requested_for(found.levels.back(), finest);
    log.warn(shortfall_in_words(goal.text, known ? std::optional(half / value) : std::nullopt, why));
  } else if (found.stopped_short) {
    log.say("refine   " + why);
  }
  // More nodes narrow the error bounds down to a floor: so well two node sets agree by chance.
  const Index more = nodes_for_half_the_error(finest.model.node_count(), error_floor(scene));
  const bool would_fail = found.failed && more >= found.failed->nodes;
  if (known && !would_fail && more <= most_nodes_for_accuracy) log.say(next_half_in_words(found, more));
  if (goal.budget_s > 0.0)
    finest.chosen["accuracy.budget_s"] =
        fmt::format("another machine uses other nodes; to repeat this result: --budget 0 --nodes {}",
                    found.finest->requested);
}

void simulate_to(const Goal& goal, const Case& given, const RunObserver& observer, Result& result) {
  const Stopwatch whole;
  const RunLog log{observer, result};
  const Scene& scene = given.scene;
  refuse_without_error_bounds(why_no_error_bounds(scene));
  const std::shared_ptr<Origin> origin = origin_of_levels(given, log, result);
  result.followed = followed_in(scene, origin->organ);  // a structure whose displacement is wanted too
  const bool follows = result.followed.has_value();
  // Marches finer node sets until the error bounds are as narrow as the goal, or time or node sets run out.
  Refinement found = refine(
      given, goal, *origin, result, whole,
      {.marched = [&](int number,
                      const RefinementLevel& level) { log.say(level_in_words(number, level, follows)); },
       .failed = [&](int number, Index nodes,
                     const std::string& fact) { log.say(failure_in_words(number, nodes, fact)); },
       .of_march = observer});  // hears how each level begins; its frames are kept for replay()
  report_how_it_ended(scene, goal, found, observer);
  Result& finest = found.finest->result;
  finest.levels = std::move(found.levels);
  // Further node sets of this origin take their tissues from the image, if there are several, and their base
  // and bonded patch from the boundary.
  finest.image = scene.tissues.empty() ? std::move(origin->image) : origin->image;
  origin->boundary = finest.report.boundary;
  finest.origin = origin;
  const double others_s = found.seconds - found.finest->seconds;
  // The result becomes the finest level's, and the observer hears of it as if it had been the only one.
  replay(std::move(*found.finest), observer, result);
  result.error_bounds.seconds = others_s;  // the cost of the error bounds: the other levels
  find_image_error(scene, RunLog{observer, result}, result);
}

// Steps that cut before anything has moved, which the model has from the start.
void list_cuts_of_undeformed_body(const Scene& scene, Result& result) {
  const std::size_t all = cuts_of_undeformed_body(scene).size();
  for (const Scene::Step& step : scene.steps) {
    if (!step.cut) return;
    CutMade made{.name = step.name, .text = step.cut.text, .toughness_J_m2 = step.toughness_J_m2};
    // The area of several blades at rest is known as a sum only; the run reports it.
    if (all == 1) made.area_mm2 = result.cut.area_mm2, made.removed_mm3 = result.cut.removed_mm3;
    made.nodes = result.model.node_count();
    result.cuts.push_back(std::move(made));
  }
}

}  // namespace

void build_case(const Case& given, const RunObserver& observer, Result& result) {
  const RunLog log{observer, result};
  // The files of a model hold the nodes under one bonded patch, and no contacting tool.
  check_pairs(given.scene, Feature::model_in_memory);
  auto [placed, of_image] = placed_by(given, observer, log, result);
  complete(given.scene, std::move(placed), log, result);
  if (of_image) of_image->image = result.image;
  result.origin = of_image;
}

void simulate(const Case& given, const RunObserver& observer, Result& result) {
  check_pairs(given.scene, !given.model    ? Feature::run
                           : !given.origin ? Feature::solve
                                           : Feature::solve_in_memory);
  check_imaged(given.scene, given.model ? &*given.model : nullptr);
  check_goal(given.scene);
  if (given.model) {
    if (!given.origin && given.model->provenance.contains("cut") && !given.scene.membranes.empty())
      throw UsageError(
          {.fact = "a membrane is requested on the model of a cut body",
           .where = "membrane",
           .why = "the model's files do not mark the surface opened by the cut, which has no membrane",
           .remedy = "begin with the image: dimple run IMAGE --cut ... --membrane ..."});
  }
  if (const std::optional<Goal>& goal = given.scene.goal)
    return simulate_to(*goal, with_origin(given), observer, result);
  const RunLog log{observer, result};
  const Scene& scene = given.scene;
  std::optional<Organ> before_cuts;
  auto [placed, of_image] = placed_by(given, observer, log, result, &before_cuts);
  result.origin = of_image ? of_image : given.origin;
  if (given.origin) static_cast<ImageFacts&>(result) = given.origin->facts;
  if (result.origin) result.followed = followed_in(scene, result.origin->organ);
  make_ready(given, std::move(placed), log, result);  // complete(), and what a march needs besides
  require_tools_apart(result.loading);
  if (const std::string words = tool_in_wall(scene, result.model, result.loading); !words.empty())
    log.warn(words);
  list_cuts_of_undeformed_body(scene, result);
  stop_if_requested();
  log.begin(Part::solving, scene);
  if (observer.begin) observer.begin(result);
  std::optional<CutScene> cuts;
  if (before_cuts && !cuts_after_moves(scene).empty()) cuts.emplace(given, std::move(*before_cuts));
  // Models after cuts, and further node sets, read the labels of tissues and walls from the image.
  if (of_image && (cuts || !scene.tissues.empty() || !scene.walls.empty()))
    of_image->image = std::move(result.image);
  result.image = {};  // the march does not
  const std::unique_ptr<CoarserMarch> coarser =
      given.error_bounds ? begin_error_bounds(given, result) : nullptr;
  // Makes the System of the result's model and takes it through the load, or each step of the scene, by the
  // march that the time mode asks for; where a step cuts, `cuts` makes the next model, of which the observer
  // is told.
  march(scene, solver_options(scene), observer.march, given.from, log, result, cuts ? &*cuts : nullptr,
        &observer);
  if (coarser && !result.history.interrupted) find_error_bounds(given, *coarser, log, result);
  find_image_error(scene, log, result);
}

Result simulate(const Case& given, const RunObserver& observer) {
  Result result;
  simulate(given, observer, result);
  return result;
}

}  // namespace dimple
