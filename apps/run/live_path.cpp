// Path of a live tool over time, its records and its messages.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "apps/run/live.hpp"
#include "apps/run/results.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/words.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr double longest_path = 3600.0;  // s

[[noreturn]] void refuse_path(const fs::path& file, const std::string& fact, const std::string& why,
                              const std::string& remedy) {
  throw InputError({.fact = fact, .where = file.string(), .why = why, .remedy = remedy, .code = "bad-path"});
}

double quantile(std::vector<double> values, double fraction) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  const auto k = static_cast<std::size_t>(fraction * static_cast<double>(values.size()));
  return values[std::min(k, values.size() - 1)];
}

}  // namespace

ToolPath read_tool_path(const fs::path& file) {
  const Table table = read_csv(file);
  const auto *time = table.find("time_s"), *depth = table.find("depth_mm"), *x = table.find("x_mm"),
             *y = table.find("y_mm"), *z = table.find("z_mm");
  const bool has_tip = x && y && z;
  if (!time || (depth == nullptr) == !has_tip)
    refuse_path(file,
                !time   ? "there is no column time_s"
                : depth ? "there are both depth_mm and x_mm, y_mm, z_mm"
                        : "there is neither depth_mm nor x_mm, y_mm, z_mm",
                fmt::format("the columns are named {}, and a path is one of the two against time",
                            fmt::join(table.header, ", ")),
                "give time_s and depth_mm, or time_s, x_mm, y_mm and z_mm (LPS)");
  if (table.rows() < 2)
    refuse_path(file, fmt::format("the path has {} row{}", table.rows(), table.rows() == 1 ? "" : "s"),
                "a path needs two", "give at least its start and its end");
  for (std::size_t k = 1; k < time->size(); ++k)
    if (!((*time)[k] > (*time)[k - 1]))
      refuse_path(
          file,
          fmt::format("row {} is at {:g} s, the one before at {:g} s", k + 1, (*time)[k], (*time)[k - 1]),
          "time must increase along a path", "sort the rows, and remove duplicates");
  if (time->back() - time->front() > longest_path)
    refuse_path(file, fmt::format("the path lasts {:g} s", time->back() - time->front()),
                "the longest path is one hour", "give time_s in seconds, or shorten the path");
  ToolPath path;
  path.time = *time;
  if (depth) {
    for (const double d : *depth) path.depth.push_back(1e-3 * d);
  } else {
    path.tip.resize(3, static_cast<Index>(time->size()));
    for (std::size_t k = 0; k < time->size(); ++k)
      path.tip.col(static_cast<Index>(k)) = 1e-3 * Vec3((*x)[k], (*y)[k], (*z)[k]);
  }
  return path;
}

PathFrame path_frame(LiveTool& tool, const ToolPath& path, double time, const FrameLimit& limit, double dt) {
  const auto after = std::upper_bound(path.time.begin() + 1, path.time.end() - 1, time) - path.time.begin();
  const auto k = static_cast<std::size_t>(after - 1);
  const double fraction = std::clamp((time - path.time[k]) / (path.time[k + 1] - path.time[k]), 0.0, 1.0);
  const Stopwatch watch;
  if (path.depth.empty())
    move_tip(tool,
             (1.0 - fraction) * path.tip.col(static_cast<Index>(k)) +
                 fraction * path.tip.col(static_cast<Index>(k) + 1),
             limit, dt);
  else
    move_depth(tool, (1.0 - fraction) * path.depth[k] + fraction * path.depth[k + 1], limit, dt);
  return path_frame_of(tool, time, watch.seconds());
}

PathFrame path_frame_of(const LiveTool& tool, double time, double seconds) {
  const ToolPlace at = tool.session->tool();
  const bool in_air = !(tool.frame.depth > 0.0) && tool.frame.tool == LiveFrame::Tool::there;
  return {.time = time,
          .seconds = seconds,
          .frame = tool.frame,
          .tip = tool.tip,
          .tip_now = in_air ? tool.tip : Vec3(at.centre + tool.frame.depth * at.approach),
          .nodes = tool.session->model().node_count(),
          .half_error = half_error(tool)};
}

std::vector<PathFrame> follow_path(LiveTool& tool, const ToolPath& path, const PathOptions& options,
                                   const std::function<void(const PathFrame&)>& each) {
  std::vector<PathFrame> frames;
  tool.waits = true;
  const double duration = path.time.back() - path.time.front(), dt = 1.0 / options.rate;
  const auto count = static_cast<std::int64_t>(std::floor(duration * options.rate + 1e-9)) + 1;
  std::size_t stroke = 0;
  for (std::int64_t i = 0; i < count && stop_requested() == StopReason::none; ++i) {
    const double now = path.time.front() + static_cast<double>(i) * dt;
    for (; stroke < options.strokes.size() && options.strokes[stroke].time <= now; ++stroke)
      cut(tool, options.strokes[stroke].stroke, false);
    frames.push_back(path_frame(tool, path, now, options.limit, dt));
    if (each) each(frames.back());
  }
  if (stop_requested() == StopReason::none) end_cuts(tool, options.strokes, stroke);
  return frames;
}

void write_path_frames(const fs::path& folder, const std::vector<PathFrame>& frames) {
  Table forces{
      .header = {"time_s", "asked_mm", "depth_mm", "force_N", "error_N", "error_at_depth_N", "half_band_N",
                 "band_known", "stiffness_N_per_m", "residual", "evaluations", "tool"},
      .column = {}};
  forces.header.insert(forces.header.end(), wrench_columns.begin(), wrench_columns.end());
  for (const char* name : {"asked_x_mm", "asked_y_mm", "asked_z_mm", "tip_x_mm", "tip_y_mm", "tip_z_mm",
                           "nodes", "penetration_mm"})
    forces.header.emplace_back(name);
  forces.column.resize(forces.header.size());
  Table times{.header = {"time_s", "frame_ms"}, .column = std::vector<std::vector<double>>(2)};
  for (const PathFrame& now : frames) {
    const LiveFrame& f = now.frame;
    std::vector<double> row = {now.time,
                               1e3 * f.requested,
                               1e3 * f.depth,
                               f.force,
                               f.error,
                               f.error_at_depth,
                               now.half_error.value_or(0.0),
                               now.half_error ? 1.0 : 0.0,
                               f.stiffness,
                               f.residual,
                               static_cast<double>(f.evaluations),
                               static_cast<double>(f.tool)};
    row.insert(row.end(), f.on_tool.begin(), f.on_tool.end());
    for (const Vec3& place : {now.tip, now.tip_now})
      for (const double x : place) row.push_back(1e3 * x);
    row.push_back(static_cast<double>(now.nodes));
    row.push_back(1e3 * f.penetration);
    for (std::size_t c = 0; c < row.size(); ++c) forces.column[c].push_back(row[c]);
    times.column[0].push_back(now.time);
    times.column[1].push_back(1e3 * now.seconds);
  }
  write_csv(folder / "forces.csv", forces);
  write_csv(folder / "times.csv", times);
}

void write_cuts(const fs::path& folder, const std::vector<CutRecord>& cuts) {
  Table table{.header = {"from_x_mm", "from_y_mm", "from_z_mm", "to_x_mm", "to_y_mm", "to_z_mm", "depth_mm",
                         "cut", "area_mm2", "nodes"},
              .column = {}};
  table.column.resize(table.header.size());
  Table times{.header = {"made_ms"}, .column = std::vector<std::vector<double>>(1)};
  for (const CutRecord& one : cuts) {
    const Vec3 from = 1e3 * one.stroke.from, to = 1e3 * one.stroke.to;
    const double row[] = {from.x(),
                          from.y(),
                          from.z(),
                          to.x(),
                          to.y(),
                          to.z(),
                          1e3 * one.stroke.depth,
                          one.why.empty() ? 1.0 : 0.0,
                          1e6 * one.area,
                          static_cast<double>(one.nodes)};
    for (std::size_t c = 0; c < table.column.size(); ++c) table.column[c].push_back(row[c]);
    times.column[0].push_back(1e3 * one.seconds);
  }
  write_csv(folder / "cuts.csv", table);
  write_csv(folder / "cut_times.csv", times);
}

std::vector<TimedStroke> read_strokes(const fs::path& file) {
  const Table table = read_csv(file);
  constexpr std::array names = {"time_s",  "from_x_mm", "from_y_mm", "from_z_mm",
                                "to_x_mm", "to_y_mm",   "to_z_mm",   "depth_mm"};
  std::array<const std::vector<double>*, names.size()> column{};
  for (std::size_t c = 0; c < names.size(); ++c)
    if (column[c] = table.find(names[c]); !column[c])
      refuse_path(file, fmt::format("there is no column {}", names[c]),
                  fmt::format("the columns are named {}", fmt::join(table.header, ", ")),
                  fmt::format("give {}", fmt::join(names, ", ")));
  std::vector<TimedStroke> strokes;
  for (std::size_t k = 0; k < column[0]->size(); ++k) {
    const auto at = [&](std::size_t c) { return (*column[c])[k]; };
    const TimedStroke one{at(0),
                          {1e-3 * Vec3(at(1), at(2), at(3)), 1e-3 * Vec3(at(4), at(5), at(6)), 1e-3 * at(7)}};
    if (k > 0 && one.time < strokes.back().time)
      refuse_path(
          file,
          fmt::format("row {} is at {:g} s, the one before at {:g} s", k + 1, one.time, strokes.back().time),
          "strokes must be in the order of time", "sort the rows");
    constexpr double farthest = 1e3, deepest = 1.0;  // m
    if (one.stroke.from.cwiseAbs().maxCoeff() > farthest || one.stroke.to.cwiseAbs().maxCoeff() > farthest ||
        one.stroke.depth > deepest)
      refuse_path(file, fmt::format("the stroke in row {} is more than 1 km away, or deeper than 1 m", k + 1),
                  "places are in mm, LPS", "give millimetres");
    if (!(one.stroke.depth > 0.0) || one.stroke.from == one.stroke.to)
      refuse_path(
          file,
          fmt::format("the stroke in row {} has no {}", k + 1, one.stroke.depth > 0.0 ? "length" : "depth"),
          "a blade cuts along its displacement and to its depth",
          "give two places and a depth_mm above zero");
    strokes.push_back(one);
  }
  return strokes;
}

std::string in_words(const Stroke& stroke) {
  const Vec3 from = 1e3 * stroke.from, to = 1e3 * stroke.to;
  return fmt::format("line:{:.4g},{:.4g},{:.4g},{:.4g},{:.4g},{:.4g},depth={:.4g}mm", from.x(), from.y(),
                     from.z(), to.x(), to.y(), to.z(), 1e3 * stroke.depth);
}

std::string in_words(const CutRecord& record) {
  if (!record.why.empty()) return "not cut: " + record.why;
  return fmt::format("cut: {:.3g} mm2, after {:.0f} ms", 1e6 * record.area, 1e3 * record.seconds);
}

Index nodes_for_rate(const LiveOrgan& organ, double rate) {
  constexpr Index tried = 1000;
  constexpr double goal = 10.0;  // force evaluations in a frame
  LiveTool tool{.organ = &organ, .nodes = tried};
  tool.session.emplace(session_of(organ, tried, site_at(organ)));
  const double travel = 0.01 / rate, deepest = 0.5 * tool.session->tool().radius;
  double spent = 0.0, evaluations = 0.0;
  move_depth(tool, travel, {.evaluations = 100});
  for (double depth = 2.0 * travel; depth < deepest && spent < 0.3; depth += travel) {
    const Stopwatch watch;
    evaluations += static_cast<double>(move_depth(tool, depth, {.evaluations = 8}).evaluations);
    spent += watch.seconds();
  }
  const double each =
      spent / std::max(1.0, evaluations) / static_cast<double>(tool.session->model().node_count());
  const double nodes = 0.8 / (rate * goal * each);
  return std::clamp<Index>(100 * static_cast<Index>(nodes / 100.0), 500, 4000);
}

std::string words_of(const PathFrame& now, bool by_hand) {
  const LiveFrame& f = now.frame;
  using Tool = LiveFrame::Tool;
  const char* status = f.tool == Tool::lags        ? " (the body lags)"
                       : f.tool == Tool::stopped   ? " (no equilibrium any deeper)"
                       : f.tool == Tool::elsewhere ? " (the tool is not at the requested place)"
                       : f.tool == Tool::beyond    ? " (the requested depth exceeds the body)"
                                                   : "";
  if (!(f.depth > 0.0) && f.force == 0.0) {
    if (f.tool == Tool::elsewhere)
      return fmt::format("the force at {} is unknown: no nodes fit there", in_words(1e3 * now.tip));
    if (by_hand) return "no contact: press the left button on the body and drag inwards";
    return fmt::format("no contact: the tool is at {}{}", in_words(1e3 * now.tip), status);
  }
  const double error = f.error_at_depth + now.half_error.value_or(0.0);
  const std::string depth = length_in_words(1e3 * f.depth);
  if (!(error <= std::abs(f.force)))
    return fmt::format("force unknown, {} deep: {}{}", depth,
                       std::isfinite(error) ? "its error, " + force_written(error)(error) + ", exceeds it"
                                            : "no error estimate yet",
                       status);
  const Written written = force_written(f.force);
  return fmt::format("force {} +- {}{}, {} deep{}", written(f.force), written(error),
                     now.half_error ? "" : " plus discretisation", depth, status);
}

namespace {

// Number of frames with the force of another pose than the requested one, by reason: "5 lags, 7 elsewhere".
std::string others_in_words(const std::vector<PathFrame>& frames) {
  std::array<std::size_t, 5> count{};
  for (const PathFrame& now : frames) ++count[static_cast<std::size_t>(now.frame.tool)];
  const std::size_t others = frames.size() - count[0];
  if (others == 0) return "";
  std::vector<std::string> of;
  for (std::size_t k = 1; k < count.size(); ++k)
    if (count[k] > 0) of.push_back(fmt::format("{} {}", count[k], name_of(static_cast<LiveFrame::Tool>(k))));
  return fmt::format("; the force is not that of the requested pose in {} of {} frames: {}", others,
                     frames.size(), fmt::join(of, ", "));
}

}  // namespace

std::string in_words(Index nodes, const std::vector<PathFrame>& frames) {
  std::vector<double> seconds, error;
  std::size_t pressed = 0, unknown = 0;
  double penetration = 0.0;
  for (const PathFrame& now : frames) {
    seconds.push_back(now.seconds);
    penetration = std::max(penetration, now.frame.penetration);
    if (!(now.frame.force > 0.0)) continue;
    error.push_back((now.frame.error_at_depth + now.half_error.value_or(0.0)) / now.frame.force);
    ++pressed;
    unknown += now.half_error ? 0 : 1;
  }
  const std::string thousands =
      nodes >= 1000 ? fmt::format("{},{:03}", nodes / 1000, nodes % 1000) : fmt::format("{}", nodes);
  return fmt::format(
      "{} nodes, {:.0f} fps, force +-{}{}{}{}", thousands, 1.0 / std::max(1e-6, quantile(seconds, 0.99)),
      percent(quantile(error, 0.95)),
      unknown == 0         ? ""
      : unknown == pressed ? " plus an unknown discretisation error"
                           : " plus discretisation, unknown in some frames",
      penetration > 0.0
          ? fmt::format("; the body's surface penetrated by {} into the tool between contact points",
                        length_in_words(1e3 * penetration))
          : "",
      others_in_words(frames));
}

}  // namespace dimple
