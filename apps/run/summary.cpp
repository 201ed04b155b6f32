#include "apps/run/summary.hpp"

#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "apps/run/organ.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/verdict.hpp"
#include "apps/run/words.hpp"
#include "solver/march/steps.hpp"
namespace dimple {
namespace {

Json three(const Vec3& v) {
  return Json::array({v.x(), v.y(), v.z()});
}

Json stages_json(const StageTimes& stages) {
  Json result = Json::object();
  for (const auto& [name, s] : stages.seconds()) result[name] = s;
  return result;
}

Json labels_json(const std::vector<LabelMeasure>& labels) {
  Json result = Json::array();
  for (const LabelMeasure& l : labels)
    result.push_back(
        {{"value", l.value}, {"name", l.name}, {"voxels", l.voxels}, {"volume_mm3", l.volume_mm3}});
  return result;
}

Json cavities_json(const std::vector<Cavity>& cavities) {
  Json list = Json::array();
  for (const Cavity& c : cavities)
    list.push_back({{"volume_mm3", c.volume_mm3}, {"centre_mm", three(c.centre_mm)}, {"filled", c.filled}});
  return list;
}

Json cut_json(const ImageFacts::Cut& cut) {
  Json parted = Json::array();
  for (const CutPiece& piece : cut.parted)
    parted.push_back({{"volume_mm3", piece.volume_mm3}, {"centre_mm", three(piece.centre)}});
  return {{"area_mm2", cut.area_mm2},
          {"removed_mm3", cut.removed_mm3},
          {"labels_taken_out", labels_json(cut.labels)},
          {"parted", parted}};
}

Json model_json(const LoadedModel& p) {
  const ModelReport& r = p.report;
  return {{"organ_volume_mm3", p.segment.voxel_volume_mm3},
          {"surface_volume_mm3", r.surface_volume_mm3},
          {"grid_volume_mm3", r.grid_volume_mm3},
          {"pieces", p.segment.pieces},
          {"dropped_volume_mm3", p.segment.dropped_volume_mm3},
          {"closed_volume_mm3", p.closed_mm3},
          {"cut", cut_json(p.cut)},
          {"facing_share", p.facing_fraction},
          {"nodes_for_band", p.required_nodes},
          {"cavities", cavities_json(p.segment.cavities)},
          {"surface_step_mm", p.segment.step_mm},
          {"smoothing_mm", p.segment.smoothing_mm},
          {"node_spacing_mm", r.spacing_mm},
          {"rim_spacing_mm", r.patch_edge_spacing_mm},
          {"largest_spacing_mm", r.largest_spacing_mm},
          {"cell_mm", r.cell_mm},
          {"evenness",
           {{"nearest_mean", r.evenness.mean},
            {"nearest_spread", r.evenness.spread},
            {"nearest_min", r.evenness.minimum},
            {"fill_distance", r.evenness.fill}}},
          {"circle_rim_nodes", r.patch_edge_nodes},
          {"base_reason", r.boundary.base_reason},
          {"circle_reason", r.boundary.patch_reason},
          {"image_read_s", p.read_s},
          {"model_build_s", p.build_s}};
}

Json counts_json(const Model& model) {
  return {{"nodes", model.node_count()},
          {"integration_points", model.point_count()},
          {"base_nodes", model.base.size()},
          {"circle_nodes", model.bonded_patch.size()},
          {"circle_centre_mm", three(model.tool.centre * 1e3)},
          {"push", three(model.tool.approach)},
          {"circle_diameter_mm", 2e3 * model.tool.radius}};
}

// A contacting tool has no bonded patch.
void add_contact(Json& summary, const RigidBody& indenter, const History& history) {
  for (const char* key : {"circle_nodes", "circle_centre_mm", "circle_diameter_mm"})
    summary["counts"].erase(key);
  const ToolShape& shape = indenter.shape;
  Json tool = {{"words", in_words(shape)}, {"radius_mm", 1e3 * shape.radius}};
  for (const ToolLength& length : lengths_of(shape))
    tool[length.name + "_" + length.unit] = length.in_unit(length.value);
  if (shape.mesh) {
    tool["file"] = shape.mesh->name;
    tool["triangles"] = shape.mesh->triangles.cols();
    tool["volume_mm3"] = shape.mesh->volume_mm3;
    tool["length_mm"] = 1e3 * shape.mesh->length;
    tool["distances_every_mm"] = 1e3 * shape.mesh->distance.step;
  }
  tool["first_touch_mm"] = three(1e3 * indenter.pose.tip);
  tool["contact_samples"] = indenter.surface.count();
  tool["samples_in_contact"] = history.contact_samples;
  tool["contact_area_mm2"] = 1e6 * history.contact_area;
  if (indenter.friction > 0.0) {
    tool["friction"] = std::isinf(indenter.friction) ? Json("stick") : Json(indenter.friction);
    tool["sticking_area_mm2"] = 1e6 * history.no_slip_area;
    tool["slipping_area_mm2"] = 1e6 * (history.contact_area - history.no_slip_area);
    if (!history.force.empty())
      tool["lateral_force_N"] = lateral_force(history.force.back(), indenter.pose.points_at);
    tool["friction_heat_J"] = history.contact_dissipation;
  }
  tool["largest_pressure_Pa"] = history.contact_pressure;
  tool["largest_penetration_mm"] = 1e3 * history.penetration;
  summary["tool"] = tool;
}

void add_folds(Json& summary, const FoldFaces& fold_faces, const FoldContact::Audit& at_end) {
  summary["self_contact"] = {{"places", fold_faces.count()},
                             {"places_that_touch", at_end.in_contact},
                             {"area_that_touches_mm2", 1e6 * at_end.area},
                             {"sum_of_forces_N", at_end.force},
                             {"largest_penetration_mm", 1e3 * at_end.penetration},
                             {"farthest_slid_mm", 1e3 * at_end.slid}};
}

void add_friction(Json& its, const RigidBody& rigid, const RigidContact::ContactSummary& now) {
  if (!(rigid.friction > 0.0)) return;
  its["friction"] = std::isinf(rigid.friction) ? Json("stick") : Json(rigid.friction);
  its["sticking_area_mm2"] = 1e6 * now.no_slip;
  its["slipping_area_mm2"] = 1e6 * (now.area - now.no_slip);
  its["friction_heat_J"] = now.dissipation;
}

Json other_tool_json(const RigidBody& tool, const RigidContact::ContactSummary& now) {
  Json its = {{"words", in_words(tool.shape)},
              {"first_touch_mm", three(1e3 * tool.pose.tip)},
              {"points_along", three(tool.pose.points_at)},
              {"force_on_tool_N", three(now.force)},
              {"force_size_N", now.force.norm()},
              {"moment_on_tool_Nm", three(now.moment)},
              {"samples_in_contact", now.samples},
              {"contact_area_mm2", 1e6 * now.area},
              {"largest_pressure_Pa", now.pressure},
              {"largest_penetration_mm", 1e3 * now.penetration}};
  add_friction(its, tool, now);
  return its;
}

Json wall_json(const RigidBody& wall, const RigidContact::ContactSummary& now) {
  const Eigen::VectorXd& back = wall.gap_offset;
  Json its = {
      {"places", wall.surface.count()},
      {"places_that_touch", now.samples},
      {"force_N", three(now.force)},
      {"force_size_N", now.force.norm()},
      {"area_that_touches_mm2", 1e6 * now.area},
      {"largest_penetration_mm", 1e3 * now.penetration},
      {"largest_overlap_at_rest_mm", back.size() > 0 ? 1e3 * (back.maxCoeff() - back.minCoeff()) : 0.0}};
  add_friction(its, wall, now);
  return its;
}

// Adds the contact of the other rigid tools and of the walls at the end.
void add_rigid(Json& summary, const Result& result) {
  const std::vector<RigidContact::ContactSummary>& at_end = result.history.walls;
  for (std::size_t k = 0; k < result.loading.walls.size(); ++k) {
    const RigidBody& rigid = result.loading.walls[k];
    const RigidContact::ContactSummary now = k < at_end.size() ? at_end[k] : RigidContact::ContactSummary{};
    summary[rigid.is_tool ? "other_tools" : "walls"][rigid.name] =
        rigid.is_tool ? other_tool_json(rigid, now) : wall_json(rigid, now);
  }
}

// `label` is empty for the material of all other labels.
Json material_json(const Material& m, const std::string& label, Index points, bool is_default) {
  const LawWords law = words_of(m);
  Json terms = Json::array(), relaxing = Json::array();
  for (const auto& term : law.terms) {
    Json numbers = Json::object();
    for (const auto& [name, value] : term) numbers[name] = value;
    terms.push_back(numbers);
  }
  for (const PronyTerm& term : m.prony) relaxing.push_back({{"g", term.g}, {"tau_s", term.tau}});
  Json result = {{"label", label.empty() ? "all others" : label},
                 {"points", points},
                 {"law", law.name},
                 {"mu_Pa", m.mu},
                 {"nu", poisson_ratio(m)},
                 {"kappa_Pa", m.kappa},
                 {"density_kg_per_m3", m.density},
                 {"default", is_default}};
  if (!terms.empty()) result[law.name] = terms;
  if (!relaxing.empty()) result["prony"] = relaxing;
  return result;
}

Json materials_json(const Scene& scene, const Tissues& tissues) {
  Json result = Json::array();
  auto own = scene.tissues.begin();
  for (std::size_t t = 0; t < tissues.material.size(); ++t) {
    const auto points = (tissues.of_point.array() == static_cast<int>(t)).count();
    result.push_back(material_json(tissues.material[t], t == 0 ? "" : (own++)->label, points,
                                   t == 0 && !scene.given.stiffness));
  }
  return result;
}

Json support_json(const SupportReport& support) {
  return {
      {"fewest", support.fewest}, {"most", support.most}, {"mean", support.mean}, {"grown", support.grown}};
}

Json consistency_json(const ConsistencyReport& consistency) {
  return {
      {"before", consistency.before}, {"after", consistency.after}, {"iterations", consistency.iterations}};
}

// Error bounds of the last force.
Json error_bounds_json(const ErrorBounds& error_bounds, const History& history) {
  if (!error_bounds.known()) return {{"unknown", error_bounds.unknown}};
  const double force = history.force.back().force, half = error_bounds.half.back();
  return {{"low_N", lower_bound(force, half, error_bounds.contacting)},
          {"high_N", force + half},
          {"half_N", half},
          {"of", "discretisation"},
          {"coarser_nodes", error_bounds.coarse_nodes}};
}

}  // namespace

Json image_error_json(const ImageError& error) {
  if (!error.known()) return {{"unknown", error.unknown}};
  return {{"half_N", error.half.back()},
          {"shape_N", error.shape},
          {"thickness_N", error.thickness},
          {"voxel_mm", 1e3 * error.voxel}};
}

namespace {

// Displacement at the last depth, with its error bounds.
Json displacement_json(const Followed& followed, const ErrorBounds& error_bounds) {
  Json result = {{"place_mm", three(followed.place * 1e3)},
                 {"displacement_mm", three(followed.u * 1e3)},
                 {"length_mm", 1e3 * followed.u.norm()}};
  if (error_bounds.known()) {
    result["coarser_nodes"] = error_bounds.coarse_nodes;
    result["half_mm"] = 1e3 * followed.half;
  }
  return result;
}

}  // namespace

std::string as_text(const Json& json) {
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Json report_json(const Report& r) {
  return {{"code", r.code}, {"fact", r.fact}, {"where", r.where}, {"why", r.why}, {"remedy", r.remedy}};
}

Json summary_of_image(const Scene& scene, const LoadedModel& result) {
  Json summary;
  summary["image"] = name_of_image(scene);
  summary["image_sha256"] = result.provenance.at("image_sha256");
  summary["image_read_as"] = result.image_words;
  summary["labels"] = labels_json(result.labels);
  summary["model"] = model_json(result);
  return summary;
}

Json summary_of_model(const ModelChoices& choices, const Result& result) {
  Json summary = model_json(result);
  summary["version"] = DIMPLE_VERSION;
  summary["image"] = name_of_image(choices);
  summary["labels"] = labels_json(result.labels);
  summary["scheme"] = result.model.scheme.name;
  summary["consistency"] = consistency_json(result.model.consistency_report);
  summary["preprocess_wall_s"] = stages_json(result.stages);
  summary["counts"] = counts_json(result.model);
  summary["support"] = support_json(result.model.support_report);
  summary["warnings"] = result.warnings;
  return summary;
}

std::vector<std::pair<std::string, double>> times_of(const LoadedModel& result, double read_s) {
  const double surface_s = result.stages.seconds("close gaps") + result.stages.seconds("surface");
  return {{"reading", read_s + result.read_s},
          {"surface", surface_s},
          {"cloud", std::max(0.0, result.build_s - surface_s)},
          {"supports", result.complete_s}};
}

double evaluations_of(const History& history) {
  return static_cast<double>(history.evaluations + history.extra_evaluations);
}

// Displacement of a support when on_support was recorded [m].
Vec3 displacement_of_support(const Result& result, const HeldSet& support) {
  const Loading& loading = result.loading;
  if (loading.steps.empty()) return result.on_support_at * support.fraction * support.direction;
  const double t = result.history.force.empty() ? 0.0 : result.history.force.back().t;
  return moved_at(t, loading.steps, loading.rate, support.name);
}

namespace {

Json cut_step_json(const CutMade& made) {
  Json one = {{"name", made.name},
              {"cut", made.text},
              {"time_s", made.t},
              {"indentation_mm", 1e3 * made.depth},
              {"area_mm2", made.area_mm2},
              {"removed_mm3", made.removed_mm3},
              {"force_before_N", made.force_before},
              {"force_N", made.force},
              {"stored_before_J", made.stored_before},
              {"released_J", made.released},
              {"nodes", made.nodes}};
  if (made.area_mm2 > 0.0) one["released_J_per_m2"] = 1e6 * made.released / made.area_mm2;
  if (made.toughness_J_m2 > 0.0) {
    one["toughness_J_m2"] = made.toughness_J_m2;
    if (made.area_mm2 > 0.0) one["work_of_blade_J"] = made.work_of_blade();
  }
  return one;
}

}  // namespace

// State after each step that was done, as far as the run came.
Json steps_json(const Result& result) {
  Json list = Json::array();
  double ended = 0.0;  // [s]
  std::size_t moved = 0;
  for (const CutMade& made : result.cuts)
    if (made.after == 0) list.push_back(cut_step_json(made));
  for (const Step& step : result.loading.steps) {
    const Vec3 displacement = 1e3 * step.displacement + Vec3::Zero();
    const double began = ended, t = ended += step.seconds(result.loading.rate);
    double largest = 0.0;
    Json one = {{"name", step.name},
                {"moves", step.moves.empty() ? "tool" : step.moves},
                {"move_mm", {displacement.x(), displacement.y(), displacement.z()}}};
    if (step.turns()) one["turn_deg"] = three(180.0 / std::numbers::pi * step.turn);
    if (step.about) one["about_mm"] = three(1e3 * *step.about);
    for (const ForceSample& sample : result.history.force) {
      if (sample.t >= began * (1.0 - 1e-9) && sample.t <= t * (1.0 + 1e-9))
        largest = std::max(largest, std::abs(sample.force));
      if (std::abs(sample.t - t) <= 1e-9 * t) {
        one["time_s"] = sample.t;
        one["indentation_mm"] = 1e3 * sample.depth;
        one["force_N"] = sample.force;
        one["lateral_force_N"] = lateral_force(sample, result.model.tool.approach);
        one["largest_force_N"] = largest;
        one["force_on_tool_N"] = {sample.on_tool[0], sample.on_tool[1], sample.on_tool[2]};
        if (step.turns()) {
          one["moment_on_tool_Nm"] = {sample.on_tool[3], sample.on_tool[4], sample.on_tool[5]};
          one["turned_deg"] = three(180.0 / std::numbers::pi * Vec3(sample.turned.data()));
        }
      }
    }
    list.push_back(one);
    ++moved;
    for (const CutMade& made : result.cuts)
      if (made.after == moved && made.t > 0.0) list.push_back(cut_step_json(made));
  }
  return list;
}

double largest_energy_error(const History& history) {
  if (history.energy.empty()) return 0.0;
  const EnergySample& first = history.energy.front();  // work of the loads before the tool moves
  double error = 0.0, scale = 0.0;
  for (const EnergySample& e : history.energy) {
    error = std::max(error, std::abs(e.error() - first.error()));
    scale = std::max(scale, std::abs(e.external - first.external));
  }
  return scale > 0.0 ? error / scale : 0.0;
}

namespace {

void add_loads_and_supports(Json& summary, const Result& result) {
  const History& history = result.history;
  for (const Membrane& film : result.loading.loads.membrane)
    summary["membranes"][film.name] = {{"thickness_mm", 1e3 * film.thickness},
                                       {"mu_Pa", film.shear_modulus},
                                       {"stiffness_N_per_m", film.thickness * film.shear_modulus},
                                       {"tension_N_per_m", film.tension},
                                       {"wrinkles", film.wrinkles},
                                       {"area_mm2", 1e6 * area_of(film.patch)}};
  if (const Loads& loads = result.loading.loads; loads.move_the_body()) {
    Json pressures = Json::object();
    for (const SurfacePressure& one : loads.pressure) pressures[one.name] = one.pressure;
    summary["loads"] = {{"gravity_m_per_s2", {loads.gravity.x(), loads.gravity.y(), loads.gravity.z()}},
                        {"pressure_Pa", pressures},
                        {"settled_mm", 1e3 * history.preload_displacement}};
    if (!result.loading.indenter) summary["loads"]["circle_moved_mm"] = three(1e3 * history.carried);
    if (const auto& unloaded = result.unloaded)
      summary["loads"]["unloaded"] = {{"rounds", unloaded->rounds},
                                      {"taken_back_mm", 1e3 * unloaded->taken_back},
                                      {"within_mm", 1e3 * unloaded->within}};
    if (loads.fluid)
      summary["loads"]["fluid_lost"] = {{"up", three(loads.fluid->up)},
                                        {"level_mm", 1e3 * loads.fluid->level},
                                        {"density_kg_per_m3", loads.fluid->density}};
  }
  if (!result.loading.steps.empty()) summary["scene"] = steps_json(result);
  for (std::size_t k = 0; k < result.on_support.size(); ++k) {
    const HeldSet& support = result.loading.further[k];
    const Vec3 force = result.on_support[k], moved = 1e3 * displacement_of_support(result, support);
    summary["supports"][support.name] = {{"nodes", support.node.size()},
                                         {"hold", support.hold == HeldSet::Hold::along ? "sliding" : "fixed"},
                                         {"force_N", {force.x(), force.y(), force.z()}},
                                         {"moved_mm", {moved.x(), moved.y(), moved.z()}}};
  }
}

void add_levels(Json& summary, const Result& result) {
  if (result.levels.empty()) return;
  summary["ladder"] = Json::array();
  const auto or_null = [](double half, double factor) { return half > 0.0 ? Json(factor * half) : Json(); };
  for (const RefinementLevel& level : result.levels) {
    Json entry = {{"nodes", level.nodes}, {"force_N", level.force}, {"half_N", or_null(level.half, 1.0)}};
    if (result.followed) {
      entry["displacement_mm"] = 1e3 * level.length;
      entry["half_mm"] = or_null(level.half_length, 1e3);
    }
    entry["wall_s"] = level.seconds;
    summary["ladder"].push_back(entry);
  }
}

void add_force(Json& summary, const Result& result) {
  const History& history = result.history;
  const Model& model = result.model;
  const double force = history.force.empty() ? 0.0 : history.force.back().force;
  summary["force_N"] = force;
  if (!history.force.empty()) {
    const Eigen::Map<const Wrench> on_tool(history.force.back().on_tool.data());
    summary["force_on_tool_N"] = {on_tool[0], on_tool[1], on_tool[2]};
    summary["moment_on_tool_Nm"] = {on_tool[3], on_tool[4], on_tool[5]};
    summary["lateral_share"] = lateral_fraction(on_tool, model.tool.approach);
    if (!result.loading.steps.empty()) {
      const LargestForce largest = largest_force(result.loading, history.force);
      summary["largest_force"] = {{"force_N", largest.sample.force},
                                  {"indentation_mm", 1e3 * largest.sample.depth},
                                  {"time_s", largest.sample.t},
                                  {"step", largest.step}};
    }
  }
  summary["base_force_N"] = history.force.empty() ? 0.0 : history.force.back().base_force;
  summary["band"] = error_bounds_json(result.error_bounds, history);
  summary["image_error"] = image_error_json(result.image_error);
  if (result.spread > 0.0)
    summary["band_of_mu"] = {{"low_N", force - result.spread * std::abs(force)},
                             {"high_N", force + result.spread * std::abs(force)}};
  if (result.followed) summary["displacement"] = displacement_json(*result.followed, result.error_bounds);
}

void add_steps(Json& summary, const Result& result) {
  const History& history = result.history;
  summary["stable_step_s"] = history.dt_stable_first;
  summary["time_step_s"] = history.dt_first;
  summary["smallest_time_step_s"] = history.dt_smallest;
  summary["steps"] = result.time == TimeMode::quasi_static ? 0 : history.evaluations;
  summary["residual"] = history.residual;
  summary["most_inverted_points"] = history.inverted;  // at any depth; guards report the worst one
  summary["force_evaluations"] = history.evaluations + history.extra_evaluations;
  summary["J_min"] = history.J_min;
  summary["energy_error"] = largest_energy_error(history);
  summary["momentum_error"] = history.momentum_error;
}

void add_times(Json& summary, const Result& result, const RunTimes& times) {
  const History& history = result.history;
  const double reached_s = history.force.empty() ? 0.0 : history.force.back().t;
  const double evaluations = evaluations_of(history);
  summary["preprocess_wall_s"] = stages_json(result.stages);
  summary["prepare_wall_s"] = result.complete_s;
  summary["solve_wall_s"] = times.solve_s;
  summary["write_wall_s"] = times.write_s;
  summary["band_wall_s"] = result.error_bounds.seconds;
  summary["total_wall_s"] = times.total_s;
  double remaining_s = times.total_s;
  for (const auto& [name, s] : times.parts)
    if (s > 0.0) summary["parts_wall_s"][name] = s, remaining_s -= s;
  if (!times.parts.empty()) summary["parts_wall_s"]["starting and ending"] = std::max(0.0, remaining_s);
  summary["ms_per_step"] = evaluations > 0.0 ? 1e3 * times.solve_s / evaluations : 0.0;
  summary["real_time_factor"] = times.solve_s > 0.0 ? reached_s / times.solve_s : 0.0;
}

void add_guards(Json& summary, const Solution& result) {
  summary["guards"] = Json::array();
  for (const Finding& finding : result.findings) {
    Json entry = report_json(finding.report);
    entry["worst"] = finding.worst;
    summary["guards"].push_back(entry);
  }
  summary["retries"] = Json::array();
  for (const Retry& retry : result.history.retries)
    summary["retries"].push_back({{"code", retry.code}, {"at_mm", 1e3 * retry.depth}, {"what", retry.what}});
}

}  // namespace

void add_run(Json& summary, const Scene& scene, const Result& result, const RunTimes& times,
             const std::string& status, ExitCode code, const Report* reason) {
  const Model& model = result.model;
  const History& history = result.history;
  const double reached = history.force.empty() ? 0.0 : 1e3 * history.force.back().depth;
  summary["status"] = status;
  if (reason) summary["failure"] = report_json(*reason);
  summary["verdict"] = verdict_of(scene, result, status);
  summary["exit_code"] = static_cast<int>(code);
  summary["version"] = DIMPLE_VERSION;
  summary["scheme"] = model.scheme.name;
  summary["time"] = name_of(result.time);
  summary["precision"] = scene.solver.precision == Precision::single_ ? "single" : "double";
  summary["requested"] = {
      {"depth_mm", scene.depth_mm}, {"rate_mm_per_s", scene.rate_mm_per_s}, {"frames", scene.solver.frames}};
  summary["contact"] = result.loading.indenter
                           ? "in contact, " + friction_in_words(result.loading.indenter->friction)
                           : std::string(name_of(scene.contact));
  add_loads_and_supports(summary, result);
  summary["material"] = materials_json(scene, result.tissues);
  summary["counts"] = counts_json(model);
  if (result.loading.indenter) add_contact(summary, *result.loading.indenter, result.history);
  add_rigid(summary, result);
  if (result.loading.folds) add_folds(summary, *result.loading.folds, result.history.folds);
  summary["support"] = support_json(model.support_report);
  summary["support"]["worst_pivot_ratio"] = model.support_report.worst_pivot_ratio;
  summary["support"]["linear_error"] = model.support_report.linear_error;
  summary["consistency"] = consistency_json(model.consistency_report);
  summary["volume_mm3"] = model.volume.sum() * 1e9;
  summary["mass_g"] = model.mass.sum() * 1e3;
  summary["indentation_mm"] = reached;
  add_force(summary, result);
  add_levels(summary, result);
  add_steps(summary, result);
  add_times(summary, result, times);
  summary["threads"] = tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
  summary["warnings"] = result.warnings;
  add_guards(summary, result);
}

void add_scene(Json& summary, const Scene& scene, const Result& result) {
  const Model& model = result.model;
  summary["scheme"] = model.scheme.name;
  summary["precision"] = scene.solver.precision == Precision::single_ ? "single" : "double";
  add_loads_and_supports(summary, result);
  summary["material"] = materials_json(scene, result.tissues);
  summary["counts"] = counts_json(model);
  for (const char* of_patch_alone : {"circle_nodes", "circle_centre_mm", "circle_diameter_mm", "push"})
    summary["counts"].erase(of_patch_alone);
  add_rigid(summary, result);
  summary["support"] = support_json(model.support_report);
  summary["volume_mm3"] = model.volume.sum() * 1e9;
  summary["threads"] = tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
}

}  // namespace dimple
