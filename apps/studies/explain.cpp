#include "apps/studies/explain.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>

#include "apps/run/error_bounds.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/unless_stopped.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/studies/explain_trials.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

constexpr int frames = 4;
constexpr double few_noises = 3.0;
constexpr Index most_nodes_to_explain = 6000;  // about two minutes

// Run of a case, with its forces as far as it has them.
struct Tried {
  Result result;
  std::vector<double> force;  // [N] at each of the depths
  std::string deeper;         // why not all depths were reached
  double seconds = 0.0;
};

bool has_limit_point(const History& history) {
  return std::any_of(history.guards.begin(), history.guards.end(),
                     [](const Finding& f) { return f.report.code == "limit-point"; });
}

// Force [N] at each of the ascending depths, interpolated between samples; depths beyond the last sample are
// left out.
std::vector<double> forces_at(const std::vector<ForceSample>& samples, const std::vector<double>& depths_mm) {
  std::vector<double> result;
  for (const double mm : depths_mm) {
    const double depth = 1e-3 * mm;
    const auto after = std::find_if(samples.begin(), samples.end(),
                                    [&](const ForceSample& s) { return s.depth >= depth * (1.0 - 1e-9); });
    if (after == samples.end()) break;
    if (after == samples.begin()) {
      result.push_back(after->force);
      continue;
    }
    const ForceSample& before = *std::prev(after);
    const double fraction = (depth - before.depth) / (after->depth - before.depth);
    result.push_back(before.force + std::min(fraction, 1.0) * (after->force - before.force));
  }
  return result;
}

// Time of a run that builds all of its model [s], also if parts were reused from another run.
double seconds_by_itself(const Result& result) {
  return result.read_s + result.build_s + result.complete_s + result.solve_s;
}

Tried run(const Case& given, const std::vector<double>& depths_mm) {
  Tried tried;
  double limit_point_mm = INFINITY;  // nothing deeper is compared
  const RunObserver observer{.march = {.sample = [&](const ForceSample& sample, const History& history) {
                               const double mm = 1e3 * sample.depth;
                               if (has_limit_point(history)) limit_point_mm = std::min(limit_point_mm, mm);
                               const bool enough = limit_point_mm < INFINITY && mm > depths_mm.front() - 1e-6;
                               return !enough && stop_requested() == StopReason::none;
                             }}};
  try {
    unless_stopped([&] { simulate(given, observer, tried.result); });
  } catch (const SolveError&) {
    tried.force = forces_at(tried.result.history.force, depths_mm);
    if (tried.force.empty()) throw;
    tried.deeper = "no equilibrium was found deeper";
  }
  if (stop_requested() != StopReason::none) throw Stopped(stop_requested());
  tried.force = forces_at(tried.result.history.force, depths_mm);
  while (tried.force.size() > 1 && depths_mm[tried.force.size() - 1] > limit_point_mm - 1e-6) {
    tried.force.pop_back();
    tried.deeper = "the tissue passed a limit point deeper";
  }
  if (tried.force.empty())
    throw SolveError({.fact = "there is no force at " + length_in_words(depths_mm.front()),
                      .where = "--explain",
                      .why = "the load ends before",
                      .remedy = "give a larger --depth"});
  tried.seconds = seconds_by_itself(tried.result);
  return tried;
}

bool same_nodes(const Model& a, const Model& b) {
  return a.node_count() == b.node_count() && a.X == b.X;
}

}  // namespace

Index nodes_to_explain(const Scene& scene, double facing_fraction) {
  return std::max(fewest_nodes_under_tool(scene),
                  facing_fraction > most_facing ? Index{2000} : Scene::NodeSet{}.nodes);
}

namespace {

// Scene that is explained, with that number of nodes.
Scene config_to_explain(Scene scene, Index nodes) {
  scene.goal.reset();
  scene.followed.reset();
  scene.error_bounds = true;
  scene.material.mu_spread = 0.0;
  scene.node_set.spacing_mm = 0.0;
  scene.node_set.nodes = nodes;
  scene.given.nodes = true;
  scene.solver.frames = frames;
  return scene;
}

// Reference with which a trial is compared.
struct ForceReference {
  const std::vector<double>& depths_mm;
  const Scene& held;
  const PreparedOrgan& organ;  // of the case as given, and its model with positions as numbers
  const Tried& found;          // case as given
  const Tried& as_it_is;       // case with its positions as numbers
  std::vector<double> mean;    // force [N] over the node sets so far
  int node_sets = 1;
};

void take_into_mean(ForceReference& reference, const std::vector<double>& force) {
  std::vector<double>& mean = reference.mean;
  mean.resize(std::min(mean.size(), force.size()));
  for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += (force[k] - mean[k]) / (reference.node_sets + 1);
  ++reference.node_sets;
}

// Force proportional to the depth, at each of the depths.
std::vector<double> proportional(const Tried& now, double depth_mm, const std::vector<double>& depths_mm) {
  const double stiffness = now.force.front() / depth_mm;
  std::vector<double> force;
  for (const double d : depths_mm) force.push_back(stiffness * d);
  return force;
}

// Replaces the forces of a trial by the mean of them and those with another random node set. Returns the
// number of depths that both have.
std::size_t average_with_another_node_set(Tried& now, const Case& given, const std::vector<double>& depths_mm,
                                          std::size_t depths) {
  PreparedOrgan same = *given.organ;
  same.made = made_in(given.scene, now.result);
  Case again = given;
  again.organ = &same;
  ++again.scene.node_set.seed;
  const auto other = run(again, depths_mm);
  if (other.force.size() < depths) now.deeper = other.deeper;
  depths = std::min(depths, other.force.size());
  now.force.resize(depths);
  for (std::size_t k = 0; k < depths; ++k) now.force[k] = 0.5 * (now.force[k] + other.force[k]);
  return depths;
}

// Compares the forces with those of the reference.
void compare(Alternative& alternative, const Trial& trial, const Case& given, Tried& now,
             const ForceReference& reference, double noise) {
  const bool same_node_set = trial.kind == Alternative::Kind::node_set ||
                             same_nodes(now.result.model, reference.as_it_is.result.model);
  const std::vector<double>& compared = same_node_set ? reference.as_it_is.force : reference.mean;
  std::size_t depths = std::min({now.force.size(), compared.size(), reference.found.force.size()});
  // Effects close to the scatter between node sets are averaged over two node sets.
  if (!same_node_set && std::abs(now.force[depths - 1] / compared[depths - 1] - 1.0) < few_noises * noise)
    depths = average_with_another_node_set(now, given, reference.depths_mm, depths);
  for (std::size_t k = 0; k < depths; ++k)
    alternative.effects.emplace_back(reference.depths_mm[k], now.force[k] / compared[k] - 1.0);
  std::tie(alternative.depth_mm, alternative.effect) = alternative.effects.back();
  alternative.force = (1.0 + alternative.effect) * reference.found.force[depths - 1];
  alternative.seconds = now.seconds;
  alternative.deeper = depths == now.force.size() ? now.deeper : "the unchanged run ends there";
}

using Say = std::function<void(const std::string&)>;

// True if a case has the same body as a scene: its image and its surface are made in the same manner.
bool has_same_body(const Case& a, const Scene& b) {
  const BodyModification& change = a.change;
  return !change.image && change.smoothing == 1.0 && change.outward_voxels == 0.0 &&
         a.scene.image.close_mm == b.image.close_mm;
}

// Runs a trial and compares it, or records its failure. Nothing: the change had no effect on the case.
std::optional<Alternative> try_out(const Trial& trial, ForceReference& reference, double noise,
                                   const Say& say) {
  Alternative alternative{trial.what, trial.instead, trial.all, trial.kind};
  const Stopwatch trying;
  try {
    const double depth_mm = trial.given.scene.depth_mm;
    Case given = trial.given;
    std::optional<PreparedOrgan> changed;
    if (!has_same_body(given, reference.held)) unless_stopped([&] { changed = read_once(given, {}); });
    given.organ = changed ? &*changed : &reference.organ;
    Tried now = run(given, trial.linear ? std::vector{depth_mm} : reference.depths_mm);
    if (const std::string why = left_out(trial, now.result, reference.found.result); !why.empty()) {
      say(fmt::format("explain  {}: {}", trial.what, why));
      return std::nullopt;
    }
    if (trial.linear) now.force = proportional(now, depth_mm, reference.depths_mm);
    compare(alternative, trial, given, now, reference, noise);
    if (trial.what == "cloud") take_into_mean(reference, now.force);
  } catch (const Stopped&) {
    throw;
  } catch (const Error& error) {
    alternative.failed = error.report.fact;
  }
  if (alternative.seconds == 0.0) alternative.seconds = trying.seconds();
  return alternative;
}

void say_alternative(const Alternative& a, const Explanation& explanation, const Say& say) {
  say(fmt::format("explain  {}, {}: {}, {:.1f} s", a.what, instead_of(a, explanation),
                  a.failed.empty() ? with_sign(100.0 * a.effect) + " %" : a.failed, a.seconds));
}

// All comparisons with that number of nodes. Nothing if the nodes are too few: for a folded body, or because
// other random nodes change the force too much. `more`, if not null, is then the number to use.
std::optional<Explanation> explain_with(Index nodes, Index* more, const Scene& given, const Say& progress) {
  const Stopwatch whole;
  const Scene scene = config_to_explain(given, nodes);
  const Say say = [&](const std::string& text) {
    if (progress) progress(text);
  };
  std::vector<double> depths_mm;
  for (int k = 1; k <= frames; ++k) depths_mm.push_back(scene.depth_mm * k / frames);

  PreparedOrgan organ = read_once({.scene = scene}, {});
  Tried found = run({.scene = scene, .organ = &organ}, depths_mm);
  found.result.image = organ.read.image;  // simulate() has released it
  if (const Index least = nodes_to_explain(scene, found.result.facing_fraction); more && nodes < least) {
    *more = least;
    return std::nullopt;
  }
  const Vec3 down = found.result.model.axes * found.result.report.boundary.down;
  Explanation explanation{.nodes = scene.node_set.nodes,
                          .depth_mm = depths_mm[found.force.size() - 1],
                          .force = found.force.back(),
                          .seconds = found.seconds};
  for (const Finding& finding : found.result.findings) explanation.warnings.push_back(in_words(finding));
  say(fmt::format("explain  unchanged: {} with {} nodes, {:.1f} s",
                  force_title(explanation.force, explanation.depth_mm), explanation.nodes, found.seconds));

  try {
    // Rounding of positions to numbers can move the tool by a last digit, and with it the nodes, so changes
    // are measured from this run.
    const Scene held = pinned(scene, found.result, down);
    const Tried as_it_is = run({.scene = held, .organ = &organ}, depths_mm);
    organ.made = made_in(held, as_it_is.result);
    ForceReference reference{.depths_mm = depths_mm,
                             .held = held,
                             .organ = organ,
                             .found = found,
                             .as_it_is = as_it_is,
                             .mean = as_it_is.force};
    for (const Trial& trial : trials_of({scene, held, found.result, down})) {
      std::optional<Alternative> alternative = try_out(trial, reference, explanation.noise, say);
      if (!alternative) continue;
      if (trial.what == "cloud" && alternative->failed.empty()) {
        explanation.noise = std::max(explanation.noise, std::abs(alternative->effect));
        if (more && explanation.noise > least_effect) {
          say(fmt::format("explain  other random nodes change the force by {:.1f} %: more nodes are used",
                          100.0 * explanation.noise));
          *more = std::min(2 * nodes, most_nodes_to_explain);
          return std::nullopt;
        }
      }
      say_alternative(*alternative, explanation, say);
      explanation.alternatives.push_back(*std::move(alternative));
    }
  } catch (const Stopped& stopped) {
    if (explanation.alternatives.empty()) throw;
    explanation.ended_by = stopped.report.fact;
  }
  sort_by_effect(explanation.alternatives);
  explanation.total_s = whole.seconds();
  return explanation;
}

}  // namespace

Explanation explain(const Scene& scene, Index nodes,
                    const std::function<void(const std::string&)>& progress) {
  check_pairs(scene, Feature::explain);
  if (nodes > 0) return *explain_with(nodes, nullptr, scene, progress);
  const Stopwatch whole;
  for (Index more = nodes_to_explain(scene, 0.0);;) {
    nodes = more;
    if (std::optional<Explanation> explanation =
            explain_with(nodes, nodes < most_nodes_to_explain ? &more : nullptr, scene, progress)) {
      explanation->total_s = whole.seconds();
      return *std::move(explanation);
    }
  }
}

}  // namespace dimple
