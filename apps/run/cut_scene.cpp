#include "apps/run/cut_scene.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "apps/run/cuts.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/words.hpp"
#include "io/error.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/output/carry_back.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

// Time after a cut, as a fraction of the load's duration: frames and rows of equal time would be merged.
constexpr double moment = 1e-6;

constexpr double hardly = 0.02;  // of a blade's area

// Area of open sheets [mm^2].
double area_of(const std::vector<TriangleMesh>& sheets) {
  double area = 0.0;
  for (const TriangleMesh& sheet : sheets) {
    if (is_closed(sheet.triangles, sheet.vertex.cols())) continue;
    for (const auto& t : sheet.triangles.colwise()) {
      const Vec3 a = sheet.vertex.col(t[0]);
      area += 0.5 * (Vec3(sheet.vertex.col(t[1])) - a).cross(Vec3(sheet.vertex.col(t[2])) - a).norm();
    }
  }
  return area;
}

// Sheets of the blade, mapped to the body at rest [mm, LPS].
std::vector<TriangleMesh> reference_sheets(const Cut& cut, double step, const Model& model, const Nodal& u) {
  const bool undeformed = u.isZero(0.0);
  const Points places = u.topRows<3>();
  const BodySurface now = deformed_surface(model, places);
  std::vector<TriangleMesh> sheets = blades_of(cut, now, step);
  if (undeformed) return sheets;
  for (TriangleMesh& sheet : sheets) try {
      sheet = carried_back(sheet, model, places);
    } catch (const ModelError& error) {
      Report report = error.report;
      report.where = cut.where;
      throw ModelError(report);
    }
  return sheets;
}

// Pressures x volumes of the patches of `to`, from the nearest points of `from`.
Eigen::VectorXd carried_pressures(const Model& from, const Eigen::VectorXd& lambda, const Model& to) {
  Eigen::VectorXd pressure = Eigen::VectorXd::Zero(from.point_count());
  const PressurePatches &before = from.patches, &after = to.patches;
  for (Index q = 0; q < from.point_count(); ++q)
    for (int k = before.of_point.offset[q]; k < before.of_point.offset[q + 1]; ++k)
      pressure[q] +=
          before.psi[k] * lambda[before.of_point.member[k]] / before.volume[before.of_point.member[k]];
  const Neighbours points(from.point);
  Eigen::VectorXd result = Eigen::VectorXd::Zero(after.count());
  for (Index q = 0; q < to.point_count(); ++q) {
    const double here = pressure[points.nearest(to.point.col(q), 1).front()];
    for (int k = after.of_point.offset[q]; k < after.of_point.offset[q + 1]; ++k)
      result[after.of_point.member[k]] += after.psi[k] * to.volume[q] * here;
  }
  return result;
}

// Contact forces carried over without friction: each sample has the pressure of the nearest sample before.
Eigen::VectorXd carried_contact(const RigidBody& from, const Eigen::VectorXd& force, const RigidBody& to) {
  const Neighbours samples(from.surface.place);
  Eigen::VectorXd result(to.surface.count());
  for (Index s = 0; s < result.size(); ++s) {
    const int next = samples.nearest(to.surface.place.col(s), 1).front();
    result[s] = force[next] / from.surface.area[next] * to.surface.area[s];
  }
  return result;
}

// Tools and walls keep their poses, whatever the cut has made of the surface of their first contact.
void keep_poses(const Loading& before, Loading& now) {
  if (now.indenter) {
    auto indenter = std::make_shared<RigidBody>(*now.indenter);
    indenter->pose = before.indenter->pose;
    now.indenter = std::move(indenter);
  }
  for (RigidBody& wall : now.walls)
    for (const RigidBody& its : before.walls)
      if (its.name == wall.name) wall.pose = its.pose;
}

// State of the body before it is cut, to restore it if the cut fails.
struct Body {
  Model model;
  Loading loading;
  ImageFacts facts;
  ModelReport report;
  std::map<std::string, std::string> chosen, provenance;
  std::vector<Finding> findings;
};

}  // namespace

CutScene::CutScene(const Case& given, Organ organ)
    : given_(given), whole_(std::move(organ)), steps_(cuts_after_moves(given.scene)) {}

ScenePart CutScene::part(std::size_t k) const {
  ScenePart part;
  if (k > 0) part.first = steps_[k - 1].after;
  if (k < steps_.size()) part.end = steps_[k].after;
  part.cuts = static_cast<int>(k);
  return part;
}

// Makes the cut body as if it had been cut from the start; reports the new warnings only.
void CutScene::make_again(const RunLog& log, Result& result) {
  const RunObserver silent;
  const RunLog quiet{silent, result};
  const std::vector<std::string> warned = std::exchange(result.warnings, {});
  const std::size_t of_model = result.model_warnings;
  const auto report_new = [&] {
    const std::vector<std::string> all = std::exchange(result.warnings, warned);
    result.model_warnings = of_model;
    for (const std::string& warning : all)
      if (std::find(warned.begin(), warned.end(), warning) == warned.end()) log.warn(warning);
  };
  try {
    const LabelImage& image = result.origin->image;
    const Organ organ = cut_by_steps(given_.scene, whole_, image, done_, quiet, result);
    ModelOptions options = organ.options;
    if (result.required_nodes > 0) options.node_set.count = result.required_nodes;
    NodePlacement placed{place_nodes(given_.scene, organ, options, image, quiet, result), options.scheme,
                         organ.label_names};
    make_ready(given_, std::move(placed), quiet, result);
  } catch (...) {
    report_new();
    throw;
  }
  report_new();
}

void CutScene::cut(std::size_t k, const ScenePart& part, const RunLog& log, Result& result, ScenePart& next) {
  const Cut& cut = steps_[k].cut;
  log.doing("cutting");
  CutMade made{.name = steps_[k].name,
               .text = cut.text,
               .after = steps_[k].after,
               .toughness_J_m2 = steps_[k].toughness_J_m2};
  made.sheets = reference_sheets(cut, whole_.body->report.step_mm, result.model, part.ended.u);
  done_.sheets.insert(done_.sheets.end(), made.sheets.begin(), made.sheets.end());
  done_.labels = labels_cut_out(cut);
  done_.has_taken_labels = done_.has_taken_labels || !done_.labels.empty();
  done_.where = cut.where;

  const double area = result.cut.area_mm2, removed = result.cut.removed_mm3;
  Body before{std::move(result.model), std::move(result.loading), result,         result.report,
              result.chosen,           result.provenance,         result.findings};
  try {
    make_again(log, result);
  } catch (...) {  // the state before is restored, to be reported
    result.model = std::move(before.model);
    result.loading = std::move(before.loading);
    static_cast<ImageFacts&>(result) = before.facts;
    result.report = before.report, result.chosen = before.chosen, result.provenance = before.provenance;
    result.findings = before.findings;
    throw;
  }
  result.findings = before.findings;
  keep_poses(before.loading, result.loading);

  made.area_mm2 = result.cut.area_mm2 - area;
  made.removed_mm3 = result.cut.removed_mm3 - removed;
  made.nodes = result.model.node_count();
  if (const double blade = area_of(made.sheets); blade > 0.0 && made.area_mm2 < hardly * blade)
    log.warn(
        fmt::format("the cut '{}' opens {:.3g} mm2, of {:.3g} mm2 of its blade at the body: it overlaps "
                    "another cut, or grazes the surface",
                    made.name, made.area_mm2, blade));
  made.force_before = result.history.force.back().force;
  result.cuts.push_back(std::move(made));

  next = this->part(k + 1);
  const std::size_t of_these = static_cast<std::size_t>(
      std::count_if(steps_.begin(), steps_.begin() + static_cast<std::ptrdiff_t>(k + 1),
                    [&](const CutStep& step) { return step.after == steps_[k].after; }));
  next.later = moment * static_cast<double>(of_these) * result.loading.duration();
  next.least_reactions = part.least_reactions;
  EquilibriumState near;
  near.u = to_nodal(inner_interpolation(before.model, result.model.X)(part.ended.u.topRows<3>()));
  const Eigen::VectorXd pressures = carried_pressures(before.model, part.ended.lambda, result.model);
  const Eigen::VectorXd in_contact =
      result.loading.indenter
          ? carried_contact(*before.loading.indenter,
                            part.ended.lambda.segment(before.model.patches.count(),
                                                      before.loading.indenter->surface.count()),
                            *result.loading.indenter)
          : Eigen::VectorXd();
  near.lambda.resize(pressures.size() + in_contact.size());
  near.lambda << pressures, in_contact;
  next.near = std::move(near);
}

void CutScene::report_to(const ScenePart& part, const RunLog& log, Solution& result) {
  CutMade& made = result.cuts.back();
  const ForceSample& now = result.history.force.back();
  made.t = now.t;
  made.depth = now.depth;
  made.force = now.force;
  made.released = part.cut.released;
  made.stored_before = made.released + result.history.energy.back().stored;
  log.say("cut      " + in_words(made));
  if (part.done_again)
    log.say("cut      the tissue moves so far that the earlier steps were repeated on the cut body");
  if (!part.cut.passed_limit_point) return;
  result.history.guards.push_back(
      {{.fact = fmt::format("the tissue passed a limit point at the cut '{}': no equilibrium was near",
                            made.name),
        .where = fmt::format("indentation {}", length_in_words(1e3 * made.depth)),
        .why = "viscous regularisation at the held pose led to the one shown; there may be others",
        .remedy = "compare with the same cut from the start: --cut, with the blades in the folder cuts",
        .code = "limit-point"},
       0.0});
}

std::string in_words(const CutMade& made) {
  std::string words = fmt::format("{}: '{}' at {}", made.name, made.text, length_in_words(1e3 * made.depth));
  if (made.area_mm2 > 0.0) words += fmt::format(", {:.4g} cm2", made.area_mm2 / 1e2);
  const Written written = force_written(std::max(std::abs(made.force), std::abs(made.force_before)));
  words += fmt::format("; the force changes from {} to {}", written(made.force_before), written(made.force));
  words += fmt::format("; {} mJ released", three_digits(1e3 * made.released));
  if (made.area_mm2 > 0.0)
    words += fmt::format(", {} J/m2", three_digits(1e6 * made.released / made.area_mm2));
  if (made.stored_before > 0.0 && made.releases_no_more_than_node_sets_differ())
    words += ", within the difference between the two node sets";
  if (made.toughness_J_m2 > 0.0)
    words += fmt::format("; work of the blade from the energy balance {} mJ",
                         three_digits(1e3 * made.work_of_blade()));
  return words + fmt::format("; {} nodes from here on", made.nodes);
}

}  // namespace dimple
