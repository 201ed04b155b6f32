#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>

#include "apps/run/live.hpp"

namespace dimple {

/// Statistics of a server of forces.
struct Served {
  std::int64_t answers = 0, refused = 0;  ///< poses answered; lines that are no pose
  std::int64_t turned_away = 0;           ///< programs refused while another moved the tool
  std::int64_t frames = 0;                ///< equilibria, or the best states within the limit
  double slowest_s = 0.0;                 ///< from a line's arrival to its answer
};

/// Server of forces for poses of a tool, on a unix domain socket of its owner. One program at a time moves
/// the tool; another is refused with a message. When the first has left, the tool keeps its pose, and the
/// next may connect. apps/guide/how-to/live.md describes the lines of text.
///
/// A thread answers from the last frames (BetweenFrames) without waiting, so that a loop of 200 Hz or more
/// can be closed over it. The owner of the tool computes the frames: move() at a steady rate, from one
/// thread.
class ForceServer {
 public:
  /// Throws OutputError: the socket cannot be made, or a file that is no socket is at `path`.
  ForceServer(const LiveTool& tool, const std::filesystem::path& path);
  ~ForceServer();
  ForceServer(const ForceServer&) = delete;
  ForceServer& operator=(const ForceServer&) = delete;

  /// Moves the tool to the last requested pose, and updates the answers by the frame.
  PathFrame move(LiveTool& tool, const FrameLimit& limit, double dt);
  Served served() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// Computes up to `rate` frames a second for a server until the work is to end (io/stop.hpp) or `seconds`
/// have passed; `each` receives every one.
Served serve_forces(LiveTool& tool, const std::filesystem::path& path, double rate, double seconds,
                    const std::function<void(const PathFrame&)>& each = {});

}  // namespace dimple
