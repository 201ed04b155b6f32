#pragma once

#include <filesystem>
#include <functional>
#include <future>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"
#include "solver/session.hpp"

namespace dimple {

/// An organ that a tool touches here and there: read once, its surface and its base kept. Where the tool
/// comes down a cloud of its own is made around that place.
struct LiveOrgan {
  Config config;
  Result result;                    ///< image, labels, segment, warnings
  std::optional<Organ> organ = {};  ///< surface and options
  std::vector<Material> materials = {};
  std::optional<Boundary> base = {};  ///< as the options have it; the circle is another at each touch
};
/// Throws what simulate() throws of the image and the options; UsageError where they are not those of an
/// equilibrium.
LiveOrgan read_live_organ(const Config& config, const RunObserver& observer = {});

/// Where the tool stands on the place that options.boundary.indent_at names, or on `tip` [3] LPS m.
Site site_at(const LiveOrgan& live, const std::optional<Vec3>& tip = {});
/// A cloud of `nodes` there.
Session touch(const LiveOrgan& live, Index nodes, const Site& site);

/// A touch that has been tried to one radius of the circle: its equilibria are known, and how far a coarser
/// cloud's forces are from them.
struct TriedTouch {
  Session session;
  std::vector<ForceSample> fine = {}, coarse = {};  ///< none: no band of the force is known
};
TriedTouch try_touch(const LiveOrgan& live, Index nodes, const Site& site);

/// Nodes of the cloud that serves until a finer one is there, and that this one's forces are compared with.
inline constexpr Index first_nodes = 400;

/// A tool that is moved freely: the tip's pose in, the frame out. Between two touches it is in the air, and
/// the force is zero; where it comes down more than a quarter of its radius away from the last touch a cloud
/// of first_nodes is made, in some two tenths of a second, and beside the frames that follow one of `nodes`,
/// which takes its place. While it touches it keeps to its axis (LiveFrame::Tool::ignored): ways across the
/// push take effect at the next touch.
struct LiveTool {
  const LiveOrgan* organ = nullptr;
  Index nodes = 1000;
  std::optional<Session> session = {};
  Vec3 tip = Vec3::Zero();  ///< LPS m, of the last frame
  LiveFrame frame = {};
  std::vector<ForceSample> fine = {}, coarse = {};     ///< of this touch, see TriedTouch
  Index touches = 0;                                   ///< places that it has come down at
  Index clouds = 0;                                    ///< that have been in use
  double made_s = 0.0;                                 ///< until the last touch could be followed [s]
  std::future<TriedTouch> finer = {};                  ///< in the making
  std::vector<std::future<TriedTouch>> given_up = {};  ///< of places that it has left again
};
/// Begins at the place that the options name, in touch.
LiveTool make_live_tool(const LiveOrgan& organ, Index nodes);
/// It comes down somewhere else, at `tip` [3] LPS m, under no load. `beside`: a coarse cloud serves until the
/// other is made; else it is waited for, and nothing depends on a clock.
void put_down(LiveTool& tool, const Vec3& tip, bool beside);
/// Half the band of the last frame's force [N]: how far it may be from that of an ever finer cloud. Nothing
/// where no band is known (see Band).
std::optional<double> half_band(const LiveTool& tool);
/// How far a tip [3] LPS m is along the push from the middle of the circle, and off its axis [m].
struct OnAxis {
  double depth, aside;
};
OnAxis on_axis(const ToolPlace& tool, const Vec3& tip);
/// Farther off the axis than a touch counts as the same.
bool is_aside(const ToolPlace& tool, const OnAxis& at);
/// Inside the body at rest; asked by any thread.
bool is_inside(const LiveOrgan& organ, const Vec3& tip);
/// "there", "lags", "stopped", "ignored", "beyond".
const char* name_of(LiveFrame::Tool tool);
/// The tip goes to a place [3] LPS m, or as far as the body can be followed within the limit.
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
  Vec3 tip = Vec3::Zero();  ///< asked for [3] LPS m
  std::optional<double> half_band = {};
};
/// The frame of a path at one time on it; where the path begins before or ends after that, at its end. `dt`
/// [s]: since the last one.
PathFrame path_frame(LiveTool& tool, const ToolPath& path, double time, const FrameLimit& limit, double dt);
struct PathOptions {
  double rate = 25.0;  ///< frames in a second of the path
  FrameLimit limit = {};
};
/// Follows the path frame by frame, each within the limit, as fast as it goes. Stopped (io/stop.hpp) it
/// returns what there is.
std::vector<PathFrame> follow_path(LiveTool& tool, const ToolPath& path, const PathOptions& options,
                                   const std::function<void(const PathFrame&)>& each = {});
/// forces.csv: time_s, asked_mm, depth_mm, force_N, error_N, half_band_N, band_known, stiffness_N_per_m,
/// residual, evaluations, tool, and the vector of the force on the tool and its moment; and what differs from
/// one time to the next, times.csv: time_s, frame_ms.
void write_path_frames(const std::filesystem::path& folder, const std::vector<PathFrame>& frames);

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
