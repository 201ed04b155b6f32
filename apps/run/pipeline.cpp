#include "apps/run/pipeline.hpp"

#include <fmt/format.h>

#include <utility>

#include "apps/run/cuts.hpp"
#include "apps/run/grading.hpp"
#include "apps/run/model_options.hpp"
#include "apps/run/run_words.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "io/error.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

// Without --nodes, a folded body gets as many as its error bounds need, and a punch as its edge needs.
void raise_node_count(const Scene& scene, const RunLog& log, ModelOptions& options, LoadedModel& result) {
  const Index of_tool = fewest_nodes_under_tool(scene),
              of_body = fewest_nodes_with_error_bounds(result.facing_fraction),
              fewest = std::max(of_tool, of_body);
  if (scene.given.nodes || !options.scheme.pressure_patches || options.node_set.count >= fewest) return;
  log.say(of_tool >= of_body
              ? nodes_for_edge_in_words(fewest, options.node_set.count)
              : nodes_for_error_bounds_in_words(fewest, options.node_set.count, result.facing_fraction));
  options.node_set.count = result.required_nodes = fewest;
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
// a bonded patch is in contact with all of its area.
bool asks_for_same_site(const Scene& a, const Scene& b) {
  ModelChoices::Image image = a.image;
  image.file = b.image.file;
  const bool depth_counts = a.tool || !a.supports.empty();
  return image == b.image && a.cut.text == b.cut.text && a.scheme == b.scheme &&
         a.node_set.spacing_mm == b.node_set.spacing_mm && a.node_set.patch_edge == b.node_set.patch_edge &&
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
  return asks_for_same_site(a, b) && a.node_set == b.node_set && a.grid == b.grid;
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

// A place that meets nothing may be on a piece that was dropped.
void find_site_on_kept(const Scene& scene, const RunLog& log, Organ& organ, LoadedModel& result) {
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

NodePlacement place(const Case& given, const std::optional<Organ>& organ, const RunLog& log, Result& result) {
  if (!organ) {
    check_materials(given.scene, given.model->scheme);
    for (const std::string& note : given.model->notes) log.warn(note);
    say_default_stiffness(log, given.scene);
    result.provenance = given.model->provenance;
    result.facing_fraction = given.model->facing_fraction;
    return {given.model->places, given.model->scheme, given.model->label_names};
  }
  ModelOptions options = organ->options;
  raise_node_count(given.scene, log, options, result);
  const PreparedOrgan::Made* made = given.organ ? given.organ->made.get() : nullptr;
  if (made && !(organ->site == made->site && asks_for_same_places(made->scene, given.scene) &&
                made->nodes == options.node_set.count))
    made = nullptr;
  NodePlacement placed{
      place_nodes(given.scene, *organ, options, result.image, log, result, made ? &made->at : nullptr),
      options.scheme, organ->label_names};
  if (made) result.build_s += made->places_s;
  if (result.required_nodes > 0)
    result.chosen["cloud.nodes"] += result.required_nodes == fewest_nodes_under_tool(given.scene)
                                        ? ", as the tool's edge needs them and none were given"
                                        : ", as the body is folded and none were given";
  return placed;
}

NodePlacement place(Index nodes, const Scene& scene, const Organ& organ, const LabelImage& image,
                    const RunLog& log, Result& result) {
  ModelOptions options = organ.options;
  options.node_set.count = nodes;
  options.node_set.spacing_mm = 0.0;
  return {place_nodes(scene, organ, options, image, log, result), options.scheme, organ.label_names};
}

void complete(const Scene& scene, NodePlacement placed, const RunLog& log, LoadedModel& result) {
  const Stopwatch completing;
  const TissueOptions tissues = tissues_of(scene, placed.label_names, placed.places, result.cut.labels);
  log.begin(Part::supports, scene);
  Eigen::VectorXi of_point = tissue_of_points(placed.places, tissues);
  result.model = make_model(std::move(placed.places), placed.scheme, std::move(of_point), tissues.density,
                            &result.stages);
  result.tissues = {materials_of(scene), result.model.tissue};
  report_supports(log, result.model);
  result.complete_s = completing.seconds();
}

// A place outside of the body moves nowhere. Throws UsageError.
std::optional<Followed> followed_in(const Scene& scene, const Organ& organ) {
  const std::optional<Vec3> place = scene.followed;
  if (!place) return std::nullopt;
  const BodySurface& surface = organ.body->surface;
  const Vec3 there = surface.to_world().inverse() * (*place * 1e3);
  if (!surface.contains(there)) {
    const BodySurface::Closest closest = surface.closest(there);
    throw UsageError({.fact = fmt::format("the place {} is outside of the body", in_words(*place * 1e3)),
                      .where = "--quantity (accuracy.quantity)",
                      .why = fmt::format("its surface is {:.1f} mm away, at {}", closest.distance,
                                         in_words(surface.to_world() * closest.place)),
                      .remedy = "give a place of the body at rest, in LPS mm"});
  }
  return Followed{.place = *place};
}

std::shared_ptr<const PreparedOrgan::Made> made_in(const Scene& scene, const LoadedModel& found) {
  if (has_cuts(scene) || found.unloaded || !found.origin || !scene.base_is_held) return {};
  PreparedOrgan::Made made{.scene = scene,
                           .site = found.origin->organ.site,
                           .nodes = found.origin->organ.options.node_set.count,
                           .at = {.places = found.model, .report = found.report},
                           .site_s = found.stages.seconds("boundary"),
                           .places_s = found.report.stages.seconds("")};
  made.at.report.stages = {};
  return std::make_shared<const PreparedOrgan::Made>(std::move(made));
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
