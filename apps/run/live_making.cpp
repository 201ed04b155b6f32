#include "apps/run/live_making.hpp"

#include <tbb/task_arena.h>

#include <algorithm>
#include <chrono>

#include "apps/run/stopwatch.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/surface/cut.hpp"

namespace dimple {
namespace {

template <class T>
bool is_ready(const std::future<T>& one) {
  return one.valid() && one.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
}

// Runs work on one processor, so that frames have the other; on more if it is needed at once.
template <class Work>
auto between_frames_of(Work work, int processors = 1) {
  return std::async(std::launch::async, [work = std::move(work), processors] {
    tbb::task_arena arena(processors);
    return arena.execute(work);
  });
}

// Makes the surface with the faces of the next cut, for drawing.
void open_next(LiveTool& tool) {
  if (tool.opening.valid() || tool.opened_cuts == tool.sheets.size()) return;
  const Vec3 keep = 1e3 * tool.session->tool().centre;
  tool.opening = between_frames_of(
      [organ = tool.organ, before = tool.opened, sheet = tool.sheets[tool.opened_cuts], keep] {
        const BodySurface& body = before ? *before : organ->organ->body->surface;
        const Eigen::Isometry3d to_body = body.to_world().inverse();
        const TriangleMesh own{to_body * (1e3 * sheet->vertex()).colwise().homogeneous(), sheet->triangles()};
        return std::make_shared<const BodySurface>(
            cut(body, {own}, organ->scene.image.cut_gap_mm, to_body * keep).surface);
      });
}

// A surface that cannot be drawn has no influence on the force.
void take_opening(LiveTool& tool) {
  ++tool.opened_cuts;
  try {
    tool.opened = tool.opening.get();
  } catch (const Stopped&) {
    throw;
  } catch (const std::exception&) {
  }
}

}  // namespace

Making in_the_making(const LiveTool& tool) {
  if (tool.cutting.valid()) return Making::cutting;
  return tool.finer.valid() ? Making::refining : Making::nothing;
}

void use(LiveTool& tool, TriedContact tried) {
  tool.session.emplace(std::move(tried.session));
  tool.fine = std::move(tried.fine);
  tool.coarse = std::move(tried.coarse);
  tool.left_out = tried.left_out;
  tool.most_left_out = std::max(tool.most_left_out, tool.left_out);
  ++tool.node_sets;
}

void make_finer(LiveTool& tool, const Site& site) {
  tool.finer = between_frames_of([organ = tool.organ, nodes = tool.nodes, site, sheets = tool.sheets] {
    return try_contact(*organ, nodes, site, sheets);
  });
  tool.finer_site = site;
}

void give_up_finer(LiveTool& tool) {
  if (tool.finer.valid()) tool.given_up.push_back(std::move(tool.finer));
  std::erase_if(tool.given_up, [](const auto& one) { return is_ready(one); });
  constexpr std::size_t most_given_up = 2;  // each uses a processor until it ends
  if (tool.given_up.size() > most_given_up) tool.given_up.front().wait();
}

void take_finer(LiveTool& tool, const FrameLimit& limit, double dt) {
  if (in_the_making(tool) != Making::refining || !is_ready(tool.finer)) return;
  try {
    TriedContact tried = tool.finer.get();
    if (tried.cuts < tool.sheets.size()) {  // cuts were made meanwhile
      make_finer(tool, tool.finer_site);
      return;
    }
    if (tool.frame.depth > 0.0) tried.session.follow(tool.frame.depth, limit, dt);
    use(tool, std::move(tried));
  } catch (const ModelError&) {  // the coarse nodes stay in use
  } catch (const SolveError&) {
  }
}

void take_cut(LiveTool& tool) {
  CutRecord record = std::move(tool.strokes.front());
  tool.strokes.pop_front();
  try {
    CutSession made = tool.cutting.get();
    made.session.continue_from(*tool.session, carried(made.cut, tool.session->nodal_parameters()),
                               made.cut.of_patch);
    tool.session.emplace(std::move(made.session));
    tool.sheets.push_back(std::move(made.sheet));
    tool.fine.clear(), tool.coarse.clear();
    record.area = made.cut.area;
    record.nodes = made.cut.added.rows.rows();
    record.seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - record.requested).count();
  } catch (const ModelError& error) {
    record.why = error.report.fact;
  } catch (const SolveError& error) {
    record.why = error.report.fact;
  } catch (...) {  // Ctrl-C
    record.why = "it was interrupted";
    tool.cuts.push_back(std::move(record));
    throw;
  }
  tool.cuts.push_back(std::move(record));
}

void next_cut(LiveTool& tool) {
  if (tool.strokes.empty() || in_the_making(tool) == Making::cutting) return;
  // The model keeps its place in memory until the cut is used.
  tool.cutting = between_frames_of(
      [organ = tool.organ, model = &tool.session->model(), u = tool.session->nodal_parameters(),
       stroke = tool.strokes.front().stroke] { return cut_session(given_of(*organ), *model, u, stroke); },
      tbb::task_arena::automatic);
}

void finish_cuts(LiveTool& tool) {
  for (next_cut(tool); in_the_making(tool) == Making::cutting; next_cut(tool)) take_cut(tool);
}

void take_cuts(LiveTool& tool) {
  if (is_ready(tool.cutting)) take_cut(tool);
  next_cut(tool);
  if (is_ready(tool.opening)) take_opening(tool);
  open_next(tool);
}

void cut(LiveTool& tool, const Stroke& stroke, bool in_parallel) {
  tool.strokes.push_back({.stroke = stroke});
  next_cut(tool);
  if (in_parallel) return;
  finish_cuts(tool);
  for (open_next(tool); tool.opening.valid(); open_next(tool)) take_opening(tool);
}

void end_cuts(LiveTool& tool, const std::vector<TimedStroke>& strokes, std::size_t next) {
  finish_cuts(tool);
  for (; next < strokes.size(); ++next)
    tool.cuts.push_back({.stroke = strokes[next].stroke, .why = "the path ended before its time"});
}

}  // namespace dimple
