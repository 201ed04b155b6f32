#include "apps/run/band_of_run.hpp"

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

#include "apps/run/folds.hpp"
#include "apps/run/pipeline.hpp"
#include "apps/run/run_words.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/tool_band.hpp"
#include "apps/run/unless_stopped.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

constexpr const char* not_for_dynamics = "it was measured in equilibrium, not for dynamics";

// A finer cloud needs the memory and all processors for itself.
constexpr Index most_nodes_beside = 20000;

}  // namespace

struct CoarserMarch::Parts {
  Config config;
  std::shared_ptr<const Origin> origin;
  Index nodes = 0;
  Result coarse;
  std::exception_ptr failed = {};
  std::atomic<bool> given_up = false;
  // One worker takes it up, and who waits for it helps. Before other work: that has the caller's own thread.
  bool beside = false;
  tbb::task_arena arena{2, 1, tbb::task_arena::priority::high};
  tbb::task_group work;

  // At few depths.
  void run() {
    const RunObserver unheard;
    const RunLog log{unheard, coarse};
    const auto go_on = [&] {
      if (given_up) throw Stopped(StopReason::interrupted);
    };
    try {
      unless_stopped([&] {
        go_on();
        Placed placed = place(nodes, config, origin->organ, origin->image, log, coarse);
        go_on();
        complete(config, std::move(placed), log, coarse);
        coarse.loading.touch = touch_of(config, coarse.model);
        if (coarse.loading.folds)
          coarse.loading.folds =
              folds_of(config, coarse.facing_share, coarse.model, deepest(config, coarse.model.tool));
        SolverOptions options = solver_options(config);
        options.frames = 1;  // nobody looks at them
        march(config, options,
              {.sample = [&](const ForceSample&, const History&) { return !given_up.load(); }}, nullptr, log,
              coarse);
        if (coarse.history.interrupted) throw Stopped(stop_asked());
      });
    } catch (...) {
      failed = std::current_exception();
    }
  }
  void wait() {
    arena.execute([&] { work.wait(); });
  }
};

CoarserMarch::CoarserMarch(const Config& config, const Result& result) : parts_(std::make_unique<Parts>()) {
  Parts& p = *parts_;
  p.config = config;
  p.origin = result.origin;
  p.nodes = static_cast<Index>(std::lround(static_cast<double>(result.model.node_count()) / coarser));
  static_cast<ImageFacts&>(p.coarse) = result;
  p.coarse.time = result.time;
  p.coarse.followed = result.followed;
  p.coarse.loading = result.loading;
  p.coarse.loading.settled = nullptr;  // that is of the finer cloud
  p.beside = tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism) > 1 &&
             result.model.node_count() <= most_nodes_beside;
  if (p.beside) p.arena.execute([&] { p.work.run([&p] { p.run(); }); });
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
  if (p.beside)
    p.wait();
  else
    p.run();
  if (p.failed) std::rethrow_exception(p.failed);
  return p.coarse;
}

namespace {

std::string why_no_band(const Config& config, const std::vector<Material>& tissues) {
  const Config usual;
  if (config.scheme.name != usual.scheme.name) return "it was measured for the converging scheme alone";
  if (config.solver.time == "explicit" || config.solver.time == "dynamic") return not_for_dynamics;
  if (config.load.contact != usual.load.contact)
    return "it was measured for a circle to which the tissue is bonded";
  if (has_loads(config)) return "it was measured for bodies that bear no load but the tool's";
  if (has_membranes(config)) return "it was measured for bodies without a membrane";
  if (has_walls(config)) return "it was measured for bodies that touch no walls";
  if (!config.step.empty()) return "it was measured for a tool that is pushed straight in, once";
  if (!has_tool_alone(config))
    return "it was measured for one tool alone on a body that nothing holds but its base";
  if (const std::string none = why_no_band(tissues); !none.empty()) return none;
  if (config.solver.tolerance > usual.solver.tolerance)
    return fmt::format("it was measured for a tolerance of {:g}", usual.solver.tolerance);
  if (const double usual_step = longest_step(tool_of(config).has_value());
      longest_step_radii(config) > usual_step)
    return fmt::format("it was measured with steps of the load of at most {:g} radii", usual_step);
  if (config.cloud.rim != usual.cloud.rim || config.cloud.jitter != usual.cloud.jitter ||
      config.grid.points != usual.grid.points || config.grid.ratio != usual.grid.ratio ||
      config.support.basis != usual.support.basis || config.support.weight != usual.support.weight ||
      config.support.radius_factor != usual.support.radius_factor)
    return "it was measured for the default nodes, points and supports alone";
  if (const std::optional<ToolShape> tool = tool_of(config)) {
    if (tool->mesh) return "it was measured for spheres, rods and punches, not for a tool that was drawn";
    if (1e-3 * config.load.depth_mm < shallowest_with_tool_band * tool->radius * (1.0 - 1e-9))
      return fmt::format("of a tool that touches it was measured from {:g} of its radius on",
                         shallowest_with_tool_band);
    if (1e-3 * config.load.depth_mm <= deepest_with_tool_band * tool->radius * (1.0 + 1e-9)) return {};
    return fmt::format("of a tool that touches it was measured down to {:g} of its radius",
                       deepest_with_tool_band);
  }
  if (config.load.depth_mm > deepest_with_band * 0.5 * config.boundary.indenter_diameter_mm)
    return fmt::format("it was measured down to {} radii of the circle", deepest_with_band);
  return {};
}

}  // namespace

// Whether tissues of labels leave any label to the default one is known of the model alone.
std::string why_no_band(const Config& config) {
  std::vector<Material> tissues = materials_of(config);
  if (tissues.size() > 1) tissues.erase(tissues.begin());
  return why_no_band(config, tissues);
}

std::string why_no_band(const Config& config, const Organ& organ, const Boundary& boundary,
                        const Result& result) {
  if (result.time != TimeMode::quasi_static) return not_for_dynamics;
  if (const std::string none = why_no_band(config, in_use(result.tissues)); !none.empty()) return none;
  constexpr double straight = 0.9998;  // a degree
  if (config.boundary.direction != Config().boundary.direction && boundary.push.dot(boundary.down) < straight)
    return "it was measured for a circle that moves straight towards the base";
  if (result.loading.folds && (!(result.facing_share > most_facing) || result.cut.area_mm2 > 0.0))
    return "where folds touch it was measured for folded bodies that are not cut";
  const BodyUnderCircle body =
      body_under_circle(organ.body->surface, boundary, organ.options.boundary.voxel_mm);
  if (!tool_of(config)) return why_no_band(body);
  if (body.thickness >= thinnest_with_tool_band) return {};
  return fmt::format(
      "it was measured where the body is {:g} radii of the contact thick or more under it, and here it is "
      "{:.2g}",
      thinnest_with_tool_band, body.thickness);
}

std::string why_no_labels(const Config& config, const Origin& origin) {
  if (config.tissue.empty() || !origin.image.run.empty()) return {};
  return "it takes another cloud, and the labels of the image were not kept";
}

std::string why_no_band_after(const Config& config, const Result& result) {
  const Origin* origin = result.origin.get();
  if (!origin) return "a model's files hold one cloud, and it takes two";
  if (const std::string none = why_no_labels(config, *origin); !none.empty()) return none;
  if (const std::string none = why_no_band(config, origin->organ, origin->boundary, result); !none.empty())
    return none;
  const Index fewest = std::max(fewest_nodes_with_band(result.facing_share),
                                tool_of(config) ? fewest_nodes_with_tool_band : Index{0});
  if (result.model.node_count() >= fewest) return {};
  return fmt::format("it was measured from {0} nodes on{1}; give --nodes {0}", fewest,
                     result.facing_share > most_facing ? " where a body has folds" : "");
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

BandOfRun band_of_run(const Config& config, const Result& result, CoarserMarch& coarser) {
  const Stopwatch whole;
  BandOfRun found;
  Band& band = found.band;
  band.unknown = "";
  band.coarse_nodes = coarser.nodes();
  const std::string cloud = fmt::format("with {} nodes, with which it is compared, ", band.coarse_nodes);
  try {
    const Result& coarse = coarser();
    band.half = result.loading.touch
                    ? tool_half_widths(result.history.force, result.model, coarse.history.force,
                                       result.loading.touch->shape,
                                       {result.history.penetration, result.history.penetration_at})
                    : half_widths(result.history.force, result.model.node_count(), coarse.history.force,
                                  result.model.tool.radius, !config.tissue.empty());
    if (band.half.empty())
      band.unknown = cloud + "the force ends before";
    else if (result.loading.touch && has_finding(result.history, "hourglass"))
      band.half.clear(), band.unknown = "the cloud is too coarse for this load, as a warning says";
    else if (result.followed)
      found.half_of_displacement = half_of_displacement(result, coarse.followed->u);
  } catch (const Stopped&) {
    found.stopped = true;
    band.unknown = "the run was stopped before";
  } catch (const Error& error) {
    band.unknown = cloud + error.report.fact;
  } catch (const std::bad_alloc&) {
    band.unknown = cloud + "memory is short";
  }
  band.seconds = whole.seconds();
  return found;
}

}  // namespace dimple
