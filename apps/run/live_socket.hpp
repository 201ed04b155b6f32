#pragma once

#include <filesystem>
#include <functional>

#include "apps/run/live.hpp"

namespace dimple {

/// What a server of forces has done until it ended.
struct Served {
  std::int64_t answers = 0, refused = 0;  ///< poses that were answered, and lines that are none
  std::int64_t frames = 0;                ///< equilibria, or the best states within their limit
  double slowest_s = 0.0;                 ///< from a line's arrival to its answer
};

/// Answers poses of a tool with forces, on a unix domain socket at `path`, until the work is asked to end (io/stop.hpp) or
/// `seconds` have passed. One program at a time; the next may connect when it has gone. Lines of text:
///
///     asked:     x_mm y_mm z_mm                      the tip, LPS; or one number, the depth along the push [mm]
///     answered:  fx_N fy_N fz_N depth_mm error_N     the force on the tool, LPS, and how far the body has followed
///
/// A line that is neither is answered by "error" and a reason. Frames are found by a thread of their own at up to `rate` a
/// second; an answer takes the last one's force and stiffness (BetweenFrames) and waits for nothing, so that a loop of 200
/// Hz or more can be closed over it. `each` hears of every frame, in that thread. Throws OutputError: the socket cannot
/// be made, or something that is no socket stands at `path`; and what a frame threw.
Served serve_forces(LiveTool& tool, const std::filesystem::path& path, double rate, double seconds,
                    const std::function<void(const PathFrame&)>& each = {});

}  // namespace dimple
