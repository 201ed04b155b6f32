#pragma once

// One layout, two kinds of file: chart.cpp draws through a pen and does not know whether it leaves pixels or
// SVG; used by chart.cpp, by nobody else. Text is measured with the built-in font in both, and SVG text is
// told the measured width, so that another font on the reader's machine keeps the layout.

#include <filesystem>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "io/draw/canvas.hpp"

namespace dimple::draw {

/// The outline of a mark: a colour and a thickness in picture pixels.
struct Edge {
  Colour colour;
  double thickness;
};

class Pen {
 public:
  static constexpr double any_room = std::numeric_limits<double>::infinity();

  virtual ~Pen() = default;

  /// With round corners of that radius.
  virtual void rectangle(const Rect& r, const Colour& colour, double corner) = 0;
  virtual void line(const std::vector<Vec2>& points, double thickness, const Colour& colour, bool dashed) = 0;
  virtual void disc(const Vec2& centre, double radius, const Colour& fill, const Edge& edge) = 0;
  /// Convex, corners clockwise as seen.
  virtual void polygon(const std::vector<Vec2>& corners, const Colour& fill, const Edge& edge) = 0;
  /// One line of text; `at` is on its baseline. Shortened where it is wider than `room`; an SVG then carries
  /// the whole text as a tooltip.
  virtual void text(const Vec2& at, const std::string& text, const Style& style, Align align,
                    double room = any_room) = 0;
  /// Through write_file(). Throws OutputError.
  virtual void write(const std::filesystem::path& file) const = 0;
};

std::unique_ptr<Pen> raster_pen(int width, int height);
std::unique_ptr<Pen> svg_pen(int width, int height);

}  // namespace dimple::draw
