#include "apps/run/live.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>

#include "apps/run/compatibility.hpp"
#include "apps/run/cuts.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/results.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/tool_band.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"
#include "preprocess/output/carry_back.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr double aside = 0.25;      // radii from the axis within which the force is known roughly
constexpr double same_axis = 0.02;  // and on it

}  // namespace

LiveOrgan read_live_organ(const Config& config, const RunObserver& observer) {
  LiveOrgan live{.config = config, .result = {}};
  const RunLog log{observer, live.result};
  check_pairs(config, Feature::by_hand);
  if (tool_of(config)) check_pairs(config, Feature::touching_by_hand);
  check_loads(config);
  check_supports(config);
  check_tool(config);
  live.config.load.self_contact = "off";
  live.organ.emplace(read_organ({.config = live.config}, model_options(config), log, live.result));
  live.materials = materials_of(config);
  live.shape = tool_of(live.config);
  live.base = find_boundary(live.organ->body->surface, live.organ->options.boundary);
  for (const std::string& warning : live.base->warnings) log.warn(warning);
  return live;
}

Site site_at(const LiveOrgan& live, const std::optional<Vec3>& tip) {
  ModelOptions options = live.organ->options;
  if (tip)
    options.boundary.indent_at = fmt::format("{},{},{}", 1e3 * tip->x(), 1e3 * tip->y(), 1e3 * tip->z());
  return find_site(live.organ->body->surface, options, live.base ? &*live.base : nullptr);
}

namespace {

SessionGiven given_of(const LiveOrgan& live) {
  const SegmentedBody& body = *live.organ->body;
  return {live.config, live.materials, live.organ->label_names, &body.surface, body.report.step_mm};
}

// The nodes that a piece of the body is held by.
std::vector<Index> held_nodes(const SessionGiven& given, const Model& model) {
  std::vector<Index> held = model.base;
  if (!tool_of(given.config) && loading_of(given.config).contact == Contact::bonded)
    held.insert(held.end(), model.circle.begin(), model.circle.end());
  for (const HeldSet& set : supports_of(given.config, model, given.label_names).sets)
    if (set.hold == HeldSet::Hold::all) held.insert(held.end(), set.node.begin(), set.node.end());
  return held;
}

// A bonded circle's nodes would hold both banks.
void refuse_under_circle(const SessionGiven& given, const Model& model, const Sheet& sheet) {
  if (tool_of(given.config) || loading_of(given.config).contact != Contact::bonded) return;
  for (const Index a : model.circle)
    if (sheet.between(model.X.col(a), model.X.col(model.circle.front())))
      throw ModelError({.fact = "the cut passes under the circle",
                        .where = "cut",
                        .why = "the circle's nodes would hold both banks",
                        .remedy = "cut beside it, or press with --tool sphere:5mm, which touches alone",
                        .code = "cut"});
}

SheetCut cut_model(const SessionGiven& given, const Model& model, const std::shared_ptr<const Sheet>& sheet) {
  refuse_under_circle(given, model, *sheet);
  const std::vector<double> density = tissues_of(given.config, given.label_names, model).density;
  return cut_by_sheet(model, sheet, density, held_nodes(given, model));
}

}  // namespace

Session session_on(const SessionGiven& given, Model model) {
  Loads loads = loads_of(given.config, model, model.surface);
  std::shared_ptr<const Touch> its_touch = touch_of(given.config, model);
  std::vector<HeldSet> supports = supports_of(given.config, model, given.label_names).sets;
  return Session(std::move(model), given.materials,
                 {.contact = loading_of(given.config).contact,
                  .precision = precision_of(given.config),
                  .tolerance = given.config.solver.tolerance,
                  .further = std::move(supports),
                  .loads = std::move(loads),
                  .touch = std::move(its_touch)});
}

Session touch(const LiveOrgan& live, Index nodes, const Site& site, const Sheets& sheets, Index* left_out) {
  ModelOptions options = live.organ->options;
  options.cloud.count = nodes;
  options.cloud.spacing_mm = 0.0;
  const LabelAt label_at = labels_of(live.config, *live.organ, live.result.image);
  Discretisation places = discretise(live.organ->body->surface, options, label_at, site).places;
  const TissueOptions tissues = tissues_of(live.config, live.organ->label_names, places);
  Eigen::VectorXi tissue = tissue_of_points(places, tissues);
  Model model = make_model(std::move(places), options.scheme, std::move(tissue), tissues.density);
  for (const std::shared_ptr<const Sheet>& sheet : sheets) try {
      model = cut_model(given_of(live), model, sheet).model;
    } catch (const ModelError&) {
      if (left_out) ++*left_out;
    }
  return session_on(given_of(live), std::move(model));
}

namespace {

// Forces at equilibria down to one radius, of a tool that touches to 0.8, as far as there are any.
std::vector<ForceSample> forces_to_radius(Session& session) {
  const double deepest = (session.touch() ? deepest_with_tool_band : 1.0) * session.tool().radius;
  std::vector<ForceSample> curve = {{}};
  for (int k = 1; k <= 4; ++k) {
    const LiveFrame frame = session.follow(0.25 * k * deepest, {.evaluations = 500});
    if (frame.tool != LiveFrame::Tool::there) break;
    curve.push_back({.t = 0.0, .depth = frame.depth, .force = frame.force, .base_force = frame.force});
  }
  session.lift();
  return curve;
}

// From here on the tool is on this cloud.
void use(LiveTool& tool, TriedTouch tried) {
  tool.session.emplace(std::move(tried.session));
  tool.fine = std::move(tried.fine);
  tool.coarse = std::move(tried.coarse);
  tool.left_out = tried.left_out;
  tool.most_left_out = std::max(tool.most_left_out, tool.left_out);
  ++tool.clouds;
}

template <class T>
bool is_ready(const std::future<T>& one) {
  return one.valid() && one.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
}

// On a processor of its own, as the frames need the other; on more if it is wanted at once.
template <class Work>
auto beside_frames(Work work, int processors = 1) {
  return std::async(std::launch::async, [work = std::move(work), processors] {
    tbb::task_arena arena(processors);
    return arena.execute(work);
  });
}

void make_finer(LiveTool& tool, const Site& site) {
  tool.finer = beside_frames([organ = tool.organ, nodes = tool.nodes, site, sheets = tool.sheets] {
    return try_touch(*organ, nodes, site, sheets);
  });
  tool.finer_site = site;
}

// The finer cloud takes the coarse one's place, where the tool is.
void take_finer(LiveTool& tool, const FrameLimit& limit, double dt) {
  if (!is_ready(tool.finer) || tool.cutting.valid()) return;
  try {
    TriedTouch tried = tool.finer.get();
    if (tried.cuts < tool.sheets.size()) {  // some were made meanwhile
      make_finer(tool, tool.finer_site);
      return;
    }
    if (tool.frame.depth > 0.0) tried.session.follow(tool.frame.depth, limit, dt);
    use(tool, std::move(tried));
  } catch (const ModelError&) {  // then the coarse one goes on
  } catch (const SolveError&) {
  }
}

}  // namespace

TriedTouch try_touch(const LiveOrgan& live, Index nodes, const Site& site, const Sheets& sheets) {
  Index left_out = 0;
  TriedTouch tried{.session = touch(live, nodes, site, sheets, &left_out), .cuts = sheets.size()};
  tried.left_out = left_out;
  std::vector<ForceSample> fine = forces_to_radius(tried.session);
  // The band was measured for nothing else, and of a tool that touches with other clouds.
  if (!has_tool_alone(live.config) || tried.session.touch() || !sheets.empty()) return tried;
  if (nodes < fewest_nodes_with_band(live.result.facing_share) || fine.size() < 2) return tried;
  Session coarse = touch(live, std::max(first_nodes, nodes / 4), site);
  std::vector<ForceSample> its = forces_to_radius(coarse);
  fine.resize(std::min(fine.size(), its.size()));
  its.resize(fine.size());
  if (fine.size() > 1) tried.fine = std::move(fine), tried.coarse = std::move(its);
  return tried;
}

namespace {

// The surface with the banks of the next cut, for who draws it.
void open_next(LiveTool& tool) {
  if (tool.opening.valid() || tool.opened_cuts == tool.sheets.size()) return;
  const Vec3 keep = 1e3 * tool.session->tool().centre;
  tool.opening =
      beside_frames([organ = tool.organ, before = tool.opened, sheet = tool.sheets[tool.opened_cuts], keep] {
        const BodySurface& body = before ? *before : organ->organ->body->surface;
        const Eigen::Isometry3d to_body = body.to_world().inverse();
        const TriangleMesh own{to_body * (1e3 * sheet->vertex()).colwise().homogeneous(), sheet->triangles()};
        return std::make_shared<const BodySurface>(
            cut(body, {own}, organ->config.image.cut_gap_mm, to_body * keep).surface);
      });
}

// A surface that cannot be drawn changes no force.
void take_opening(LiveTool& tool) {
  ++tool.opened_cuts;
  try {
    tool.opened = tool.opening.get();
  } catch (const Stopped&) {
    throw;
  } catch (const std::exception&) {
  }
}

void take_cut(LiveTool& tool) {
  CutRecord record = std::move(tool.strokes.front());
  tool.strokes.pop_front();
  try {
    CutSession made = tool.cutting.get();
    made.session.go_on_from(*tool.session, carried(made.cut, tool.session->nodal_parameters()),
                            made.cut.of_patch);
    tool.session.emplace(std::move(made.session));
    tool.sheets.push_back(std::move(made.sheet));
    tool.fine.clear(), tool.coarse.clear();
    record.area = made.cut.area;
    record.nodes = made.cut.added.rows.rows();
    record.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - record.asked).count();
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
  if (tool.strokes.empty() || tool.cutting.valid()) return;
  // The model stays where it is until the cut is taken up.
  tool.cutting = beside_frames(
      [organ = tool.organ, model = &tool.session->model(), u = tool.session->nodal_parameters(),
       stroke = tool.strokes.front().stroke] { return cut_session(given_of(*organ), *model, u, stroke); },
      tbb::task_arena::automatic);
}

void finish_cuts(LiveTool& tool) {
  for (next_cut(tool); tool.cutting.valid(); next_cut(tool)) take_cut(tool);
}

}  // namespace

void take_cuts(LiveTool& tool) {
  if (is_ready(tool.cutting)) take_cut(tool);
  next_cut(tool);
  if (is_ready(tool.opening)) take_opening(tool);
  open_next(tool);
}

void cut(LiveTool& tool, const Stroke& stroke, bool beside) {
  tool.strokes.push_back({.stroke = stroke});
  next_cut(tool);
  if (beside) return;
  finish_cuts(tool);
  for (open_next(tool); tool.opening.valid(); open_next(tool)) take_opening(tool);
}

void end_cuts(LiveTool& tool, const std::vector<TimedStroke>& strokes, std::size_t next) {
  finish_cuts(tool);
  for (; next < strokes.size(); ++next)
    tool.cuts.push_back({.stroke = strokes[next].stroke, .why = "the way ended before its time"});
}

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
  // What tissue remembers of a tool would stay with the coarse cloud.
  beside = beside && tool.nodes > first_nodes && !relaxes(tool.organ->materials);
  if (tool.finer.valid()) tool.given_up.push_back(std::move(tool.finer));
  std::erase_if(tool.given_up, [](const auto& one) { return is_ready(one); });
  constexpr std::size_t most_given_up = 2;  // each takes a processor until it is done
  if (tool.given_up.size() > most_given_up) tool.given_up.front().wait();
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

CutSession cut_session(const SessionGiven& given, const Model& before, const Points& u,
                       const Stroke& stroke) {
  constexpr double fields = 6.0;  // along a stroke: as far as a short one may be bent
  const double step = std::max({given.step_mm, 1e3 * (stroke.to - stroke.from).norm() / fields, 1e-3});
  const TriangleMesh blade =
      stroke_at_rest(1e3 * stroke.from, 1e3 * stroke.to, 1e3 * stroke.depth, step, before, u, *given.rest);
  const auto sheet = std::make_shared<const Sheet>(1e-3 * blade.vertex, blade.triangles);
  SheetCut cut = cut_model(given, before, sheet);
  Session session = session_on(given, std::move(cut.model));
  return {std::move(session), sheet, std::move(cut)};
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
                                               {radii, !tool.organ->config.tissue.empty()});
}

OnAxis on_axis(const ToolPlace& tool, const Vec3& tip) {
  const Vec3 from = tip - tool.centre;
  const double depth = from.dot(tool.push);
  return {depth, (from - depth * tool.push).norm()};
}

namespace {

// Whether the tool, with its tip there, is in the body at rest: of one that touches its side may be, too.
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

// Beside a cut that is in the making a frame takes little of its time, and waits for it with the rest.
LiveFrame follow_and_cut(LiveTool& tool, double depth, const FrameLimit& limit, double dt) {
  constexpr double share = 0.1;
  const bool waits = limit.evaluations == 0 && tool.cutting.valid();
  const Stopwatch watch;
  const LiveFrame frame =
      tool.session->follow(depth, waits ? FrameLimit{.seconds = share * limit.seconds} : limit, dt);
  const auto left = [&] { return limit.seconds - watch.seconds(); };
  if (!waits || !(left() > 0.0) ||
      tool.cutting.wait_for(std::chrono::duration<double>(left())) != std::future_status::ready)
    return frame;
  take_cut(tool);
  constexpr double worth_it = 2e-3;  // s: an evaluation or two
  return left() > worth_it ? tool.session->follow(depth, {.seconds = left()}) : frame;
}

}  // namespace

namespace {

// A tool that rests beside its axis, and not where it came down: what has no past comes down there.
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

LiveFrame follow_tip(LiveTool& tool, const Vec3& tip, const FrameLimit& limit, double dt) {
  using Way = TipAsked::Way;
  take_cuts(tool);
  TipAsked asked = tip_asked(*tool.organ, tool.session->tool(), tool.session->depth(), tip);
  if (asked.way == Way::beside && is_to_come_down(tool, tip)) asked.way = Way::anew;
  tool.tip = tip;
  if (asked.way == Way::air) {
    tool.session->lift();
    return tool.frame = {};
  }
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
  tool.session->lift();
  return tool.frame = unknown_frame();
}

}  // namespace dimple
