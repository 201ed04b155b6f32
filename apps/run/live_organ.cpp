// An organ under a live tool: its nodes at a place, the sessions on them and their cuts.
#include <fmt/format.h>

#include <algorithm>

#include "apps/run/cuts.hpp"
#include "apps/run/live.hpp"
#include "apps/run/live_making.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/model_options.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/tool_error_bounds.hpp"
#include "apps/scene/compatibility.hpp"
#include "io/error.hpp"
#include "preprocess/output/carry_back.hpp"

namespace dimple {

LiveOrgan read_live_organ(const Scene& scene, const RunObserver& observer) {
  LiveOrgan live{.scene = scene, .result = {}};
  const RunLog log{observer, live.result};
  check_pairs(scene, Feature::by_hand);
  if (scene.tool) check_pairs(scene, Feature::contacting_tool_by_hand);
  live.scene.self_contact = Scene::SelfContact::off;
  live.organ.emplace(read_organ({.scene = live.scene}, model_options(scene), log, live.result));
  live.materials = materials_of(scene);
  live.shape = live.scene.tool;
  live.base = find_boundary(live.organ->body->surface, live.organ->options.boundary);
  for (const std::string& warning : live.base->warnings) log.warn(warning);
  return live;
}

Site site_at(const LiveOrgan& live, const std::optional<Vec3>& tip) {
  ModelOptions options = live.organ->options;
  if (tip)
    options.boundary.indent_at = fmt::format("{},{},{}", 1e3 * tip->x(), 1e3 * tip->y(), 1e3 * tip->z());
  return find_site(live.organ->body->surface, options, live.base ? &*live.base : nullptr);
}

SessionGiven given_of(const LiveOrgan& live) {
  const SegmentedBody& body = *live.organ->body;
  return {live.scene, live.materials, live.organ->label_names, &body.surface, body.report.step_mm};
}

namespace {

// Nodes by which a piece of the body is held.
std::vector<Index> held_nodes(const SessionGiven& given, const Model& model) {
  std::vector<Index> held = model.base;
  if (!given.scene.tool && given.scene.contact == Contact::bonded)
    held.insert(held.end(), model.bonded_patch.begin(), model.bonded_patch.end());
  for (const HeldSet& set : supports_of(given.scene, model, given.label_names).sets)
    if (set.hold == HeldSet::Hold::all) held.insert(held.end(), set.node.begin(), set.node.end());
  return held;
}

// A bonded patch would hold both faces of a cut.
void refuse_under_patch(const SessionGiven& given, const Model& model, const Sheet& sheet) {
  if (given.scene.tool || given.scene.contact != Contact::bonded) return;
  for (const Index a : model.bonded_patch)
    if (sheet.between(model.X.col(a), model.X.col(model.bonded_patch.front())))
      throw ModelError({.fact = "the cut passes under the bonded patch",
                        .where = "cut",
                        .why = "the nodes of the patch would hold both faces of the cut",
                        .remedy = "cut elsewhere, or use a contacting tool: --tool sphere:5mm",
                        .code = "cut"});
}

SheetCut cut_model(const SessionGiven& given, const Model& model, const std::shared_ptr<const Sheet>& sheet) {
  refuse_under_patch(given, model, *sheet);
  const std::vector<double> density = tissues_of(given.scene, given.label_names, model).density;
  return cut_by_sheet(model, sheet, density, held_nodes(given, model));
}

}  // namespace

Session session_on(const SessionGiven& given, Model model) {
  Loads loads = loads_of(given.scene, model, model.surface);
  std::shared_ptr<const RigidBody> its_indenter = indenter_of(given.scene, model);
  std::vector<HeldSet> supports = supports_of(given.scene, model, given.label_names).sets;
  return Session(std::move(model), given.materials,
                 {.contact = given.scene.contact,
                  .precision = given.scene.solver.precision,
                  .tolerance = given.scene.solver.tolerance,
                  .further = std::move(supports),
                  .loads = std::move(loads),
                  .indenter = std::move(its_indenter)});
}

Session session_of(const LiveOrgan& live, Index nodes, const Site& site, const Sheets& sheets,
                   Index* left_out) {
  ModelOptions options = live.organ->options;
  options.node_set.count = nodes;
  options.node_set.spacing_mm = 0.0;
  const LabelAt label_at = labels_of(live.scene, *live.organ, live.result.image);
  Discretisation places = discretise(live.organ->body->surface, options, label_at, site).places;
  const TissueOptions tissues = tissues_of(live.scene, live.organ->label_names, places);
  Eigen::VectorXi tissue = tissue_of_points(places, tissues);
  Model model = make_model(std::move(places), options.scheme, std::move(tissue), tissues.density);
  for (const std::shared_ptr<const Sheet>& sheet : sheets) try {
      model = cut_model(given_of(live), model, sheet).model;
    } catch (const ModelError&) {
      if (left_out) ++*left_out;
    }
  return session_on(given_of(live), std::move(model));
}

namespace {

// Forces at equilibria to one radius, for a contacting tool to 0.8, as far as they exist.
std::vector<ForceSample> forces_to_radius(Session& session) {
  const double deepest = (session.indenter() ? deepest_with_tool_error_bounds : 1.0) * session.tool().radius;
  std::vector<ForceSample> curve = {{}};
  for (int k = 1; k <= 4; ++k) {
    const LiveFrame frame = session.follow(0.25 * k * deepest, {.evaluations = 500});
    if (frame.tool != LiveFrame::Tool::there) break;
    curve.push_back({.t = 0.0, .depth = frame.depth, .force = frame.force, .base_force = frame.force});
  }
  session.lift();
  return curve;
}

}  // namespace

TriedContact try_contact(const LiveOrgan& live, Index nodes, const Site& site, const Sheets& sheets) {
  Index left_out = 0;
  TriedContact tried{.session = session_of(live, nodes, site, sheets, &left_out), .cuts = sheets.size()};
  tried.left_out = left_out;
  std::vector<ForceSample> fine = forces_to_radius(tried.session);
  // The bounds are calibrated for no other scene; for contacting tools with other node sets.
  if (!has_tool_alone(live.scene) || tried.session.indenter() || !sheets.empty()) return tried;
  if (nodes < fewest_nodes_with_error_bounds(live.result.facing_fraction) || fine.size() < 2) return tried;
  Session coarse = session_of(live, std::max(first_nodes, nodes / 4), site);
  std::vector<ForceSample> its = forces_to_radius(coarse);
  fine.resize(std::min(fine.size(), its.size()));
  its.resize(fine.size());
  if (fine.size() > 1) tried.fine = std::move(fine), tried.coarse = std::move(its);
  return tried;
}

CutSession cut_session(const SessionGiven& given, const Model& before, const Points& u,
                       const Stroke& stroke) {
  constexpr double fields = 6.0;  // along a stroke, so that a short one may bend too
  const double step = std::max({given.step_mm, 1e3 * (stroke.to - stroke.from).norm() / fields, 1e-3});
  const TriangleMesh blade = reference_stroke(1e3 * stroke.from, 1e3 * stroke.to, 1e3 * stroke.depth, step,
                                              before, u, *given.undeformed);
  const auto sheet = std::make_shared<const Sheet>(1e-3 * blade.vertex, blade.triangles);
  SheetCut cut = cut_model(given, before, sheet);
  Session session = session_on(given, std::move(cut.model));
  return {std::move(session), sheet, std::move(cut)};
}

}  // namespace dimple
