#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// What a window shows, at rest. Positions in LPS mm.
struct ShownBody {
  Points surface_mm;
  Triangles triangles;
  Points tool_mm;
  Triangles tool_triangles;
  Vec3 up, front, centre_mm;  ///< against the push, toward the viewer, of the circle
};

struct ShownFrame {
  Points surface_mm;
  Eigen::VectorXd displacement_mm;  ///< [vertices of the surface]
  Vec3 tool_mm = Vec3::Zero();      ///< the tool's way from rest
  std::string words;
};

/// A point of the curve beside the body: force over time, and what its error leaves possible.
struct ShownForce {
  double time_s = 0.0, force_N = 0.0, low_N = 0.0, high_N = 0.0;
};

/// A window with a body under its tool and the force beside it. The body turns by the right mouse button or,
/// where the left one has no other meaning, by that; the wheel draws it nearer. Throws UsageError: there is
/// no display.
class BodyWindow {
 public:
  BodyWindow();
  ~BodyWindow();
  BodyWindow(const BodyWindow&) = delete;
  BodyWindow& operator=(const BodyWindow&) = delete;

  /// Another body, or the same under a tool elsewhere; `look`: the camera goes to where it sees all of it.
  void show(const ShownBody& body, double most_mm, bool look);
  void show(const ShownFrame& frame);
  void show(const std::vector<ShownForce>& curve);
  void draw();
  void save_picture(const std::filesystem::path& png);

  /// The left button went down on the body, there [LPS mm]: true, and the mouse belongs to the tool until it
  /// goes up.
  std::function<bool(const Vec3& place_mm)> pressed = {};
  /// It has been moved since, by this much along the push on the screen [mm]; then it went up, if that was on
  /// the body there [LPS mm].
  std::function<void(double along_mm)> dragged = {};
  std::function<void(const Vec3& place_mm)> let_go = {};
  std::function<void()> released = {};
  /// A key by its X name ("space", "t"); true: something has changed, and is drawn.
  std::function<bool(const std::string& key)> key = {};
  /// Some hundred times a second; false ends the window.
  std::function<bool()> tick = {};

  /// Until the window is closed, by q or its frame, or `tick` ends it.
  void run();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace dimple
