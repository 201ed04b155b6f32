#include "apps/run/live.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "apps/run/live_making.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/tool_band.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

constexpr double aside = 0.25;      // radii from the axis within which the force is an estimate
constexpr double same_axis = 0.02;  // radii within which the tip is on the axis

}  // namespace

LiveTool make_live_tool(const LiveOrgan& organ, Index nodes) {
  LiveTool tool{.organ = &organ, .nodes = nodes};
  const Stopwatch making;
  use(tool, try_touch(organ, nodes, site_at(organ)));
  tool.made_s = making.seconds();
  tool.touches = 1;
  tool.tip = tool.came_down = tool.session->tool().centre;
  return tool;
}

void put_down(LiveTool& tool, const Vec3& tip, bool beside) {
  const Stopwatch making;
  finish_cuts(tool);
  // Viscoelastic tissue would leave its history of the tool with the coarse nodes.
  beside = beside && tool.nodes > first_nodes && !relaxes(tool.organ->materials);
  give_up_finer(tool);
  const Site site = site_at(*tool.organ, tip);
  if (beside) {
    Index left_out = 0;
    Session coarse = touch(*tool.organ, first_nodes, site, tool.sheets, &left_out);
    use(tool, {.session = std::move(coarse), .left_out = left_out});
    make_finer(tool, site);
  } else {
    use(tool, try_touch(*tool.organ, tool.nodes, site, tool.sheets));
  }
  tool.made_s = making.seconds();
  tool.frame = {};
  tool.came_down = tip;
  ++tool.touches;
}

std::optional<double> half_band(const LiveTool& tool) {
  const LiveFrame& now = tool.frame;
  if (tool.fine.size() < 2) return {};
  if (now.depth <= 0.0) return now.force == 0.0 ? std::optional(0.0) : std::nullopt;
  const double radius = tool.session->tool().radius, radii = now.depth / radius;
  if (radii > deepest_with_band) return {};
  double change = 0.0;
  for (std::size_t k = 1; k < tool.fine.size(); ++k) {
    change = std::max(change, std::abs(tool.fine[k].force / tool.coarse[k].force - 1.0));
    if (tool.fine[k].depth >= now.depth) break;
  }
  return std::abs(now.force) * band_half_width(change, tool.session->model().node_count(),
                                               {radii, !tool.organ->scene.tissues.empty()});
}

OnAxis on_axis(const ToolPlace& tool, const Vec3& tip) {
  const Vec3 from = tip - tool.centre;
  const double depth = from.dot(tool.push);
  return {depth, (from - depth * tool.push).norm()};
}

namespace {

// True if the tool with its tip there, or the side of a contacting tool, is in the body at rest.
bool reaches_in(const LiveOrgan& organ, const Vec3& push, const Vec3& tip) {
  const BodySurface& surface = organ.organ->body->surface;
  const Eigen::Isometry3d to_body = surface.to_world().inverse();
  if (surface.contains(to_body * (1e3 * tip))) return true;
  if (!organ.shape) return false;
  const ToolShape& shape = *organ.shape;
  if (shape.kind == "sphere")
    return !surface.farther(to_body * (1e3 * (tip - shape.radius * push)), 1e3 * shape.radius);
  const ToolPose pose{.tip = tip, .points_at = push};
  constexpr double noticed = 0.02;  // of the radius
  for (Index v = 0; v < surface.vertex().cols(); ++v) {
    const Vec3 x = 1e-3 * (surface.to_world() * Vec3(surface.vertex().col(v)));
    if (distance_to_tool(shape, pose, x).distance < -noticed * shape.radius) return true;
  }
  return false;
}

}  // namespace

TipAsked tip_asked(const LiveOrgan& organ, const ToolPlace& tool, double depth, const Vec3& tip) {
  using Way = TipAsked::Way;
  const OnAxis at = on_axis(tool, tip);
  if (at.aside <= same_axis * tool.radius) return {Way::axis, at};
  const bool near = at.aside <= aside * tool.radius, bonded = !organ.shape && depth > 0.0 && at.depth > 0.0;
  if (near && bonded) return {Way::beside, at};
  if (!reaches_in(organ, tool.push, tip)) return {Way::air, at};
  return {near ? Way::beside : bonded ? Way::elsewhere : Way::anew, at};
}

void tell_aside(LiveFrame& frame, const TipAsked& asked, double radius) {
  if (asked.way == TipAsked::Way::axis && asked.at.depth <= 0.0) return;  // in the air
  const bool near = asked.at.aside <= aside * radius;
  frame.error = near ? frame.error + force_apart(frame, asked.at.aside) : unknown_frame().error;
  if (asked.at.aside > same_axis * radius && frame.tool != LiveFrame::Tool::beyond)
    frame.tool = LiveFrame::Tool::elsewhere;
}

LiveFrame unknown_frame() {
  LiveFrame frame;
  frame.error = std::numeric_limits<double>::infinity();
  frame.tool = LiveFrame::Tool::elsewhere;
  return frame;
}

const char* name_of(LiveFrame::Tool tool) {
  constexpr std::array names = {"there", "lags", "stopped", "elsewhere", "beyond"};
  return names[static_cast<std::size_t>(tool)];
}

namespace {

// While a cut is made, a frame uses a part of its time and waits for the cut with the rest.
LiveFrame follow_and_cut(LiveTool& tool, double depth, const FrameLimit& limit, double dt) {
  constexpr double share = 0.1;
  const bool waits = limit.evaluations == 0 && in_the_making(tool) == Making::cutting;
  const Stopwatch watch;
  const LiveFrame frame =
      tool.session->follow(depth, waits ? FrameLimit{.seconds = share * limit.seconds} : limit, dt);
  const auto left = [&] { return limit.seconds - watch.seconds(); };
  if (!waits || !(left() > 0.0) ||
      tool.cutting.wait_for(std::chrono::duration<double>(left())) != std::future_status::ready)
    return frame;
  take_cut(tool);
  constexpr double worth_it = 2e-3;  // s: about two evaluations
  return left() > worth_it ? tool.session->follow(depth, {.seconds = left()}) : frame;
}

// True if the tool rests off its axis and its first contact; without history it is put down there.
bool is_to_come_down(const LiveTool& tool, const Vec3& tip) {
  const ToolPlace at = tool.session->tool();
  if (!tool.organ->shape && tool.session->depth() > 0.0) return false;
  const Vec3 off = tip - tool.came_down;
  return (tip - tool.tip).norm() <= same_axis * at.radius &&
         (off - off.dot(at.push) * at.push).norm() > same_axis * at.radius;
}

}  // namespace

LiveFrame move_depth(LiveTool& tool, double depth, const FrameLimit& limit, double dt) {
  take_cuts(tool);
  take_finer(tool, limit, dt);
  const ToolPlace at = tool.session->tool();
  tool.tip = at.centre + depth * at.push;
  return tool.frame = follow_and_cut(tool, depth, limit, dt);
}

namespace {

// Lifts the tool, and sets its frame.
LiveFrame leave(LiveTool& tool, const LiveFrame& frame) {
  tool.session->lift();
  return tool.frame = frame;
}

LiveFrame follow_tip(LiveTool& tool, const Vec3& tip, const FrameLimit& limit, double dt) {
  using Way = TipAsked::Way;
  take_cuts(tool);
  TipAsked asked = tip_asked(*tool.organ, tool.session->tool(), tool.session->depth(), tip);
  if (asked.way == Way::beside && is_to_come_down(tool, tip)) asked.way = Way::anew;
  tool.tip = tip;
  if (asked.way == Way::air) return leave(tool, {});
  if (asked.way == Way::anew)
    put_down(tool, tip, !tool.waits && limit.evaluations == 0);
  else
    take_finer(tool, limit, dt);
  asked.at = on_axis(tool.session->tool(), tip);
  tool.frame = follow_and_cut(tool, asked.at.depth, limit, dt);
  tell_aside(tool.frame, asked, tool.session->tool().radius);
  return tool.frame;
}

}  // namespace

LiveFrame move_tip(LiveTool& tool, const Vec3& tip, const FrameLimit& limit, double dt) {
  const ToolPlace at = tool.session->tool();
  const bool known = tool.no_place && (tip - *tool.no_place).norm() < aside * at.radius &&
                     reaches_in(*tool.organ, at.push, tip);
  if (!known) try {
      return follow_tip(tool, tip, limit, dt);
    } catch (const ModelError&) {
      tool.no_place = tip;
    }
  tool.tip = tip;
  return leave(tool, unknown_frame());
}

}  // namespace dimple
