#pragma once

#include <chrono>
#include <deque>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"
#include "preprocess/supports/sheet_cut.hpp"
#include "solver/session.hpp"

namespace dimple {

/// An organ that a tool touches here and there: read once, its surface and its base kept. Where the tool
/// comes down a cloud of its own is made around that place.
struct LiveOrgan {
  Scene scene;
  Result result;                    ///< image, labels, segment, warnings
  std::optional<Organ> organ = {};  ///< surface and options
  std::vector<Material> materials = {};
  std::optional<Boundary> base = {};    ///< as the options have it; the circle is another at each touch
  std::optional<ToolShape> shape = {};  ///< of a tool that touches; none: the circle
};
/// Throws what simulate() throws of the image and the options; UsageError where they are not those of an
/// equilibrium.
LiveOrgan read_live_organ(const Scene& scene, const RunObserver& observer = {});

/// Where the tool stands on the place that options.boundary.indent_at names, or on `tip` [3] LPS m.
Site site_at(const LiveOrgan& live, const std::optional<Vec3>& tip = {});
/// Blades at rest [m, LPS] that have cut an organ, in their order.
using Sheets = std::vector<std::shared_ptr<const Sheet>>;
/// A cloud of `nodes` there, cut. `left_out`, if given: how many of the cuts it is too coarse for, and is
/// without.
Session touch(const LiveOrgan& live, Index nodes, const Site& site, const Sheets& sheets = {},
              Index* left_out = nullptr);

/// A touch that has been tried to one radius of the circle: its equilibria are known, and how far a coarser
/// cloud's forces are from them.
struct TriedTouch {
  Session session;
  std::vector<ForceSample> fine = {}, coarse = {};  ///< none: no band of the force is known
  std::size_t cuts = 0;                             ///< that have been tried in it
  Index left_out = 0;                               ///< of these
};
TriedTouch try_touch(const LiveOrgan& live, Index nodes, const Site& site, const Sheets& sheets = {});

/// A scalpel's way on the body as it then is: from place to place [m, LPS] on its surface, straight in.
struct Stroke {
  Vec3 from = Vec3::Zero(), to = Vec3::Zero();
  double depth = 0.0;  ///< of the blade [m], from the straight way between the two
};
/// A session on a body after a stroke, lifted, and what it goes on with (Session::go_on_from()).
struct CutSession {
  Session session;
  std::shared_ptr<const Sheet> sheet;  ///< at rest
  SheetCut cut;                        ///< its model has gone to the session
};
/// What it is made with beside the body. `rest`: the surface, of triangles of `step_mm`; for cuts alone.
struct SessionGiven {
  const Scene& scene;
  const std::vector<Material>& materials;
  const std::map<std::string, int>& label_names;
  const BodySurface* rest = nullptr;
  double step_mm = 0.0;
};
/// `before`: the body's model, its nodes displaced by u [3xN] m. Throws ModelError ("cut"): the blade misses
/// the body, or parts a piece off that nothing holds; there is no one way into the body along it, or none
/// back to where it was at rest (stroke_at_rest()).
CutSession cut_session(const SessionGiven& given, const Model& before, const Points& u, const Stroke& stroke);
/// A session on a model, under the options' loads and supports, with the tool that they name.
Session session_on(const SessionGiven& given, Model model);

/// Nodes of the cloud that serves until a finer one is there, and that this one's forces are compared with.
inline constexpr Index first_nodes = 400;

/// What came of a stroke.
struct CutRecord {
  Stroke stroke;
  std::chrono::steady_clock::time_point asked = std::chrono::steady_clock::now();
  double area = 0.0;     ///< of the blade in the tissue, at rest [m^2]
  Index nodes = 0;       ///< that the banks got
  double seconds = 0.0;  ///< from the stroke until frames followed the cut body [s]
  std::string why = {};  ///< it has not cut
};

/// A tool that is moved freely: the tip's pose in, the frame out. It follows one axis, from where it came
/// down. A pose beside that axis is served as TipAsked says; off the organ the force is zero. Where it comes
/// down anew a cloud of first_nodes is made, in some two tenths of a second, and beside the frames that
/// follow one of `nodes`, which takes its place.
struct LiveTool {
  const LiveOrgan* organ = nullptr;
  Index nodes = 1000;
  bool waits = false;  ///< a new place is followed with all `nodes` at once, whatever that takes
  std::optional<Session> session = {};
  Vec3 tip = Vec3::Zero();        ///< LPS m, that the last frame was asked for
  Vec3 came_down = Vec3::Zero();  ///< LPS m, the tip for which it came down
  LiveFrame frame = {};
  std::vector<ForceSample> fine = {}, coarse = {};     ///< of this touch, see TriedTouch
  std::optional<Vec3> no_place = {};                   ///< where it could not come down last [m]
  Index touches = 0;                                   ///< places that it has come down at
  Index clouds = 0;                                    ///< that have been in use
  double made_s = 0.0;                                 ///< until the last touch could be followed [s]
  std::future<TriedTouch> finer = {};                  ///< in the making
  std::vector<std::future<TriedTouch>> given_up = {};  ///< of places that it has left again
  Site finer_site = {};
  Index left_out = 0;                  ///< of `sheets`, that this cloud is too coarse for
  Index most_left_out = 0;             ///< of all clouds so far
  Sheets sheets = {};                  ///< of all strokes that have cut
  std::deque<CutRecord> strokes = {};  ///< of which the first is in the making
  std::future<CutSession> cutting = {};
  std::vector<CutRecord> cuts = {};                ///< of each stroke, whether it has cut or not
  std::shared_ptr<const BodySurface> opened = {};  ///< the body's surface with the banks of cuts; null: none
  std::size_t opened_cuts = 0;                     ///< that were tried in it
  std::future<std::shared_ptr<const BodySurface>> opening = {};
};
/// Begins at the place that the options name, in touch.
LiveTool make_live_tool(const LiveOrgan& organ, Index nodes);
/// It comes down somewhere else, at `tip` [3] LPS m, under no load. `beside`: a coarse cloud serves until the
/// other is made; else it is waited for, and nothing depends on a clock.
void put_down(LiveTool& tool, const Vec3& tip, bool beside);
/// The body is cut where it now is. `beside`: beside the frames that follow, and one of them goes on with the
/// cut body, about a tenth of a second later; else at once, and nothing depends on a clock. What is wrong
/// with it is in its record, the last of tool.cuts. No band is known of the force on a cut cloud.
void cut(LiveTool& tool, const Stroke& stroke, bool beside);
/// What was made beside the frames is taken up; move_tip() and move_depth() do so too.
void take_cuts(LiveTool& tool);

/// Strokes over time: `time_s`, `from_x_mm` ..., `to_x_mm` ... and `depth_mm`, LPS.
struct TimedStroke {
  double time;  ///< [s]
  Stroke stroke;
};
/// Throws InputError: no such columns, times that fall, no depth or length, not in mm.
std::vector<TimedStroke> read_strokes(const std::filesystem::path& file);
/// The way has ended: what waits is made, and strokes from `next` on are recorded as not made.
void end_cuts(LiveTool& tool, const std::vector<TimedStroke>& strokes, std::size_t next);
/// "line:x,y,z,x,y,z,depth=12mm", as --cut has it.
std::string in_words(const Stroke& stroke);
/// What came of it, in a line.
std::string in_words(const CutRecord& record);
/// Half the band of the last frame's force [N]: how far it may be from that of an ever finer cloud. Nothing
/// where no band is known (see Band).
std::optional<double> half_band(const LiveTool& tool);
/// How far a tip [3] LPS m is along the push from the middle of the circle, and off its axis [m].
struct OnAxis {
  double depth, aside;
};
OnAxis on_axis(const ToolPlace& tool, const Vec3& tip);
/// What a tool does that is asked to a tip.
struct TipAsked {
  enum class Way {
    axis,    ///< it follows its axis, on which the tip lies to 0.02 radii
    beside,  ///< likewise; the tip is within a quarter radius, and the force known to force_apart()
    /// It follows its axis, and nothing is known of the force at the tip: a bonded circle is not moved
    /// across.
    elsewhere,
    anew,  ///< it comes down there: it was in the air, or touches without friction, which has no past
    air    ///< nothing touches it there
  };
  Way way;
  OnAxis at;
};
/// `depth` [m]: of the tool now. Asked by any thread.
TipAsked tip_asked(const LiveOrgan& organ, const ToolPlace& tool, double depth, const Vec3& tip);
/// A frame on the axis tells so of a tip that lies `aside` [m] of it: LiveFrame::error, and `elsewhere`.
void tell_aside(LiveFrame& frame, const TipAsked& asked, double radius);
/// Of a place where no cloud of nodes fits: no force is shown, and nothing is known of it.
LiveFrame unknown_frame();
/// "there", "lags", "stopped", "elsewhere", "beyond".
const char* name_of(LiveFrame::Tool tool);
/// The tip goes to a place [3] LPS m, or as far as the body can be followed within the limit. Where it would
/// come down and no cloud of nodes fits, it stays in the air: unknown_frame().
LiveFrame move_tip(LiveTool& tool, const Vec3& tip, const FrameLimit& limit, double dt = 0.0);
/// The same along the push, from where the tool stands.
LiveFrame move_depth(LiveTool& tool, double depth, const FrameLimit& limit, double dt = 0.0);

/// A tool's way over time: `time_s`, and `depth_mm` along the push or `x_mm, y_mm, z_mm` of its tip.
struct ToolPath {
  std::vector<double> time;   ///< [n] s, rising
  std::vector<double> depth;  ///< [n] m, or none
  Points tip;                 ///< [3xn] LPS m, or none
};
/// Throws InputError: no such columns, times that do not rise, fewer than two rows, longer than an hour.
ToolPath read_tool_path(const std::filesystem::path& file);

struct PathFrame {
  double time = 0.0, seconds = 0.0;  ///< on the path [s]; and how long the frame took [s]
  LiveFrame frame = {};
  Vec3 tip = Vec3::Zero();     ///< asked for [3] LPS m
  Vec3 stands = Vec3::Zero();  ///< where it is [3] LPS m
  Index nodes = 0;             ///< of the cloud that the force is of
  std::optional<double> half_band = {};
};
/// Of the tool's last frame.
PathFrame path_frame_of(const LiveTool& tool, double time, double seconds);
/// The frame of a path at one time on it; where the path begins before or ends after that, at its end. `dt`
/// [s]: since the last one.
PathFrame path_frame(LiveTool& tool, const ToolPath& path, double time, const FrameLimit& limit, double dt);
struct PathOptions {
  double rate = 25.0;  ///< frames in a second of the path
  FrameLimit limit = {};
  std::vector<TimedStroke> strokes = {};
};
/// Follows the path frame by frame, each within the limit, as fast as it goes. Stopped (io/stop.hpp) it
/// returns what there is.
std::vector<PathFrame> follow_path(LiveTool& tool, const ToolPath& path, const PathOptions& options,
                                   const std::function<void(const PathFrame&)>& each = {});
/// forces.csv: time_s, asked_mm, depth_mm, force_N, error_N, error_at_depth_N, half_band_N, band_known,
/// stiffness_N_per_m, residual, evaluations, tool, the vector of the force on the tool and its moment,
/// asked_x_mm ..., tip_x_mm ... (LPS), nodes and penetration_mm; and what differs from one time to the next,
/// times.csv: time_s, frame_ms.
void write_path_frames(const std::filesystem::path& folder, const std::vector<PathFrame>& frames);
/// cuts.csv: the places of each stroke, area_mm2, nodes, and 1 in `cut` if it has cut; and what differs from
/// one time to the next, cut_times.csv: made_ms.
void write_cuts(const std::filesystem::path& folder, const std::vector<CutRecord>& cuts);

/// As many nodes as can be followed at `rate` frames a second on this machine, tried with the cloud of 1000
/// at a way of 10 mm/s. In hundreds, 500 to 4000.
Index nodes_for_rate(const LiveOrgan& organ, double rate);

/// What a window says of a frame: force, error, depth and status, or where in the air the tool is. `by_hand`:
/// it is moved by the mouse.
std::string words_of(const PathFrame& now, bool by_hand);

/// "2,600 nodes, 31 fps, force +-3 %": the rate that 99 % of the frames kept, and the error with the band of
/// the discretisation, that 95 % of the frames state at most.
std::string in_words(Index nodes, const std::vector<PathFrame>& frames);

}  // namespace dimple
