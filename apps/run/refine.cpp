#include "apps/run/refine.hpp"

#include <fmt/format.h>

#include <cmath>

#include "apps/run/model_options.hpp"
#include "apps/run/pipeline.hpp"
#include "apps/run/run_error_bounds.hpp"
#include "apps/run/unless_stopped.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

using Line = RunObserver::Line;

std::unique_ptr<Level> march_level(Index nodes, const Case& given, const Origin& from, const Result& read,
                                   const RunObserver& observer) {
  const Stopwatch whole;
  auto level = std::make_unique<Level>();
  level->requested = nodes;
  Result& result = level->result = read;
  result.stages = {};  // restarts its clock
  result.stages.add(read.stages);
  const RunObserver keeping{.line =
                                [&](Line kind, const std::string& text) {
                                  if (kind == Line::doing && observer.line) return observer.line(kind, text);
                                  level->lines.emplace_back(kind, text);
                                },
                            .part = observer.part};
  const RunLog log{keeping, result};
  make_ready(given, place(nodes, given.scene, from.organ, from.image, log, result), log, result);
  refuse_without_error_bounds(why_no_error_bounds(given.scene, from.organ, result.report.boundary, result));
  log.begin(Part::solving, given.scene);
  const Observer hears{
      .frame =
          [&](const Frame& frame) {
            level->frames.push_back({frame.number, frame.t, frame.depth, frame.u, frame.f, frame.forces});
          },
      .sample = [](const ForceSample&, const History&) { return stop_requested() == StopReason::none; },
      .retry =
          [&](const Retry& retry) {
            log.detail(
                fmt::format("retry    at {:.3f} mm ({}): {}", 1e3 * retry.depth, retry.code, retry.what));
          }};
  level->system = march(given.scene, solver_options(given.scene), hears, nullptr, log, result);
  if (result.history.interrupted) throw Stopped(stop_requested());
  level->seconds = whole.seconds();
  return level;
}

// Sets the error bounds of a level from the level before.
void compare(Result& now, const Level* before, bool several_tissues) {
  if (!before) {
    now.error_bounds.unknown = "the run ended with its first set of nodes";
    return;
  }
  const Result& coarse = before->result;
  now.error_bounds.half = half_widths(now.history.force, now.model.node_count(), coarse.history.force,
                                      now.model.tool.radius, several_tissues);
  now.error_bounds.unknown = "";
  now.error_bounds.coarse_nodes = coarse.model.node_count();
  if (now.followed) now.followed->half = half_of_displacement(now, coarse.followed->u);
}

RefinementLevel report_of(const Level& level) {
  const Result& now = level.result;
  RefinementLevel reported{.nodes = now.model.node_count(),
                           .force = now.history.force.back().force,
                           .half = now.error_bounds.known() ? now.error_bounds.half.back() : 0.0,
                           .seconds = level.seconds};
  if (now.followed) reported.length = now.followed->u.norm(), reported.half_length = now.followed->half;
  return reported;
}

bool may_be_too_coarse(const Error& error) {
  return (error.code == ExitCode::model || error.code == ExitCode::solve) && error.report.code != "memory";
}

// Reason why the next level is not tried, or nothing.
std::optional<RefinementEnd> end_before(Index next, Index nodes, const Level& level, const Goal& goal,
                                        const Stopwatch& whole) {
  const double expected = level.seconds * static_cast<double>(next) / static_cast<double>(nodes);
  if (goal.budget_s > 0.0 && whole.seconds() + expected > goal.budget_s)
    return RefinementEnd{.why = RefinementEnd::Why::out_of_time, .nodes = next, .seconds = expected};
  if (next > most_nodes_for_accuracy) return RefinementEnd{.why = RefinementEnd::Why::too_many_nodes};
  return std::nullopt;
}

// Bounds the only level with a force, after finer ones failed, by one of half its nodes. It may reach the
// goal.
void compare_with_coarser(const Case& given, const Goal& goal, const Origin& from, const Result& read,
                          const Stopwatch& whole, const RefinementObserver& observer, int number,
                          Refinement& found) {
  Level& finest = *found.finest;
  const Index nodes = finest.requested / 2, fewest = fewest_nodes_with_error_bounds(read.facing_fraction);
  if (finest.requested < fewest) {
    finest.result.error_bounds.unknown =
        fmt::format("not calibrated below {} nodes, and no larger set of nodes reached a force", fewest);
    return;
  }
  const bool in_time = goal.budget_s == 0.0 || whole.seconds() + 0.5 * finest.seconds < goal.budget_s;
  if (nodes <= found.too_coarse || !in_time) return;
  try {
    const std::unique_ptr<Level> coarser =
        unless_stopped([&] { return march_level(nodes, given, from, read, observer.of_march); });
    compare(finest.result, coarser.get(), !given.scene.tissues.empty());
    found.levels.insert(found.levels.end() - 1, report_of(*coarser));
    found.levels.back() = report_of(finest);
    observer.marched(number, found.levels[found.levels.size() - 2]);
    const auto [last, half] = requested_for(found.levels.back(), finest.result);
    if (half <= goal.half_width(last)) found.stopped_short.reset();
  } catch (const Stopped&) {
    found.stopped_short = RefinementEnd{.why = RefinementEnd::Why::stopped};
  } catch (const Error& error) {
    observer.failed(number, nodes, error.report.fact);
  }
}

}  // namespace

void refuse_without_error_bounds(const std::string& none) {
  if (none.empty()) return;
  throw UsageError({.fact = "the accuracy of this run cannot be estimated",
                    .where = "--accuracy (accuracy.goal) or --budget (accuracy.budget_s)",
                    .why = "it needs error bounds of the force: " + none,
                    .remedy = "leave them out, and compare several --nodes"});
}

void check_goal(const Scene& scene) {
  if (!scene.goal || scene.followed) return;
  const double least = error_floor(scene)(most_nodes_for_accuracy);
  if (scene.goal->fraction == 0.0 || scene.goal->fraction >= least) return;
  throw UsageError({.fact = fmt::format("an accuracy of {} is requested", scene.goal->text),
                    .where = "--accuracy (accuracy.goal)",
                    .why = fmt::format("the error of this load cannot be shown to be below {:.2g} %: two "
                                       "node sets may agree that well by chance",
                                       100.0 * least),
                    .remedy = "request less accuracy, or a depth below the radius of the contact patch"});
}

std::pair<double, double> requested_for(const RefinementLevel& level, const Solution& result) {
  return result.followed ? std::pair(level.length, level.half_length)
                         : std::pair(std::abs(level.force), level.half);
}

Refinement refine(const Case& given, const Goal& goal, const Origin& from, const Result& read,
                  const Stopwatch& whole, const RefinementObserver& observer) {
  const Stopwatch refining;
  Refinement found;
  // Nodes may be too few for a body; two failures in a row have another reason.
  constexpr int most_failures = 2;
  int failures = 0, number = 0;
  // The floor of a displacement's bounds, as a part of it, is not known in advance.
  const Index hoped =
      expected_nodes(read.followed ? 0.0 : goal.fraction, read.facing_fraction, error_floor(given.scene));
  Index nodes = nodes_of_first_level(hoped);
  while (!found.stopped_short) {
    ++number;
    const Stopwatch marching;
    std::unique_ptr<Level> level;
    try {
      level = unless_stopped([&] { return march_level(nodes, given, from, read, observer.of_march); });
    } catch (const Stopped&) {
      if (!found.finest) throw;
      found.stopped_short = RefinementEnd{.why = RefinementEnd::Why::stopped};
      break;
    } catch (const Error& error) {
      const RefinementEnd end{.why = RefinementEnd::Why::failed, .nodes = nodes, .fact = error.report.fact};
      // Finer nodes than those that failed are assumed to fail too if coarser ones have reached a force.
      const Index next = found.finest ? nodes / 2 : 2 * nodes;
      const double expected = marching.seconds() * static_cast<double>(next) / static_cast<double>(nodes);
      const bool in_time = goal.budget_s == 0.0 || whole.seconds() + expected < goal.budget_s;
      const bool again = may_be_too_coarse(error) && in_time &&
                         (found.finest ? next > found.finest->requested
                                       : ++failures < most_failures && next <= most_nodes_for_accuracy);
      if (!again && !found.finest) throw;
      observer.failed(number, nodes, error.report.fact);
      if (found.finest)
        found.failed = end;
      else
        found.too_coarse = nodes;
      if (!again) {
        found.stopped_short = end;
        break;
      }
      nodes = next;
      continue;
    }
    compare(level->result, found.finest.get(), !given.scene.tissues.empty());
    found.levels.push_back(report_of(*level));
    observer.marched(number, found.levels.back());
    const auto [last, half] = requested_for(found.levels.back(), level->result);
    const double goal_width = goal.half_width(last);
    const bool known = level->result.error_bounds.known();
    found.finest = std::move(level);
    if (known && half <= goal_width) break;
    const Index next =
        known ? nodes_of_next_level(nodes, half, goal_width) : nodes_of_second_level(nodes, hoped);
    found.stopped_short = found.failed && next >= found.failed->nodes
                              ? found.failed
                              : end_before(next, nodes, *found.finest, goal, whole);
    nodes = next;
  }
  const bool stopped_on_request =
      found.stopped_short && found.stopped_short->why == RefinementEnd::Why::stopped;
  if (found.failed && !stopped_on_request && !found.finest->result.error_bounds.known())
    compare_with_coarser(given, goal, from, read, whole, observer, ++number, found);
  found.seconds = refining.seconds();
  return found;
}

void replay(Level level, const RunObserver& observer, Result& result) {
  result = std::move(level.result);
  for (const auto& [kind, text] : level.lines)
    if (observer.line) observer.line(kind, text);
  if (observer.placed) observer.placed(result.model, result.model.scheme);
  Stopwatch writing;
  try {
    stop_if_requested();
    if (observer.begin) observer.begin(result);
    writing = {};
    for (const KeptFrame& frame : level.frames)
      if (observer.march.frame)
        observer.march.frame({frame.number, frame.t, frame.depth, frame.u, frame.f, frame.forces});
    if (observer.march.sample) observer.march.sample(result.history.force.back(), result.history);
  } catch (const Stopped&) {
    // The force is available, and takes a moment to write.
    result.history.interrupted = true;
    if (observer.begin) observer.begin(result);
  }
  result.image = {};
  result.solve_s += writing.seconds();
}

}  // namespace dimple
