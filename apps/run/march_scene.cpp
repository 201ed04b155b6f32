#include <fmt/format.h>

#include <utility>

#include "apps/run/bending.hpp"
#include "apps/run/closing_cut.hpp"
#include "apps/run/cut_scene.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/other_tools.hpp"
#include "apps/run/pipeline.hpp"
#include "apps/run/rocking.hpp"
#include "apps/run/run_words.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/unless_stopped.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/memory.hpp"
#include "io/stop.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

std::unique_ptr<ForceSystem> force_system(const Scene& scene, LoadedModel& result) {
  const Stopwatch readying;
  auto system = std::make_unique<ForceSystem>(result.model, result.tissues, scene.solver.precision);
  // The system has the gradients in a layout of its own; both would take 0.4 GB at 100,000 nodes.
  result.model.dphi.resize(3, 0);
  give_back_memory();
  stop_if_requested();
  result.complete_s += readying.seconds();
  return system;
}

// Reports a tool that was lifted, or slid off the body.
void report_lost_contact(const RunLog& log, const Result& result) {
  constexpr double nothing = 1e-6;  // of the largest force: the search for equilibrium has a tolerance
  const std::vector<ForceSample>& force = result.history.force;
  if (!result.loading.indenter || force.empty()) return;
  const auto size = [](const ForceSample& sample) {  // without slip it may pull, also laterally
    return Eigen::Map<const Wrench>(sample.on_tool.data()).head<3>().norm();
  };
  double largest = 0.0;
  for (const ForceSample& sample : force) largest = std::max(largest, size(sample));
  const auto last = std::find_if(force.rbegin(), force.rend(),
                                 [&](const ForceSample& sample) { return size(sample) > nothing * largest; });
  if (largest == 0.0 && force.size() > 1 && !result.history.interrupted)
    log.warn("the tool never makes contact: its force is 0 at every depth; check its place and direction");
  if (last != force.rend() && last != force.rbegin())
    log.say(
        fmt::format("contact  the tool lost contact: the last contact was at a depth of {}, after {:.3g} s",
                    length_in_words(1e3 * last->depth), last->t));
}

// Reports a lateral force above a fifth of the whole; the force curve holds the part along the press
// direction.
void report_lateral_force(const RunLog& log, const Result& result) {
  constexpr double little = 0.2;
  if (result.history.force.empty()) return;
  const Eigen::Map<const Wrench> on_tool(result.history.force.back().on_tool.data());
  const double fraction = lateral_fraction(on_tool, result.model.tool.approach);
  if (!(fraction > little)) return;
  const Written written = force_written(on_tool.head<3>().norm());
  log.say(fmt::format(
      "across   {} of the force on the tool is across its approach direction: x {}, y {}, z {} {} (LPS)",
      percent(fraction), written.number(on_tool[0]), written.number(on_tool[1]), written.number(on_tool[2]),
      written.unit));
}

// Reports forces on further tools and walls.
void report_rigid_contacts(const RunLog& log, const Result& result) {
  for (std::size_t k = 0; k < result.history.walls.size(); ++k) {
    const RigidBody& rigid = result.loading.walls[k];
    const RigidContact::ContactSummary& now = result.history.walls[k];
    log.say(rigid.is_tool ? "tool     " + at_the_end_in_words(rigid.name, now)
                          : "wall     " + in_words(rigid.name, now));
  }
}

// Warns if the base is free, its side was found automatically, and the walls carry little of the tool's
// force: the tool may press along a wall, and supports resist it.
void warn_of_load_on_supports(const RunLog& log, const Scene& scene, const Result& result) {
  constexpr double enough = 0.5;  // of the tool's force
  const History& history = result.history;
  if (scene.base_is_held || scene.boundary.base != Scene().boundary.base || history.force.empty()) return;
  const Vec3 approach = result.model.tool.approach;
  double on_walls = 0.0;
  for (std::size_t k = 0; k < history.walls.size(); ++k)
    if (!result.loading.walls[k].is_tool) on_walls += history.walls[k].force.dot(approach);
  const double on_tool =
      Eigen::Map<const Wrench>(history.force.back().on_tool.data()).head<3>().dot(approach);
  if (!(std::abs(on_walls) < enough * std::abs(on_tool))) return;
  log.warn(fmt::format(
      "the walls carry {} of the tool's force and the supports the rest, although the base is "
      "free: the tool approaches along ({:.2f}, {:.2f}, {:.2f}) in LPS; choose the side that rests "
      "on the wall with --base",
      percent(std::abs(on_walls / on_tool)), approach.x(), approach.y(), approach.z()));
}

// Adds a finding for a jump of the force between two equilibria, unless another finding explains it.
void find_jump(Result& result) {
  constexpr double much = 0.2;  // of the largest force
  History& history = result.history;
  if (!result.loading.indenter ||
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
        .where = fmt::format("t = {:.4g} s, indentation {:.4g} mm, {:.4g} mm across the approach direction",
                             at.t, 1e3 * at.depth, 1e3 * aside.norm()),
        .why = "few nodes are in contact there, or the tool passes an edge or a step of the surface",
        .remedy = "use more nodes (--nodes), a larger tool, or a shorter path; shorter steps (--set "
                  "solver.step_radii=0.05) show whether the force changes smoothly",
        .code = "jagged"},
       jump.force / largest});
}

void keep_findings(const RunLog& log, Solution& result) {
  for (const Finding& finding : result.history.guards)
    if (finding.is_minor)
      log.detail(in_words(finding));
    else
      log.warn(in_words(finding));
  result.findings.insert(result.findings.end(), result.history.guards.begin(), result.history.guards.end());
}

// Interpolation to the tracked point, in this model.
std::optional<Interpolation> to_followed(const Result& result) {
  if (!result.followed) return std::nullopt;
  return inner_interpolation(result.model, result.followed->place);
}

Vec3 displacement_at(const Interpolation& place, const ForceSystem::Nodal& u) {
  return place(u.topRows<3>()).col(0);
}

// Records reactions of the supports at a depth of the tool [m].
void record_support_reactions(const ForceSystem::Nodal& f, double depth, Result& result) {
  result.on_support.clear();
  for (const HeldSet& support : result.loading.further) result.on_support.push_back(force_on(support, f));
  result.on_support_at = depth;
}

// Observes the march of one body: tracked point, supports, bending, rocking, cut faces.
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
      result.followed->u = displacement_at(*place_, from->u);  // there may be no further frame
    hears_.frame = [this](const Frame& frame) { see(frame); };
  }
  Watched(const Watched&) = delete;
  Watched& operator=(const Watched&) = delete;
  const Observer& hears() const { return hears_; }
  // Includes penetration of cut faces between the contact points of folds.
  void report(const RunLog& log) {
    FoldContact::Audit& folds = result_.history.folds;
    const bool folds_in_contact = result_.loading.folds != nullptr;
    folds.penetration = std::max(folds.penetration, folds_in_contact ? closing_.deepest() : 0.0);
    std::string of_part = bending_.warning();
    if (of_part.empty()) of_part = rocking_.warning();
    for (const std::string& warning : {of_part, folds_in_contact ? std::string() : closing_.warning()})
      if (!warning.empty()) log.warn(warning);
    if (result_.loading.loads.move_the_body()) report_preload(log);
  }

 private:
  // Reports the displacement by the loads alone, and warns if the body has lost the shape of the image.
  void report_preload(const RunLog& log) const {
    const double displacement = 1e3 * result_.history.preload_displacement;
    log.say(fmt::format("preload  largest displacement {}", length_in_words(displacement)));
    if (result_.unloaded) return;  // they bring it back to the image
    const Model& model = result_.model;
    const double size = 1e3 * (model.X.rowwise().maxCoeff() - model.X.rowwise().minCoeff()).minCoeff();
    if (displacement > 0.5 * size)
      log.warn(fmt::format(
          "the loads alone move the body by up to {}, more than half of its smallest extent, {}: check the "
          "loads and moduli, or give load.imaged=loaded if the image shows the body under them",
          length_in_words(displacement), length_in_words(size)));
  }

  void see(const Frame& frame) {
    if (place_) result_.followed->u = displacement_at(*place_, frame.u);
    // The solver knows the nodes' parameters alone, which are no displacements.
    if (frame.number == 0 && result_.loading.loads.move_the_body())
      result_.history.preload_displacement =
          node_interpolation(result_.model)(frame.u).colwise().norm().maxCoeff();
    record_support_reactions(frame.f, frame.depth, result_);
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

// Marches the scene on each body in turn: a step that cuts makes the next.
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
      part.has_joined = [&] { cuts.report_to(part, log, result); };
      const Stopwatch solving;
      try {
        solve(result.time, *system, result.model, result.loading, options, watched.hears(), result.history,
              k == 0 ? from : nullptr, &part);
      } catch (...) {
        result.solve_s += solving.seconds();
        throw;
      }
      result.solve_s += solving.seconds();
      watched.report(log);
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
  report_lost_contact(log, result);
  report_lateral_force(log, result);
  report_rigid_contacts(log, result);
  warn_of_load_on_supports(log, scene, result);
  warn_of_inertia(log, result);
  if (watched) watched->report(log);
  return system;
}

}  // namespace dimple
