#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "apps/commands/all_commands.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/run/live.hpp"
#include "apps/run/live_socket.hpp"
#include "apps/run/results.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/view.hpp"
#include "apps/scene/option_word.hpp"
#include "apps/scene/resolve.hpp"
#include "apps/window/body_window.hpp"
#include "apps/window/display.hpp"
#include "io/digits.hpp"
#include "io/draw/body_frame.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/vtk_files.hpp"
#include "preprocess/output/reduce_surface.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

struct PokeArguments {
  Flags flags;
  std::string script, strokes, record, socket;
  double rate = 25.0, seconds = 3600.0;
  std::int64_t evaluations = 0;
  bool window = false;
  std::optional<ToolPath> path = {};   // of the script
  std::vector<TimedStroke> cuts = {};  // of the strokes
  std::optional<double> blade = {};    // depth of a hand-held scalpel [m]
};

constexpr double for_solving = 0.7;       // of a frame's time; the rest is for drawing
constexpr Index most_triangles = 12'000;  // in the picture
constexpr double recorded_rate = 5.0;     // surfaces a second

// Surface under the tool, reduced so that it is drawn within a few milliseconds.
struct Skin {
  ReducedSurface part;
  Points undeformed_mm;
  Interpolation moved;

  // `opened`: surface with the faces of cuts; null: there are none, or they are not drawn yet.
  Skin(const Model& model, const BodySurface* opened) {
    const Surface surface =
        opened ? Surface{opened->to_world() * opened->vertex().colwise().homogeneous(), opened->triangles()}
               : model.surface;
    part = reduced_surface(surface, model.tool, most_triangles);
    undeformed_mm = surface.vertex_mm(Eigen::all, part.vertex);
    moved = inner_interpolation(model, 1e-3 * undeformed_mm);
  }
  // Cuts made since then append nodes, which are not read here.
  Points displacement_mm(const Session& session) const { return 1e3 * moved(session.nodal_parameters()); }
};

// State of the tool's nodes and cuts; the picture is rebuilt when it changes.
struct Drawn {
  Index node_sets = 0;
  std::size_t opened_cuts = 0;
  explicit Drawn(const LiveTool& tool) : node_sets(tool.node_sets), opened_cuts(tool.opened_cuts) {}
  bool operator==(const Drawn&) const = default;
};

// Frames of the tool's path: forces.csv, surface.pvd, and the time of each.
class Recording {
 public:
  explicit Recording(const fs::path& folder) : folder_(folder), surfaces_(folder / "surface.pvd", ".vtp") {}

  /// Adds a frame. True: a surface was written and `picture()` is due.
  bool add(const PathFrame& now, const Session& session, const Skin& skin) {
    frames_.push_back(now);
    if (now.time < next_) return false;
    next_ = now.time + 1.0 / recorded_rate;
    const Points u = skin.displacement_mm(session);
    write_vtp(
        surfaces_.next_frame(),
        {.position_mm = skin.undeformed_mm + u,
         .triangles = skin.part.triangles,
         .fields = {{.name = "displacement_mm", .unit = "mm", .values = u, .components = {"X", "Y", "Z"}}}},
        now.time);
    surfaces_.add(now.time);
    return true;
  }
  fs::path picture() {
    const fs::path folder = folder_ / "window";
    make_folder(folder);
    return folder / fmt::format("window_{:04d}.png", pictures_++);
  }
  void finish(const LiveTool& tool) const {
    if (!frames_.empty()) write_path_frames(folder_, frames_);
    if (!tool.cuts.empty()) write_cuts(folder_, tool.cuts);
  }

 private:
  fs::path folder_;
  TimeSeries surfaces_;
  std::vector<PathFrame> frames_;
  double next_ = 0.0;
  int pictures_ = 0;
};

// The recording is completed even if Ctrl-C arrives within a frame.
template <class Work>
void finish_after(std::optional<Recording>& recording, const LiveTool& tool, Work work) {
  try {
    work();
  } catch (const Stopped&) {
    if (recording) recording->finish(tool);
    throw;
  }
  if (recording) recording->finish(tool);
}

class Poking {
 public:
  Poking(LiveTool& tool, const PokeArguments& options) : tool_(tool), options_(options) {
    if (!options.record.empty()) recording_.emplace(options.record);
    path_ = options.path;
    tool_.waits = path_.has_value();
    if (!options.socket.empty()) server_.emplace(tool, options.socket);
    begin_stop(true);
  }

  std::vector<PathFrame> run() {
    window_.pressed = [this](const Vec3& place_mm) { return pressed(place_mm); };
    window_.dragged = [this](double along_mm) {
      if (!from_mm_) requested_ = 1e-3 * std::max(0.0, along_mm);
    };
    window_.on_release = [this](const Vec3& place_mm) { to_mm_ = place_mm; };
    window_.released = [this] { released(); };
    window_.key = [this](const std::string& key) {
      if (key != "t" || !options_.blade) return false;
      cuts_ = !cuts_;
      return true;
    };
    window_.tick = [this] { return tick(); };
    finish_after(recording_, tool_, [this] {
      window_.run();
      if (stop_requested() == StopReason::none) end_cuts(tool_, options_.cuts, stroke_);
    });
    return frames_;
  }
  /// Statistics of the socket; nothing if there is none.
  std::optional<Served> served() const { return server_ ? std::optional(server_->served()) : std::nullopt; }

 private:
  bool by_hand() const { return !path_ && !server_; }

  bool pressed(const Vec3& place_mm) {
    notice_.clear();
    from_mm_.reset(), to_mm_.reset();
    if (cuts_) {
      from_mm_ = place_mm;
      return true;
    }
    if (!by_hand()) return false;
    const ToolPlace at = tool_.session->tool();
    if ((1e-3 * place_mm - at.centre).norm() > 0.25 * at.radius) try {
        begin_contact(tool_, 1e-3 * place_mm, options_.evaluations == 0);
        begin_stop(false);
      } catch (const ModelError& error) {
        notice_ = error.report.fact;
      }
    return true;
  }

  // The tool rises when the mouse is released. With a scalpel it stays, so that one can cut next to it.
  void released() {
    if (!from_mm_) {
      if (!options_.blade) requested_ = 0.0;
      return;
    }
    if (!to_mm_ || *to_mm_ == *from_mm_)
      notice_ = "not cut: a stroke needs two places on the body";
    else
      cut(tool_, {1e-3 * *from_mm_, 1e-3 * *to_mm_, *options_.blade}, options_.evaluations == 0);
    from_mm_.reset();
  }

  void begin_stop(bool look) {
    const Model& model = tool_.session->model();
    skin_.emplace(model, tool_.opened.get());
    drawn_ = Drawn(tool_);
    const ToolPlace at = tool_.session->tool();
    const BodyFrame frame = body_frame(model.X, at.centre, at.approach);
    const SurfaceFile tool =
        tool_.session->indenter() ? tool_body(*tool_.session->indenter()) : tool_body(model);
    window_.show({.surface_mm = skin_->undeformed_mm,
                  .triangles = skin_->part.triangles,
                  .tool_mm = tool.position_mm,
                  .tool_triangles = tool.triangles,
                  .up = frame.up,
                  .front = frame.front,
                  .centre_mm = 1e3 * at.centre},
                 1e3 * at.radius, look);
    requested_ = 0.0;
  }

  bool tick() {
    if (stop_requested() != StopReason::none) return false;
    const double period = 1.0 / options_.rate, now = clock_.seconds();
    if (now < next_) return true;
    next_ = std::max(next_ + period, now);
    const double time = path_ ? static_cast<double>(frames_.size()) * period : now;
    if (time > options_.seconds) return false;
    const Index contact_count = tool_.contact_count;
    const FrameLimit limit{.seconds = for_solving * period, .evaluations = options_.evaluations};
    const Stopwatch solving;
    PathFrame frame{.time = time};
    if (path_) {
      const double at = path_->time.front() + time;
      if (at > path_->time.back() + 1e-9) return false;
      for (; stroke_ < options_.cuts.size() && options_.cuts[stroke_].time <= at; ++stroke_)
        cut(tool_, options_.cuts[stroke_].stroke, options_.evaluations == 0);
      frame = path_frame(tool_, *path_, at, limit, period);
      frame.time = time;
    } else if (server_) {
      frame = server_->move(tool_, limit, period);
      frame.time = time;
    } else {
      // The tool is released: relaxing tissue would hold one that stays at the height of first contact.
      constexpr double above = -1e-3;
      const bool is_held = requested_ > 0.0 || !relaxes(tool_.organ->materials);
      move_depth(tool_, is_held ? requested_ : above, limit, period);
      frame = path_frame_of(tool_, time, solving.seconds());
    }
    solve_s_ = frame.seconds;
    const double depth = requested_;
    if (!(drawn_ == Drawn(tool_))) begin_stop(false);
    if (tool_.contact_count == contact_count) requested_ = depth;
    if (tool_.cuts.size() > reported_) notice_ = in_words(tool_.cuts.back());
    reported_ = tool_.cuts.size();
    frames_.push_back(frame);
    const Stopwatch drawing;
    draw(frame);
    draw_s_ = drawing.seconds();
    if (recording_ && recording_->add(frame, *tool_.session, *skin_))
      window_.save_picture(recording_->picture());
    busy_ += 0.1 * (std::max(period, solve_s_ + draw_s_) - busy_);
    return true;
  }

  std::string instrument() const {
    const std::string coarse =
        tool_.left_out > 0 ? fmt::format("; {} of {} cuts are finer than these nodes, and not in the force",
                                         tool_.left_out, tool_.sheets.size())
                           : "";
    if (!options_.blade) return coarse;
    return coarse + (cuts_ ? "; a stroke of the left button cuts (t: it presses)"
                           : "; the left button presses (t: it cuts)");
  }

  void draw(const PathFrame& now) {
    const LiveFrame& f = now.frame;
    const Points u = skin_->displacement_mm(*tool_.session);
    const double error = f.error_at_depth + now.half_error.value_or(0.0);
    curve_.push_back({now.time, f.force, f.force - error, f.force + error});
    constexpr double shown_s = 10.0;
    curve_.erase(curve_.begin(), std::find_if(curve_.begin(), curve_.end(), [&](const ShownForce& s) {
                   return s.time_s > now.time - shown_s;
                 }));
    window_.show(ShownFrame{
        .surface_mm = skin_->undeformed_mm + u,
        .displacement_mm = u.colwise().norm(),
        .tool_mm = 1e3 * f.depth * tool_.session->tool().approach,
        .words = fmt::format("{}\n{} nodes, {:.0f} frames a second: solving {:.0f} ms, drawing {:.0f} ms{}",
                             words_of(now, by_hand() && !cuts_) + instrument(),
                             tool_.session->model().node_count(), 1.0 / busy_, 1e3 * solve_s_, 1e3 * draw_s_,
                             notice_.empty() ? "" : "\n" + notice_)});
    window_.show(curve_);
    window_.draw();
  }

  LiveTool& tool_;
  const PokeArguments& options_;
  BodyWindow window_;
  std::optional<Skin> skin_;
  Drawn drawn_{tool_};
  std::optional<Recording> recording_;
  std::optional<ToolPath> path_;
  std::optional<ForceServer> server_;
  double requested_ = 0.0;                         // depth [m]
  bool cuts_ = options_.blade.has_value();         // the mouse moves the scalpel, not the tool
  std::optional<Vec3> from_mm_ = {}, to_mm_ = {};  // of the current stroke
  std::size_t reported_ = 0;                       // strokes
  std::size_t stroke_ = 0;                         // next stroke of the options
  Stopwatch clock_;
  std::vector<PathFrame> frames_;
  std::vector<ShownForce> curve_;
  std::string notice_;
  double next_ = 0.0, solve_s_ = 0.0, draw_s_ = 0.0, busy_ = 0.04;
};

// Without a window: follows the script at full speed, or the device.
std::vector<PathFrame> follow_unseen(LiveTool& tool, const PokeArguments& options,
                                     std::optional<Served>& served) {
  std::optional<Recording> recording;
  if (!options.record.empty()) recording.emplace(options.record);
  std::optional<Skin> skin;
  Drawn drawn(tool);
  const auto record = [&](const PathFrame& now) {
    if (!recording) return;
    if (!skin || !(drawn == Drawn(tool)))
      skin.emplace(tool.session->model(), tool.opened.get()), drawn = Drawn(tool);
    recording->add(now, *tool.session, *skin);
  };
  std::vector<PathFrame> frames;
  finish_after(recording, tool, [&] {
    if (options.path)
      frames = follow_path(tool, *options.path,
                           {.rate = options.rate,
                            .limit = {.seconds = 1.0 / options.rate, .evaluations = options.evaluations},
                            .strokes = options.cuts},
                           record);
    else
      served = serve_forces(tool, options.socket, options.rate, options.seconds, record);
  });
  return frames;
}

void check(const PokeArguments& options) {
  const auto refuse = [](const char* fact, const char* where, const char* why, const char* remedy) {
    throw UsageError({.fact = fact, .where = where, .why = why, .remedy = remedy});
  };
  if (!(options.rate >= 1.0 && options.rate <= 1000.0))
    refuse("the rate is not between 1 and 1000 frames a second", "--fps", "a frame lasts 1 ms to 1 s",
           "give one, such as 25");
  if (!options.socket.empty() && !options.script.empty())
    refuse("the tool is moved by a script and through a socket", "--script, --socket",
           "only one of them can move it", "give one of them");
  if (!options.strokes.empty() && options.script.empty())
    refuse("strokes have times, and the tool has none", "--strokes", "the times refer to a script",
           "give --script, or cut by hand with --tool scalpel:12mm");
  if (options.socket.size() > 107)
    refuse("the path of the socket is too long", "--socket", "the system allows 107 characters at most",
           "give a shorter one, in /tmp for instance");
}

// Depth of the hand-held scalpel of "--tool scalpel:12mm"; the pressing tool remains the bonded patch.
std::optional<double> take_scalpel(Flags& flags) {
  const WordTable words{"the tool", {{"scalpel", {length_number("depth", 1e-3, 1000.0)}, "scalpel:12mm"}}};
  for (auto& [key, text] : flags.given)
    if (key == "tool.shape" && text->starts_with("scalpel")) {
      const OptionWord scalpel = parse_word(words, *text, "--tool scalpel:12mm");
      *text = ToolWords().shape;
      return scalpel.number.front();
    }
  return {};
}

int poke(const Invocation& shared, const CLI::App& command, PokeArguments& options) {
  check(options);
  if (!options.script.empty()) options.path = read_tool_path(options.script);
  if (!options.strokes.empty()) options.cuts = read_strokes(options.strokes);
  options.blade = take_scalpel(options.flags);
  const Description described = options.flags.described(command, shared.image);
  const bool windowed = options.window || (options.script.empty() && options.socket.empty());
  if (windowed) require_display();
  if (options.blade && !windowed)
    throw UsageError({.fact = "a scalpel is requested, and there is no window",
                      .where = "--tool scalpel",
                      .why = "the mouse moves a scalpel in a window",
                      .remedy = "add --window, or give --strokes"});
  std::optional<ResultFolder> folder;  // until the end: it lists the files and locks the folder
  if (!options.record.empty()) folder.emplace(options.record, shared.existing()).prepare();
  const Scene scene = resolve(described);
  const LiveOrgan organ = read_live_organ(scene, {.line = to_log().line});
  // The default number of nodes depends on the speed of this machine; with a limit in evaluations nothing may
  // depend on it.
  const bool requested = command.count("--nodes") > 0 || scene.node_set.nodes != Scene::NodeSet().nodes ||
                         options.evaluations > 0;
  const Index nodes =
      requested ? scene.node_set.nodes : nodes_for_rate(organ, options.rate / (windowed ? for_solving : 1.0));
  LiveTool tool = make_live_tool(organ, nodes);
  say(fmt::format("tool     {} nodes, made in {:.2f} s", tool.session->model().node_count(), tool.made_s));
  if (!options.socket.empty())
    say(fmt::format(
        "socket   {}: a line `x_mm y_mm z_mm` or `depth_mm` is answered by fx_N fy_N fz_N depth_mm error_N "
        "mx_Nm my_Nm mz_Nm status",
        options.socket));
  std::vector<PathFrame> frames;
  std::optional<Served> served;
  if (windowed) {
    Poking poking(tool, options);
    frames = poking.run();
    served = poking.served();
  } else {
    frames = follow_unseen(tool, options, served);
  }
  if (served)
    print(fmt::format("{} answers, the slowest after {:.2f} ms; {} frames; {} programs refused\n",
                      served->answers, 1e3 * served->slowest_s, served->frames, served->turned_away));
  else if (!frames.empty())
    print(in_words(tool.session->model().node_count(), frames) + "\n");
  for (const CutRecord& record : tool.cuts) print(in_words(record) + "\n");
  if (tool.most_left_out > 0)
    print(
        fmt::format("{} of {} cuts were finer than the nodes at another place, and not in the force there\n",
                    tool.most_left_out, tool.sheets.size()));
  stop_if_requested();
  return 0;
}

}  // namespace

Command add_poke(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<PokeArguments>();
  CLI::App* command = add_to(app, whole::poke);
  command->add_option("IMAGE", shared.image, "label image");
  command
      ->add_option("--script", options->script,
                   "CSV with time_s, and depth_mm or the tip's x_mm, y_mm, z_mm (LPS): moves the tool")
      ->type_name("FILE");
  command
      ->add_option("--strokes", options->strokes,
                   "CSV with time_s, from_x_mm ..., to_x_mm ..., depth_mm (LPS): a scalpel cuts the body "
                   "while --script moves the tool; by hand: --tool scalpel:10mm")
      ->type_name("FILE");
  command
      ->add_option("--record", options->record,
                   "folder for forces.csv, times.csv and, five times a second, the surface and the window")
      ->type_name("FOLDER");
  command
      ->add_option("--socket", options->socket,
                   "answer a device's poses with forces on this unix domain socket")
      ->type_name("PATH");
  command->add_flag("--window", options->window, "a window also where a script or a device moves the tool");
  command->add_option("--fps", options->rate, "frames a second")->capture_default_str();
  command
      ->add_option("--evaluations", options->evaluations,
                   "force evaluations per frame, instead of a time: the same forces on every machine")
      ->check(CLI::Range(1, 1000));
  command->add_option("--seconds", options->seconds, "end after this long")->capture_default_str();
  command->add_flag("--force", shared.force,
                    "replace the records of an earlier one in the folder of --record");
  options->flags.add(*command, "live");
  add_common(*command, shared);
  return {command, [&shared, command, options] { return poke(shared, *command, *options); }};
}

}  // namespace dimple
