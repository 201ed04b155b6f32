#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>

#include "apps/run/live.hpp"

namespace dimple {

/// What a server of forces has done until now.
struct Served {
  std::int64_t answers = 0, refused = 0;  ///< poses that were answered, and lines that are none
  std::int64_t turned_away = 0;           ///< programs that came while another moved the tool
  std::int64_t frames = 0;                ///< equilibria, or the best states within their limit
  double slowest_s = 0.0;                 ///< from a line's arrival to its answer
};

/// Answers poses of a tool with forces, on a unix domain socket that its owner alone may use. One program at
/// a time moves the tool; another is told so and sent away. When one has gone the tool stays where it is, and
/// the next may come. The lines of text are described in apps/guide/how-to/live.md.
///
/// A thread of its own answers, from the last frames (BetweenFrames), and waits for nothing, so that a loop
/// of 200 Hz or more can be closed over it. Frames are found by whoever owns the tool: move() at a steady
/// rate, from one thread.
class ForceServer {
 public:
  /// Throws OutputError: the socket cannot be made, or something that is no socket stands at `path`.
  ForceServer(const LiveTool& tool, const std::filesystem::path& path);
  ~ForceServer();
  ForceServer(const ForceServer&) = delete;
  ForceServer& operator=(const ForceServer&) = delete;

  /// The tool goes to where it was asked to be last, and the answers are told of the frame.
  PathFrame move(LiveTool& tool, const FrameLimit& limit, double dt);
  Served served() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// Frames for a server at up to `rate` a second until the work is asked to end (io/stop.hpp) or `seconds`
/// have passed; `each` hears of every one.
Served serve_forces(LiveTool& tool, const std::filesystem::path& path, double rate, double seconds,
                    const std::function<void(const PathFrame&)>& each = {});

}  // namespace dimple
