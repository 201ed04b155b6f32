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

/// Organ of a live tool, read once: its surface and its base are kept. Nodes are made for each new contact.
struct LiveOrgan {
  Scene scene;
  Result result;                    ///< image, labels, segment, warnings
  std::optional<Organ> organ = {};  ///< surface and options
  std::vector<Material> materials = {};
  std::optional<Boundary> base = {};    ///< as the options have it; the patch differs for each contact
  std::optional<ToolShape> shape = {};  ///< of a contacting tool; none: the bonded patch
};
/// Throws the errors of simulate() on the image and the options; UsageError if they are not for equilibrium.
LiveOrgan read_live_organ(const Scene& scene, const RunObserver& observer = {});

/// Site of the tool at the place that options.boundary.indent_at names, or at `tip` [3] LPS m.
Site site_at(const LiveOrgan& live, const std::optional<Vec3>& tip = {});
/// Blades at rest [m, LPS] that have cut an organ, in their order.
using Sheets = std::vector<std::shared_ptr<const Sheet>>;
/// Session on `nodes` nodes at this site, with cuts. `left_out`, if given: number of cuts that these nodes
/// are too coarse for and omit.
Session session_of(const LiveOrgan& live, Index nodes, const Site& site, const Sheets& sheets = {},
                   Index* left_out = nullptr);

/// Session whose equilibria were computed to one radius, with forces of coarser nodes to compare.
struct TriedContact {
  Session session;
  std::vector<ForceSample> fine = {}, coarse = {};  ///< none: there are no error bounds
  std::size_t cuts = 0;                             ///< made in this session
  Index left_out = 0;                               ///< number of cuts omitted
};
TriedContact try_contact(const LiveOrgan& live, Index nodes, const Site& site, const Sheets& sheets = {});

/// Path of a scalpel on the deformed body: from place to place [m, LPS] on its surface, straight in.
struct Stroke {
  Vec3 from = Vec3::Zero(), to = Vec3::Zero();
  double depth = 0.0;  ///< of the blade [m], from the straight line between the two
};
/// Session on a body after a stroke, lifted, and its data for Session::continue_from().
struct CutSession {
  Session session;
  std::shared_ptr<const Sheet> sheet;  ///< at rest
  SheetCut cut;                        ///< its model has gone to the session
};
/// Parts of a session other than the body. `undeformed`: the surface, of triangles of `step_mm`; for cuts
/// alone.
struct SessionGiven {
  const Scene& scene;
  const std::vector<Material>& materials;
  const std::map<std::string, int>& label_names;
  const BodySurface* undeformed = nullptr;
  double step_mm = 0.0;
};
/// Cuts the model `before`, its nodes displaced by u [3xN] m. Throws ModelError ("cut"): the blade misses the
/// body or separates an unsupported piece. The error is the same without a single direction into the body or
/// without a map to rest (reference_stroke()).
CutSession cut_session(const SessionGiven& given, const Model& before, const Points& u, const Stroke& stroke);
/// Session on a model, under the loads and supports of the options, with their tool.
Session session_on(const SessionGiven& given, Model model);

/// Number of nodes until a finer discretisation is ready, and the least for a comparison with that.
inline constexpr Index first_nodes = 400;

/// Result of a stroke.
struct CutRecord {
  Stroke stroke;
  std::chrono::steady_clock::time_point requested = std::chrono::steady_clock::now();
  double area = 0.0;     ///< of the blade in the tissue, at rest [m^2]
  Index nodes = 0;       ///< number of nodes that the faces of the cut added
  double seconds = 0.0;  ///< from the stroke until frames used the cut body [s]
  std::string why = {};  ///< no cut was made
};

/// Freely moved tool: pose of the tip in, frame out. It follows one axis through its first contact;
/// TipRequest states the response off that axis, and off the organ the force is zero. At a new contact
/// first_nodes nodes are made within about 0.2 s. A discretisation of `nodes` nodes is made in the background
/// and replaces them.
struct LiveTool {
  const LiveOrgan* organ = nullptr;
  Index nodes = 1000;
  bool waits = false;  ///< a new contact uses all `nodes` at once, whatever time that takes
  std::optional<Session> session = {};
  Vec3 tip = Vec3::Zero();        ///< LPS m, requested for the last frame
  Vec3 came_down = Vec3::Zero();  ///< LPS m, where contact began
  LiveFrame frame = {};
  std::vector<ForceSample> fine = {}, coarse = {};       ///< of this contact, see TriedContact
  std::optional<Vec3> no_place = {};                     ///< last place where no nodes could be made [m]
  Index contact_count = 0;                               ///< number of contacts
  Index node_sets = 0;                                   ///< number of discretisations used
  double made_s = 0.0;                                   ///< until the last contact could be followed [s]
  std::future<TriedContact> finer = {};                  ///< in the making
  std::vector<std::future<TriedContact>> given_up = {};  ///< for contacts left since
  Site finer_site = {};
  Index left_out = 0;                  ///< of `sheets`, omitted by these nodes
  Index most_left_out = 0;             ///< with any nodes so far
  Sheets sheets = {};                  ///< of all strokes that have cut
  std::deque<CutRecord> strokes = {};  ///< the first is in the making
  std::future<CutSession> cutting = {};
  std::vector<CutRecord> cuts = {};                ///< of all strokes, cut or not
  std::shared_ptr<const BodySurface> opened = {};  ///< surface with the faces of cuts; null: none
  std::size_t opened_cuts = 0;                     ///< number of cuts in it
  std::future<std::shared_ptr<const BodySurface>> opening = {};
};
/// Tool at the place of the options, in contact.
LiveTool make_live_tool(const LiveOrgan& organ, Index nodes);
/// Moves the tool to another contact at `tip` [3] LPS m, without load. `next_to`: coarse nodes are used until
/// the finer ones are ready; otherwise it waits for these, and no result depends on a clock.
void begin_contact(LiveTool& tool, const Vec3& tip, bool in_parallel);
/// Cuts the body in its present state. `next_to`: in the background; a frame about 0.1 s later uses the cut
/// body. Otherwise at once, and no result depends on a clock. The last record of tool.cuts has its error, if
/// any. There are no error bounds on a cut body.
void cut(LiveTool& tool, const Stroke& stroke, bool in_parallel);
/// Uses what was made in the background since; move_tip() and move_depth() do so too.
void take_cuts(LiveTool& tool);

/// Strokes over time: `time_s`, `from_x_mm` ..., `to_x_mm` ... and `depth_mm`, LPS.
struct TimedStroke {
  double time;  ///< [s]
  Stroke stroke;
};
/// Throws InputError: no such columns, times that fall, no depth or length, not in mm.
std::vector<TimedStroke> read_strokes(const std::filesystem::path& file);
/// Ends a path: makes the waiting strokes, and records those from `next` on as not made.
void end_cuts(LiveTool& tool, const std::vector<TimedStroke>& strokes, std::size_t next);
/// "line:x,y,z,x,y,z,depth=12mm", as --cut has it.
std::string in_words(const Stroke& stroke);
/// Result of the stroke, in a line.
std::string in_words(const CutRecord& record);
/// Half-width of the last frame's error bounds by the discretisation [N]. Nothing if there are none
/// (`ErrorBounds`).
std::optional<double> half_error(const LiveTool& tool);
/// Position of a tip [3] LPS m relative to a tool's axis: along it from its centre, and off it [m].
struct OnAxis {
  double depth, aside;
};
OnAxis on_axis(const ToolPlace& tool, const Vec3& tip);
/// Response of the tool to a requested tip.
struct TipRequest {
  enum class Kind {
    axis,     ///< it follows its axis; the tip is within 0.02 radii of it
    next_to,  ///< likewise; the tip is within a quarter radius, and force_apart() bounds the error
    /// It follows its axis, and the force at the tip is unknown: a bonded patch does not move sideways.
    elsewhere,
    new_place,  ///< contact starts there: it was in the air, or has contact without friction and so no
                ///< history
    air         ///< there is no contact
  };
  Kind kind;
  OnAxis at;
};
/// `depth` [m]: present depth of the tool. Thread-safe.
TipRequest tip_request(const LiveOrgan& organ, const ToolPlace& tool, double depth, const Vec3& tip);
/// Sets the error, and `elsewhere`, of a frame on the axis for a tip `aside` [m] of it.
void report_lateral(LiveFrame& frame, const TipRequest& requested, double radius);
/// Frame for a place where no nodes can be made: no force, and an infinite error.
LiveFrame unknown_frame();
/// "there", "lags", "stopped", "elsewhere", "beyond".
const char* name_of(LiveFrame::Tool tool);
/// Moves the tip to a place [3] LPS m, or as far as the body follows within the limit. If no nodes can be
/// made at a new contact, the tool stays in the air: unknown_frame().
LiveFrame move_tip(LiveTool& tool, const Vec3& tip, const FrameLimit& limit, double dt = 0.0);
/// Moves the tool along its press direction, from its present place.
LiveFrame move_depth(LiveTool& tool, double depth, const FrameLimit& limit, double dt = 0.0);

/// Path of a tool: `time_s`, and `depth_mm` in press direction or `x_mm, y_mm, z_mm` of its tip.
struct ToolPath {
  std::vector<double> time;   ///< [n] s, rising
  std::vector<double> depth;  ///< [n] m, or none
  Points tip;                 ///< [3xn] LPS m, or none
};
/// Throws InputError: no such columns, times that do not rise, fewer than two rows, longer than an hour.
ToolPath read_tool_path(const std::filesystem::path& file);

struct PathFrame {
  double time = 0.0, seconds = 0.0;  ///< on the path [s]; duration of the frame [s]
  LiveFrame frame = {};
  Vec3 tip = Vec3::Zero();      ///< requested [3] LPS m
  Vec3 tip_now = Vec3::Zero();  ///< actual tip [3] LPS m
  Index nodes = 0;              ///< of the discretisation in use
  std::optional<double> half_error = {};
};
/// Path frame of the tool's last frame.
PathFrame path_frame_of(const LiveTool& tool, double time, double seconds);
/// Frame at one time of a path; outside of the path's time, at its end. `dt` [s]: since the last frame.
PathFrame path_frame(LiveTool& tool, const ToolPath& path, double time, const FrameLimit& limit, double dt);
struct PathOptions {
  double rate = 25.0;  ///< frames in a second of the path
  FrameLimit limit = {};
  std::vector<TimedStroke> strokes = {};
};
/// Follows the path frame by frame without delay, each within the limit. If stopped (io/stop.hpp), it returns
/// the frames so far.
std::vector<PathFrame> follow_path(LiveTool& tool, const ToolPath& path, const PathOptions& options,
                                   const std::function<void(const PathFrame&)>& each = {});
/// Writes forces.csv: time_s, asked_mm, depth_mm, force_N, error_N, error_at_depth_N, half_band_N,
/// band_known, stiffness_N_per_m, residual, evaluations, tool, the vector of the force on the tool and its
/// moment, asked_x_mm ..., tip_x_mm ... (LPS), nodes and penetration_mm. Data that vary between runs are in
/// times.csv: time_s, frame_ms.
void write_path_frames(const std::filesystem::path& folder, const std::vector<PathFrame>& frames);
/// Writes cuts.csv: places of each stroke, area_mm2, nodes, and `cut`, 1 if it has cut. Data that vary
/// between runs are in cut_times.csv: made_ms.
void write_cuts(const std::filesystem::path& folder, const std::vector<CutRecord>& cuts);

/// Largest number of nodes that this machine follows at `rate` frames a second, from a trial with 1000 nodes
/// at 10 mm/s. In hundreds, 500 to 4000.
Index nodes_for_rate(const LiveOrgan& organ, double rate);

/// Text of a window for a frame: force, error, depth and status, or the place of the tool in the air.
/// `by_hand`: it is moved by the mouse.
std::string words_of(const PathFrame& now, bool by_hand);

/// "2,600 nodes, 31 fps, force +-3 %": the rate that 99 % of the frames kept. The error, with that of the
/// discretisation, is the largest that 95 % of the frames state.
std::string in_words(Index nodes, const std::vector<PathFrame>& frames);

}  // namespace dimple
