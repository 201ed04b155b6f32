#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/commands/command.hpp"
#include "apps/run/words.hpp"
#include "apps/window/body_window.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"
#include "io/vtk_files.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

struct ViewArguments {
  std::string folder, picture;
  std::optional<int> frame;
  bool labels = false;
};

[[noreturn]] void refuse(const fs::path& where, const std::string& fact, const std::string& why) {
  throw InputError({.fact = fact,
                    .where = where.string(),
                    .why = why,
                    .remedy = "name the folder of a run; --write surface or all makes what a window shows",
                    .code = "no-view"});
}

const Field& needed(const std::vector<Field>& fields, const std::string& name, const fs::path& file) {
  const auto found =
      std::find_if(fields.begin(), fields.end(), [&](const Field& f) { return f.name == name; });
  if (found == fields.end())
    refuse(file, fmt::format("{} has no {}", file.filename().string(), name),
           "it was not written by a run, or by an older version");
  return *found;
}

// The frames of a run's results: read when they are looked at.
class Results {
 public:
  explicit Results(fs::path folder) : folder_(std::move(folder)) {
    std::error_code ignored;
    while (fs::exists(file("surface", count_), ignored)) ++count_;
    if (count_ == 0) {
      const bool is_folder = fs::is_directory(folder_, ignored);
      refuse(folder_, fmt::format("{} {}", folder_.string(), is_folder ? "holds no surface" : "is no folder"),
             is_folder                      ? "there is no surface/surface_0000.vtp in it"
             : fs::exists(folder_, ignored) ? "it is a file"
                                            : "nothing has that name");
    }
    const Table force = read_csv(folder_ / "force.csv");
    const auto *time = force.find("time_s"), *depth = force.find("indentation_mm"),
               *newtons = force.find("force_N"), *low = force.find("low_N"), *high = force.find("high_N");
    if (!time || !depth || !newtons)
      refuse(folder_ / "force.csv", "it has no time_s, indentation_mm and force_N",
             "it is no force curve of a run");
    time_ = *time;
    for (std::size_t k = 0; k < depth->size(); ++k)
      curve_.push_back(
          {(*depth)[k], (*newtons)[k], low ? (*low)[k] : (*newtons)[k], high ? (*high)[k] : (*newtons)[k]});
    goes_straight_ = !force.find("aside_x_mm") && std::is_sorted(depth->begin(), depth->end());
  }

  int last() const { return count_ - 1; }

  // At rest, with the triangles of a frame: a cut between two steps gives it others.
  ShownBody body(int number) const {
    const Read& now = read(number);
    ShownBody body{.surface_mm = now.surface.position_mm - now.moved,
                   .triangles = now.surface.triangles,
                   .section_mm = now.section.position_mm - now.section_moved,
                   .section_triangles = now.section.triangles,
                   .tool_mm = now.tool.position_mm,
                   .tool_triangles = now.tool.triangles,
                   .up = -needed(now.tool.facts, "push", file("tool", 0)).values.col(0),
                   .front = needed(now.tool.facts, "front", file("tool", 0)).values.col(0),
                   .centre_mm = needed(now.tool.facts, "centre_mm", file("tool", 0)).values.col(0)};
    for (const Field& field : now.section.on_triangles)
      if (field.name == "label")
        for (Index t = 0; t < field.values.cols(); ++t)
          body.section_label.push_back(static_cast<int>(field.values(0, t)));
    body.label_name = label_names();
    return body;
  }

  // The longest way in all frames: the last one's where the tool only goes in.
  double most_mm() const {
    double most = 0.0;
    for (int number = goes_straight_ ? last() : 0; number <= last(); ++number) {
      stop_if_asked();
      most = std::max(most, read(number).moved.colwise().norm().maxCoeff());
    }
    return most;
  }

  bool has_triangles_of(int number, const ShownBody& body) const {
    const Read& now = read(number);
    return now.surface.triangles.cols() == body.triangles.cols() && now.surface.triangles == body.triangles &&
           now.section.triangles.cols() == body.section_triangles.cols() &&
           now.section.triangles == body.section_triangles;
  }

  ShownFrame frame(int number) const {
    const Read& now = read(number);
    const double depth = depth_of(now);
    ShownFrame frame{.surface_mm = now.surface.position_mm,
                     .displacement_mm = now.moved.colwise().norm(),
                     .section_mm = now.section.position_mm,
                     .section_displacement_mm = now.section_moved.colwise().norm(),
                     .tool_vertex_mm = now.tool.position_mm,
                     .words = {}};
    const double force = needed(now.tool.facts, "force_N", file("tool", number)).values(0, 0);
    const std::size_t until = rows_until(number);
    std::optional<double> half_N;
    if (until > 0 && std::abs(curve_[until - 1].x - depth) < 1e-6)
      if (const ShownForce& at = curve_[until - 1]; at.high_N > at.low_N)
        half_N = 0.5 * (at.high_N - at.low_N);
    frame.words = fmt::format("frame {} of {}: {}", number, last(), force_title(force, depth, half_N));
    return frame;
  }

  // Of the curve, what has been by then.
  std::vector<ShownForce> curve_to(int number) const {
    return {curve_.begin(), curve_.begin() + static_cast<std::ptrdiff_t>(rows_until(number))};
  }

 private:
  struct Read {
    SurfaceFile surface, section, tool;
    Points moved, section_moved;
  };

  // As the run's summary tells them; none: it does not.
  std::map<int, std::string> label_names() const {
    std::map<int, std::string> names;
    std::error_code ignored;
    if (!fs::is_regular_file(folder_ / "summary.json", ignored)) return names;
    const auto summary = nlohmann::json::parse(read_file(folder_ / "summary.json"), nullptr, false);
    if (!summary.is_object() || !summary.contains("labels") || !summary["labels"].is_array()) return names;
    for (const auto& label : summary["labels"])
      if (label.is_object() && label.contains("value") && label["value"].is_number_integer() &&
          label.contains("name") && label["name"].is_string())
        names[label["value"].get<int>()] = label["name"].get<std::string>();
    return names;
  }

  fs::path file(const std::string& series, int number) const {
    return folder_ / series / fmt::format("{}_{:04d}.vtp", series, number);
  }

  // Rows of force.csv up to a frame's time.
  std::size_t rows_until(int number) const {
    const double now = needed(read(number).tool.facts, "TimeValue", file("tool", number)).values(0, 0);
    return static_cast<std::size_t>(std::upper_bound(time_.begin(), time_.end(), now * (1.0 + 1e-9) + 1e-12) -
                                    time_.begin());
  }

  double depth_of(const Read& now) const {
    return needed(now.tool.facts, "indentation_mm", file("tool", 0)).values(0, 0);
  }

  const Read& read(int number) const {
    if (read_ && number_ == number) return *read_;
    Read now{.surface = read_vtp(file("surface", number)),
             .section = read_vtp(file("section", number)),
             .tool = read_vtp(file("tool", number)),
             .moved = {},
             .section_moved = {}};
    now.moved = needed(now.surface.fields, "displacement_mm", file("surface", number)).values;
    now.section_moved = needed(now.section.fields, "displacement_mm", file("section", number)).values;
    read_ = std::move(now), number_ = number;
    return *read_;
  }

  fs::path folder_;
  int count_ = 0;
  std::vector<double> time_;  // of the curve [s]
  std::vector<ShownForce> curve_;
  bool goes_straight_ = true;
  mutable std::optional<Read> read_;
  mutable int number_ = -1;
};

void view(const ViewArguments& options) {
  if (!options.picture.empty()) try_file(options.picture);
  const Results results(options.folder);
  int now = options.frame.value_or(results.last());
  if (now < 0 || now > results.last())
    throw UsageError({.fact = fmt::format("there is no frame {}", now),
                      .where = "--frame",
                      .why = fmt::format("{} holds frames 0 to {}", options.folder, results.last()),
                      .remedy = "name one of them, or leave --frame out for the last"});
  BodyWindow window({.title = "Dimple: " + options.folder, .hidden = !options.picture.empty()});
  ShownBody body = results.body(0);
  bool labels = options.labels, cut = body.section_mm.cols() > 0, playing = false;
  double before = 0.0;
  const double most_mm = results.most_mm();
  const double step =
      0.02 * (body.surface_mm.rowwise().maxCoeff() - body.surface_mm.rowwise().minCoeff()).norm();
  const auto go_to = [&](int number) {
    now = std::clamp(number, 0, results.last());
    if (!results.has_triangles_of(now, body)) window.show(body = results.body(now), most_mm, false);
    window.show(results.frame(now));
    window.show(results.curve_to(now));
    window.move_slider(now);
  };
  window.show(body, most_mm, true);
  window.colour_by_label(labels);
  window.cut(cut);
  go_to(now);
  if (!options.picture.empty()) {
    window.save_picture(options.picture);
    return;
  }
  window.add_slider("frame      space: play   c: cut open   up, down: move the cut   l: labels   q: close",
                    results.last(), [&](int number) {
                      if (number != now) go_to(number), window.draw();
                    });
  window.key = [&](const std::string& key) {
    if (key == "Right" || key == "Left") {
      go_to(now + (key == "Right" ? 1 : -1));
    } else if (key == "space") {
      playing = !playing;
      if (playing && now == results.last()) go_to(0);
    } else if (key == "c") {
      window.cut(cut = !cut, before = 0.0);
    } else if (key == "Up" || key == "Down") {
      window.cut(cut = true, before += key == "Up" ? step : -step);
    } else if (key == "l") {
      window.colour_by_label(labels = !labels);
    } else {
      return false;
    }
    return true;
  };
  int ticks = 0;
  window.tick = [&] {
    constexpr int ticks_of_a_frame = 12;
    if (playing && ++ticks % ticks_of_a_frame == 0) {
      go_to(now + 1);
      playing = now < results.last();
      window.draw();
    }
    return stop_asked() == StopReason::none;
  };
  window.run();
  stop_if_asked();
}

}  // namespace

Command add_view(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<ViewArguments>();
  CLI::App* command = app.add_subcommand("view", "a window on a run's results: time, section, labels, force");
  command->add_option("OUT", options->folder, "folder of a run's results")->required();
  command->add_option("--picture", options->picture, "write what the window shows to this PNG, and end")
      ->type_name("FILE");
  command->add_option("--frame", options->frame, "begin with this one, from 0 [the last]");
  command->add_flag("--labels", options->labels, "colour the section by its labels");
  add_time_limit(*command, shared);
  return {command, [options] {
            view(*options);
            return 0;
          }};
}

}  // namespace dimple
