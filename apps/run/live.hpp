#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"
#include "solver/session.hpp"

namespace dimple {

/// An organ that a tool touches here and there: read once, its surface kept. Where the tool comes down a cloud of its own
/// is made around that place.
struct LiveOrgan {
  Config config;
  Result result;                    ///< image, labels, segment, warnings
  std::optional<Organ> organ = {};  ///< surface and options
  std::vector<Material> materials = {};
};
/// Throws what simulate() throws of the image and the options; UsageError where they are not those of an equilibrium.
LiveOrgan read_live_organ(const Config& config, const RunObserver& observer = {});

/// A cloud of `nodes` around the place that options.boundary.indent_at names, or around `tip` [3] LPS m.
Session touch(const LiveOrgan& live, Index nodes, const std::optional<Vec3>& tip = {});

/// A tool that is moved freely: the tip's pose in, the frame out. Between two touches it is in the air, and the force is
/// zero; where it comes down more than a quarter of its radius away from the last touch a new cloud is made, which takes
/// some tenths of a second. While it touches it keeps to its axis: ways across the push take effect at the next touch.
struct LiveTool {
  const LiveOrgan* organ = nullptr;
  Index nodes = 1000;
  std::optional<Session> session = {};
  Vec3 tip = Vec3::Zero();  ///< LPS m, of the last frame
  LiveFrame frame = {};
  Index touches = 0;    ///< clouds made
  double made_s = 0.0;  ///< how long the last one took, in seconds
};
/// Begins at the place that the options name, in touch.
LiveTool make_live_tool(const LiveOrgan& organ, Index nodes);
/// It comes down somewhere else, at `tip` [3] LPS m: a new cloud, under no load.
void put_down(LiveTool& tool, const Vec3& tip);
/// Along the push from the middle of the circle [m].
double depth_of(const LiveTool& tool, const Vec3& tip);
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
};
/// The frame of a path at one time on it; where the path begins before or ends after that, at its end. `dt` [s]: since
/// the last one.
PathFrame path_frame(LiveTool& tool, const ToolPath& path, double time, const FrameLimit& limit, double dt);
struct PathOptions {
  double rate = 25.0;  ///< frames in a second of the path
  FrameLimit limit = {};
};
/// Follows the path frame by frame, each within the limit, as fast as it goes. Stopped (io/stop.hpp) it returns what there
/// is.
std::vector<PathFrame> follow_path(LiveTool& tool, const ToolPath& path, const PathOptions& options,
                                   const std::function<void(const PathFrame&)>& each = {});
/// forces.csv: time_s, asked_mm, depth_mm, force_N, error_N, stiffness_N_per_m, residual, evaluations, tool; and what differs
/// from one time to the next, times.csv: time_s, frame_ms.
void write_path_frames(const std::filesystem::path& folder, const std::vector<PathFrame>& frames);

/// As many nodes as can be followed at `rate` frames a second on this machine, tried with the cloud of 1000 at a way of 10
/// mm/s. In hundreds, 500 to 4000.
Index nodes_for_rate(const LiveOrgan& organ, double rate);

/// "2,600 nodes, 31 fps, force +-3 %": the rate that 99 % of the frames kept, and the largest error stated in 95 %.
std::string in_words(Index nodes, const std::vector<PathFrame>& frames);

}  // namespace dimple
