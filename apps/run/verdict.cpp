#include "apps/run/verdict.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "apps/run/steps.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/words.hpp"

namespace dimple {
namespace {

struct Answer {
  double value = 0.0;
  std::string unit, of;
  std::set<std::string> reasons = {};
  bool bad = false;

  Json json() const {
    return {{"word", bad               ? "bad"
                     : reasons.empty() ? "good"
                                       : "check"},
            {"value", std::isfinite(value) ? Json(value) : Json()},
            {"unit", unit},
            {"of", of},
            {"reasons", reasons}};
  }
  void check_beyond(double limit_percent) {
    if (!(std::abs(value) <= limit_percent)) reasons.insert(fmt::format("above {:g} %", limit_percent));
  }
};

// Codes of the guards that fired; a retried march has a guard too. A few inverted points at a sharp edge
// hardly change the force, and every fine discretisation has some.
std::set<std::string> fired(const Solution& result, const std::set<std::string>& about) {
  std::set<std::string> codes;
  for (const Finding& finding : result.findings)
    if (finding.report.code != "inverted" && !finding.is_minor && about.contains(finding.report.code))
      codes.insert(finding.report.code);
  for (const Retry& retry : result.history.retries)
    if (about.contains(retry.code)) codes.insert(retry.code);
  return codes;
}

std::string counted(std::size_t warnings) {
  return fmt::format("{} warning{}", warnings, warnings == 1 ? "" : "s");
}

Answer of_image(const Result& result) {
  double labelled = 0.0;
  for (const LabelMeasure& label : result.labels) labelled += label.volume_mm3;
  Answer answer{.value = labelled > 0.0 ? 100.0 * result.segment.voxel_volume_mm3 / labelled : 0.0,
                .unit = "%",
                .of = "of the labelled volume is in the body"};
  if (!(labelled > 0.0)) {  // a run from a model's files
    answer.value = static_cast<double>(result.model.node_count());
    answer.unit = "nodes";
    answer.of = "of an existing model: no image was read";
    return answer;
  }
  // The body may be smaller than the labels.
  const auto part = [](double mm3, const char* what) {
    return mm3 > 0.0 ? fmt::format(", {} {}", volume_in_words(mm3), what) : std::string();
  };
  double filled = 0.0;
  for (const Cavity& cavity : result.segment.cavities)
    if (cavity.filled) filled += cavity.volume_mm3;
  double cut_away = result.cut.removed_mm3;
  for (const CutPiece& piece : result.cut.parted) cut_away += piece.volume_mm3;
  const std::string changed = part(cut_away, "cut away") + part(filled, "of cavities filled") +
                              part(result.closed_mm3, "of gaps closed") +
                              part(result.segment.dropped_volume_mm3, "of other pieces dropped");
  if (!changed.empty()) answer.of = "of the labelled volume: " + changed.substr(2);
  if (result.image_warnings > 0) answer.reasons.insert(counted(result.image_warnings));
  const double as_requested = 100.0 * (1.0 - cut_away / labelled);
  if (!(std::abs(answer.value - as_requested) <= 100.0 * volume_to_check))
    answer.reasons.insert(
        fmt::format("differs from {:.3g} % by more than {:g} %", as_requested, 100.0 * volume_to_check));
  return answer;
}

Answer of_model(const Result& result) {
  const double voxels = result.segment.voxel_volume_mm3, points = result.model.volume.sum() * 1e9;
  Answer answer{.value = voxels > 0.0 ? 100.0 * (points / voxels - 1.0) : 0.0,
                .unit = "%",
                .of = "difference between the integration points' volume and the image's"};
  answer.reasons = fired(result, {"conditioning", "supports", "circle-nodes", "hourglass"});
  if (const std::size_t others = result.model_warnings - result.image_warnings;
      others > answer.reasons.size())
    answer.reasons.insert(counted(others));
  for (const Finding& finding : result.findings)
    if (finding.report.code == no_stress)
      answer.reasons.insert(fmt::format("{:.0f} point{} without stress: det F below {:g}", finding.worst,
                                        finding.worst == 1.0 ? "" : "s", least_J_of_stress));
  answer.check_beyond(100.0 * grid_volume_to_check);
  if (!(voxels > 0.0)) {
    answer.value = 100.0 * result.model.support_report.linear_error;
    answer.of = "error in the gradients of linear fields";
  }
  return answer;
}

Answer of_equilibrium(const Result& result, const std::string& status) {
  const History& history = result.history;
  Answer answer{.value = 100.0 * history.residual,
                .unit = "%",
                .of = "of the reactions is unbalanced, at the worst depth"};
  if (status == "failed" && history.force.size() < 2) {  // the only sample precedes the load
    answer.value = std::numeric_limits<double>::quiet_NaN();
    answer.of = "of the reactions is unbalanced: no equilibrium was found";
  } else if (result.time != TimeMode::quasi_static && !history.force.empty()) {
    const ForceSample& last = history.force.back();
    answer.value = last.force != 0.0 ? 100.0 * std::abs(last.base_force / last.force - 1.0) : 0.0;
    answer.of = "difference between the tool's and the base's force at the end";
  }
  answer.reasons = fired(
      result, {"non-finite", "inverted", "volume", "time-step", "limit-point", "no-equilibrium", "kinetic",
               "jagged", "penetration", "tool-penetration", "wall-penetration", "tool-left"});
  if (result.time != TimeMode::quasi_static) {
    answer.check_beyond(100.0 * inertia_to_check);
    if (!history.force.empty() && history.force.back().force < 0.0 && history.force.back().depth > 0.0)
      answer.reasons.insert("inertia pulls the tool in");
  }
  if (status != "finished") answer.reasons.insert("the run was " + status);
  answer.bad = status == "failed";
  return answer;
}

Answer of_energy(const Result& result) {
  Answer answer{.value = 100.0 * largest_energy_error(result.history),
                .unit = "%",
                .of = result.loading.loads.move_the_body() || !result.loading.further.empty()
                          ? "energy balance error, relative to the work done since the preload"
                          : "energy balance error, relative to the work of the tool"};
  answer.reasons = fired(result, {"energy"});
  answer.check_beyond(100.0 * energy_to_check);
  if (!answer.reasons.empty() && relaxes(result.tissues.material))
    answer.reasons.insert("the stored energy does not include relaxation");
  return answer;
}

Answer of_accuracy(const Scene& scene, const Result& result) {
  const ErrorBounds& error_bounds = result.error_bounds;
  const auto check_image = [&](Answer& answer, double discretisation) {
    const ForceSample last = result.history.force.empty() ? ForceSample() : result.history.force.back();
    if (is_large(result.image_error, last.force, discretisation))
      answer.reasons.insert("the image's resolution leaves +- " +
                            percent(result.image_error.half.back() / std::abs(last.force)));
  };
  if (!error_bounds.known() || result.history.force.empty()) {
    Answer answer{.value = static_cast<double>(result.model.node_count()),
                  .unit = "nodes",
                  .of = "without an error estimate of the force",
                  .reasons = {error_bounds.unknown.empty() ? "there is no force" : error_bounds.unknown}};
    check_image(answer, 0.0);
    return answer;
  }
  // Steps may end where the force is small; their bounds refer to the largest.
  const double force = std::abs(scene.steps.empty()
                                    ? result.history.force.back().force
                                    : largest_force(result.loading, result.history.force).sample.force),
               half = error_bounds.half.back();
  Answer answer{.value = 100.0 * half / force, .unit = "%", .of = "discretisation error of the force, +-"};
  const std::optional<Goal> goal = scene.goal;
  const bool requested = goal && (goal->fraction > 0.0 || goal->absolute > 0.0);
  if (requested && half > goal->half_width(force))
    answer.reasons.insert("larger than the requested accuracy");
  else if (!requested)
    answer.check_beyond(100.0 * error_to_check);
  check_image(answer, half);
  answer.bad = !(half <= error_too_large * force);
  return answer;
}

}  // namespace

Json verdict_of(const Scene& scene, const Result& result, const std::string& status) {
  return {{"image", of_image(result).json()},
          {"model", of_model(result).json()},
          {"equilibrium", of_equilibrium(result, status).json()},
          {"energy", of_energy(result).json()},
          {"accuracy", of_accuracy(scene, result).json()}};
}

}  // namespace dimple
