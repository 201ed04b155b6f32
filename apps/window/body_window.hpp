#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// What a window shows, at rest. Positions in LPS mm.
struct ShownBody {
  Points surface_mm;
  Triangles triangles;
  Points section_mm = {};  ///< the body cut open; none: it is not cut
  Triangles section_triangles = {};
  std::vector<int> section_label = {};  ///< [triangles of the section], or none
  std::map<int, std::string> label_name = {};
  Points tool_mm;
  Triangles tool_triangles;
  Vec3 up, front, centre_mm;  ///< against the push, toward the viewer, of the circle
};

struct ShownFrame {
  Points surface_mm;
  Eigen::VectorXd displacement_mm;  ///< [vertices of the surface]
  Points section_mm = {};
  Eigen::VectorXd section_displacement_mm = {};
  Vec3 tool_mm = Vec3::Zero();  ///< the tool's way from rest
  Points tool_vertex_mm = {};   ///< where its vertices are, in place of that way
  std::string words;
};

/// A point of the curve beside the body: force over depth or time, and what its band leaves possible.
struct ShownForce {
  double x = 0.0, force_N = 0.0, low_N = 0.0, high_N = 0.0;
};

struct WindowOptions {
  std::string title = "Dimple";
  int width = 1280, height = 760;
  std::string abscissa = "indentation [mm]";
  bool hidden = false;  ///< drawn off screen, for pictures; a display is needed all the same
};

/// A window with a body under its tool and the force beside it. The body turns by the right mouse button or,
/// where the left one has no other meaning, by that; the wheel draws it nearer. Throws UsageError: there is
/// no display.
class BodyWindow {
 public:
  explicit BodyWindow(const WindowOptions& options);
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
  /// A key by its X name ("space", "Right", "c"); true: something has changed, and is drawn.
  std::function<bool(const std::string& key)> key = {};
  /// Some hundred times a second; false ends the window.
  std::function<bool()> tick = {};
  /// A slider along the lower edge, for 0 to `last`.
  void add_slider(const std::string& title, int last, std::function<void(int)> moved);
  void move_slider(int to);

  /// With a legend: each label's name on its colour.
  void colour_by_label(bool labels);
  /// The plane that cuts the surface goes to so many mm before the section; only what lies behind it is
  /// shown.
  void cut(bool on, double before_mm = 0.0);

  /// Until the window is closed, by q or its frame, or `tick` ends it.
  void run();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace dimple
