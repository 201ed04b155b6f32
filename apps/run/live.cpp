#include "apps/run/live.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "apps/run/live_making.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/tool_error_bounds.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

constexpr double aside = 0.25;      // radii from the axis within which the force is an estimate
constexpr double same_axis = 0.02;  // radii within which the tip is on the axis

}  // namespace

LiveTool make_live_tool(const LiveOrgan& organ, Index nodes) {
  LiveTool tool{.organ = &organ, .nodes = nodes};
  const Stopwatch making;
  use(tool, try_contact(organ, nodes, site_at(organ)));
  tool.made_s = making.seconds();
  tool.contact_count = 1;
  tool.tip = tool.came_down = tool.session->tool().centre;
  return tool;
}

void begin_contact(LiveTool& tool, const Vec3& tip, bool in_parallel) {
  const Stopwatch making;
  finish_cuts(tool);
  // Viscoelastic tissue would leave its history of the tool with the coarse nodes.
  in_parallel = in_parallel && tool.nodes > first_nodes && !relaxes(tool.organ->materials);
  give_up_finer(tool);
  const Site site = site_at(*tool.organ, tip);
  if (in_parallel) {
    Index left_out = 0;
    Session coarse = session_of(*tool.organ, first_nodes, site, tool.sheets, &left_out);
    use(tool, {.session = std::move(coarse), .left_out = left_out});
    make_finer(tool, site);
  } else {
    use(tool, try_contact(*tool.organ, tool.nodes, site, tool.sheets));
  }
  tool.made_s = making.seconds();
  tool.frame = {};
  tool.came_down = tip;
  ++tool.contact_count;
}

std::optional<double> half_error(const LiveTool& tool) {
  const LiveFrame& now = tool.frame;
  if (tool.fine.size() < 2) return {};
  if (now.depth <= 0.0) return now.force == 0.0 ? std::optional(0.0) : std::nullopt;
  const double radius = tool.session->tool().radius, radii = now.depth / radius;
  if (radii > deepest_with_error_bounds) return {};
  double change = 0.0;
  for (std::size_t k = 1; k < tool.fine.size(); ++k) {
    change = std::max(change, std::abs(tool.fine[k].force / tool.coarse[k].force - 1.0));
    if (tool.fine[k].depth >= now.depth) break;
  }
  return std::abs(now.force) * error_half_width(change, tool.session->model().node_count(),
                                                {radii, !tool.organ->scene.tissues.empty()});
}

OnAxis on_axis(const ToolPlace& tool, const Vec3& tip) {
  const Vec3 from = tip - tool.centre;
  const double depth = from.dot(tool.approach);
  return {depth, (from - depth * tool.approach).norm()};
}

namespace {

// True if the tool with its tip there, or the side of a contacting tool, is in the body at rest.
bool reaches_in(const LiveOrgan& organ, const Vec3& approach, const Vec3& tip) {
  const BodySurface& surface = organ.organ->body->surface;
  const Eigen::Isometry3d to_body = surface.to_world().inverse();
  if (surface.contains(to_body * (1e3 * tip))) return true;
  if (!organ.shape) return false;
  const ToolShape& shape = *organ.shape;
  if (shape.kind == "sphere")
    return !surface.farther(to_body * (1e3 * (tip - shape.radius * approach)), 1e3 * shape.radius);
  const ToolPose pose{.tip = tip, .points_at = approach};
  constexpr double noticed = 0.02;  // of the radius
  for (Index v = 0; v < surface.vertex().cols(); ++v) {
    const Vec3 x = 1e-3 * (surface.to_world() * Vec3(surface.vertex().col(v)));
    if (distance_to_tool(shape, pose, x).distance < -noticed * shape.radius) return true;
  }
  return false;
}

}  // namespace

TipRequest tip_request(const LiveOrgan& organ, const ToolPlace& tool, double depth, const Vec3& tip) {
  using Kind = TipRequest::Kind;
  const OnAxis at = on_axis(tool, tip);
  if (at.aside <= same_axis * tool.radius) return {Kind::axis, at};
  const bool near = at.aside <= aside * tool.radius, bonded = !organ.shape && depth > 0.0 && at.depth > 0.0;
  if (near && bonded) return {Kind::next_to, at};
  if (!reaches_in(organ, tool.approach, tip)) return {Kind::air, at};
  return {near ? Kind::next_to : bonded ? Kind::elsewhere : Kind::new_place, at};
}

void report_lateral(LiveFrame& frame, const TipRequest& requested, double radius) {
  if (requested.kind == TipRequest::Kind::axis && requested.at.depth <= 0.0) return;  // in the air
  const bool near = requested.at.aside <= aside * radius;
  frame.error = near ? frame.error + force_apart(frame, requested.at.aside) : unknown_frame().error;
  if (requested.at.aside > same_axis * radius && frame.tool != LiveFrame::Tool::beyond)
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
  constexpr double fraction = 0.1;
  const bool waits = limit.evaluations == 0 && in_the_making(tool) == Making::cutting;
  const Stopwatch watch;
  const LiveFrame frame =
      tool.session->follow(depth, waits ? FrameLimit{.seconds = fraction * limit.seconds} : limit, dt);
  const auto left = [&] { return limit.seconds - watch.seconds(); };
  if (!waits || !(left() > 0.0) ||
      tool.cutting.wait_for(std::chrono::duration<double>(left())) != std::future_status::ready)
    return frame;
  take_cut(tool);
  constexpr double worth_it = 2e-3;  // s: about two evaluations
  return left() > worth_it ? tool.session->follow(depth, {.seconds = left()}) : frame;
}

// True if the tool rests off its axis and its first contact; without history it is put down there.
bool is_to_approach(const LiveTool& tool, const Vec3& tip) {
  const ToolPlace at = tool.session->tool();
  if (!tool.organ->shape && tool.session->depth() > 0.0) return false;
  const Vec3 off = tip - tool.came_down;
  return (tip - tool.tip).norm() <= same_axis * at.radius &&
         (off - off.dot(at.approach) * at.approach).norm() > same_axis * at.radius;
}

}  // namespace

LiveFrame move_depth(LiveTool& tool, double depth, const FrameLimit& limit, double dt) {
  take_cuts(tool);
  take_finer(tool, limit, dt);
  const ToolPlace at = tool.session->tool();
  tool.tip = at.centre + depth * at.approach;
  return tool.frame = follow_and_cut(tool, depth, limit, dt);
}

namespace {

// Lifts the tool, and sets its frame.
LiveFrame leave(LiveTool& tool, const LiveFrame& frame) {
  tool.session->lift();
  return tool.frame = frame;
}

LiveFrame follow_tip(LiveTool& tool, const Vec3& tip, const FrameLimit& limit, double dt) {
  using Kind = TipRequest::Kind;
  take_cuts(tool);
  TipRequest requested = tip_request(*tool.organ, tool.session->tool(), tool.session->depth(), tip);
  if (requested.kind == Kind::next_to && is_to_approach(tool, tip)) requested.kind = Kind::new_place;
  tool.tip = tip;
  if (requested.kind == Kind::air) return leave(tool, {});
  if (requested.kind == Kind::new_place)
    begin_contact(tool, tip, !tool.waits && limit.evaluations == 0);
  else
    take_finer(tool, limit, dt);
  requested.at = on_axis(tool.session->tool(), tip);
  tool.frame = follow_and_cut(tool, requested.at.depth, limit, dt);
  report_lateral(tool.frame, requested, tool.session->tool().radius);
  return tool.frame;
}

}  // namespace

LiveFrame move_tip(LiveTool& tool, const Vec3& tip, const FrameLimit& limit, double dt) {
  const ToolPlace at = tool.session->tool();
  const bool known = tool.no_place && (tip - *tool.no_place).norm() < aside * at.radius &&
                     reaches_in(*tool.organ, at.approach, tip);
  if (!known) try {
      return follow_tip(tool, tip, limit, dt);
    } catch (const ModelError&) {
      tool.no_place = tip;
    }
  tool.tip = tip;
  return leave(tool, unknown_frame());
}

}  // namespace dimple
