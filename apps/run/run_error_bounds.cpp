#include "apps/run/run_error_bounds.hpp"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <new>
#include <utility>

#include "apps/run/pipeline.hpp"
#include "apps/run/run_words.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/tool_error_bounds.hpp"
#include "apps/run/unless_stopped.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/scene/tool_words.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

// Most nodes for a march in parallel with the coarser one: more need the memory and all processors.
constexpr Index most_nodes_in_parallel = 20000;

}  // namespace

struct CoarserMarch::Parts {
  Scene scene;
  std::shared_ptr<const Origin> origin;
  Index nodes = 0;
  Result coarse;
  std::exception_ptr failed = {};
  std::atomic<bool> given_up = false;
  // One worker runs it, and a waiting caller joins. It has priority: other work has the caller's own thread.
  bool in_parallel = false;
  tbb::task_arena arena{2, 1, tbb::task_arena::priority::high};
  tbb::task_group work;

  // Marches the coarser nodes to the full depth, with few frames.
  void run() {
    const RunObserver unheard;
    const RunLog log{unheard, coarse};
    const auto may_continue_now = [&] {
      if (given_up) throw Stopped(StopReason::interrupted);
    };
    try {
      unless_stopped([&] {
        may_continue_now();
        NodePlacement placed = place(nodes, scene, origin->organ, origin->image, log, coarse);
        may_continue_now();
        make_ready({.scene = scene}, std::move(placed), log, coarse);
        SolverOptions options = solver_options(scene);
        options.frames = 1;  // none is used
        march(scene, options,
              {.sample = [&](const ForceSample&, const History&) { return !given_up.load(); }}, nullptr, log,
              coarse);
        if (coarse.history.interrupted) throw Stopped(stop_requested());
      });
    } catch (...) {
      failed = std::current_exception();
    }
  }
  void wait() {
    arena.execute([&] { work.wait(); });
  }
};

CoarserMarch::CoarserMarch(const Scene& scene, const Result& result) : parts_(std::make_unique<Parts>()) {
  Parts& p = *parts_;
  p.scene = scene;
  p.origin = result.origin;
  p.nodes = static_cast<Index>(std::lround(static_cast<double>(result.model.node_count()) / coarser));
  static_cast<ImageFacts&>(p.coarse) = result;
  p.coarse.origin = result.origin;  // for walls that are labels
  p.coarse.followed = result.followed;
  p.in_parallel = tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism) > 1 &&
                  result.model.node_count() <= most_nodes_in_parallel;
  if (p.in_parallel) p.arena.execute([&] { p.work.run([&p] { p.run(); }); });
}

CoarserMarch::~CoarserMarch() {
  parts_->given_up = true;
  parts_->wait();
}

Index CoarserMarch::nodes() const {
  return parts_->nodes;
}

const Result& CoarserMarch::operator()() {
  Parts& p = *parts_;
  if (p.in_parallel)
    p.wait();
  else
    p.run();
  if (p.failed) std::rethrow_exception(p.failed);
  return p.coarse;
}

namespace {

// [m]
double radius_of_tool(const Scene& scene) {
  return scene.tool ? scene.tool->radius : 0.5e-3 * scene.boundary.indenter_diameter_mm;
}

// Reason from the largest depth [m].
std::string why_no_error_bounds(const Scene& scene, double deepest) {
  const double radii = deepest / radius_of_tool(scene),
               most = scene.tool ? deepest_with_tool_error_bounds : deepest_with_error_bounds;
  const char* of = scene.tool ? "tool" : "contact patch";
  if (scene.tool && radii < shallowest_with_tool_error_bounds * (1.0 - 1e-9))
    return fmt::format("not calibrated for a depth below {:g} radii of the {}",
                       shallowest_with_tool_error_bounds, of);
  if (radii <= most * (1.0 + 1e-9)) return {};
  return fmt::format("not calibrated for a depth above {:g} radii of the {}", most, of);
}

std::string why_no_error_bounds(const Scene& scene, const std::vector<Material>& tissues) {
  const Scene usual;
  if (const std::string none = why_without(scene, Feature::error_bounds); !none.empty()) return none;
  if (const std::string none = why_no_error_bounds(tissues); !none.empty()) return none;
  if (scene.solver.tolerance > usual.solver.tolerance)
    return fmt::format("not calibrated for a tolerance above {:g}", usual.solver.tolerance);
  if (const double usual_step = longest_step(scene.tool.has_value()); longest_step_radii(scene) > usual_step)
    return fmt::format("not calibrated for load steps above {:g} radii", usual_step);
  if (scene.node_set.patch_edge != usual.node_set.patch_edge ||
      scene.node_set.jitter != usual.node_set.jitter || scene.grid.points != usual.grid.points ||
      scene.grid.ratio != usual.grid.ratio || scene.support_radius_factor != usual.support_radius_factor)
    return "calibrated for the default --rim, points and supports only";
  if (scene.tool && !has_error_estimate(*scene.tool))
    return fmt::format("not calibrated for {}", in_words(*scene.tool));
  if (std::any_of(scene.steps.begin(), scene.steps.end(),
                  [](const Scene::Step& step) { return step.moves != "tool"; }))
    return "not calibrated for steps of anything but the tool";
  return scene.steps.empty() ? why_no_error_bounds(scene, 1e-3 * scene.depth_mm) : "";
}

// Reason from the path of a tool that moves in steps.
std::string why_no_error_bounds_along(const Scene& scene, const Vec3& approach) {
  double deepest = 0.0, aside = 0.0;
  for (const Vec3& at : path_of_tool(scene, approach)) {
    const double depth = at.dot(approach);
    // A contacting tool that is lifted leaves the body; a bonded patch pulls it.
    deepest = std::max(deepest, scene.tool ? depth : std::abs(depth));
    aside = std::max(aside, (at - depth * approach).norm());
  }
  if (aside > farthest_aside_with_error_bounds * radius_of_tool(scene) * (1.0 + 1e-9))
    return fmt::format("not calibrated for a path more than {:g} radii across the approach direction",
                       farthest_aside_with_error_bounds);
  return why_no_error_bounds(scene, deepest);
}

}  // namespace

// The default tissue is left out here: only the model shows whether any label still has it.
std::string why_no_error_bounds(const Scene& scene) {
  std::vector<Material> tissues = materials_of(scene);
  if (tissues.size() > 1) tissues.erase(tissues.begin());
  return why_no_error_bounds(scene, tissues);
}

std::string why_no_error_bounds(const Scene& scene, const Organ& organ, const Boundary& boundary,
                                const LoadedModel& result) {
  if (result.time != TimeMode::quasi_static) return not_for_dynamics;
  if (const std::string none = why_no_error_bounds(scene, in_use(result.tissues)); !none.empty()) return none;
  if (!scene.steps.empty())
    if (const std::string none = why_no_error_bounds_along(scene, boundary.approach); !none.empty())
      return none;
  constexpr double straight = 0.9998;  // cosine of about one degree
  if (scene.boundary.direction != Scene().boundary.direction &&
      boundary.approach.dot(boundary.down) < straight)
    return "not calibrated for an oblique direction";
  if (result.loading.folds && (!(result.facing_fraction > most_facing) || result.cut.area_mm2 > 0.0))
    return "not calibrated for folds in contact on a cut body";
  const BodyUnderPatch body =
      body_under_patch(organ.body->surface, boundary, organ.options.boundary.voxel_mm);
  if (!scene.tool) return why_no_error_bounds(body);
  if (body.thickness >= thinnest_with_tool_error_bounds) return {};
  return fmt::format("not calibrated for a thickness below {:g} radii of the contact (here {:.3g})",
                     thinnest_with_tool_error_bounds, body.thickness);
}

std::string why_no_labels(const Scene& scene, const Origin& origin) {
  if (scene.tissues.empty() || !origin.image.run.empty()) return {};
  return "the second set of nodes needs the labels of the image, which were not kept";
}

std::string why_no_error_bounds_after(const Scene& scene, const LoadedModel& result) {
  const Origin* origin = result.origin.get();
  if (!origin) return "a model's files hold one set of nodes, and the estimate needs two";
  if (const std::string none = why_no_labels(scene, *origin); !none.empty()) return none;
  if (const std::string none = why_no_error_bounds(scene, origin->organ, origin->boundary, result);
      !none.empty())
    return none;
  const Index fewest = std::max(fewest_nodes_with_error_bounds(result.facing_fraction),
                                scene.tool ? fewest_nodes_with_tool_error_bounds : Index{0});
  if (result.model.node_count() >= fewest) return {};
  return fmt::format("not calibrated below {0} nodes{1} (--nodes {0})", fewest,
                     result.facing_fraction > most_facing ? " for folded bodies" : "");
}

double half_of_displacement(const Result& result, const Vec3& coarse) {
  return displacement_half_width((result.followed->u - coarse).norm(), result.history.force.back().depth,
                                 result.model.node_count());
}

namespace {
bool has_finding(const History& history, std::string_view code) {
  return std::any_of(history.guards.begin(), history.guards.end(),
                     [&](const Finding& f) { return f.report.code == code; });
}
}  // namespace

RunErrorBounds error_bounds_of_run(const Scene& scene, const Result& result, CoarserMarch& coarser) {
  const Stopwatch whole;
  RunErrorBounds found;
  ErrorBounds& error_bounds = found.error_bounds;
  error_bounds.unknown = "";
  error_bounds.coarse_nodes = coarser.nodes();
  error_bounds.contacting = result.loading.indenter != nullptr;
  const std::string node_set =
      fmt::format("the comparison with {} nodes failed: ", error_bounds.coarse_nodes);
  try {
    const Result& coarse = coarser();
    const std::vector<ForceSample>&force = result.history.force, &other = coarse.history.force;
    const Penetration penetration{result.history.penetration, result.history.penetration_at};
    const bool several = !scene.tissues.empty();
    const Index nodes = result.model.node_count();
    if (!scene.steps.empty())
      error_bounds.half =
          result.loading.indenter
              ? tool_half_widths_of_steps(force, result.model, other, result.loading.indenter->shape,
                                          penetration)
              : half_widths_of_steps(force, other, 0.0, [&](double change, double deepest) {
                  return error_half_width(change, nodes, {deepest / result.model.tool.radius, several});
                });
    else
      error_bounds.half =
          result.loading.indenter
              ? tool_half_widths(force, result.model, other, result.loading.indenter->shape, penetration)
              : half_widths(force, nodes, other, result.model.tool.radius, several);
    if (error_bounds.half.empty())
      error_bounds.unknown =
          fmt::format("the comparison with {} nodes ended at a smaller depth", error_bounds.coarse_nodes);
    else if (result.loading.indenter && has_finding(result.history, "hourglass"))
      error_bounds.half.clear(),
          error_bounds.unknown = "the nodes are too coarse for this load (see the warning)";
    else if (result.followed)
      found.half_of_displacement = half_of_displacement(result, coarse.followed->u);
  } catch (const Stopped&) {
    found.stopped = true;
    error_bounds.unknown = "the run was stopped first";
  } catch (const Error& error) {
    error_bounds.unknown = node_set + error.report.fact;
  } catch (const std::bad_alloc&) {
    error_bounds.unknown = node_set + "not enough memory";
  }
  error_bounds.seconds = whole.seconds();
  return found;
}

}  // namespace dimple
