#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Body and tool of a window, at rest. Positions in LPS mm.
struct ShownBody {
  Points surface_mm;
  Triangles triangles;
  Points tool_mm;
  Triangles tool_triangles;
  Vec3 up, front, centre_mm;  ///< against the approach direction, toward the viewer, of the contact
};

struct ShownFrame {
  Points surface_mm;
  Eigen::VectorXd displacement_mm;  ///< [vertices of the surface]
  Vec3 tool_mm = Vec3::Zero();      ///< displacement of the tool from rest
  std::string words;
};

/// Point of the force curve over time, with its error bounds.
struct ShownForce {
  double time_s = 0.0, force_N = 0.0, low_N = 0.0, high_N = 0.0;
};

/// Window with a body under its tool and the force next to it. The right mouse button rotates the body, and
/// so does the left one if it has no other use; the wheel zooms. Throws UsageError: there is no display.
class BodyWindow {
 public:
  BodyWindow();
  ~BodyWindow();
  BodyWindow(const BodyWindow&) = delete;
  BodyWindow& operator=(const BodyWindow&) = delete;

  /// Shows another body or tool position; `look`: the camera moves to show all of it.
  void show(const ShownBody& body, double most_mm, bool look);
  void show(const ShownFrame& frame);
  void show(const std::vector<ShownForce>& curve);
  void draw();
  void save_picture(const std::filesystem::path& png);

  /// Left button pressed on the body, at [LPS mm]. True: the mouse moves the tool until the button is
  /// released.
  std::function<bool(const Vec3& place_mm)> pressed = {};
  /// Mouse motion since then along the approach direction [mm]; `on_release`: button released on the body, at
  /// [LPS mm].
  std::function<void(double along_mm)> dragged = {};
  std::function<void(const Vec3& place_mm)> on_release = {};
  std::function<void()> released = {};
  /// Key by its X name ("space", "t"); true: the picture has changed and is redrawn.
  std::function<bool(const std::string& key)> key = {};
  /// Called about a hundred times a second; false closes the window.
  std::function<bool()> tick = {};

  /// Runs until the window is closed, by q or its frame, or by `tick`.
  void run();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace dimple
