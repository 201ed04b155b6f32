#pragma once

// Shapes and text for the pictures that io draws, as pixels or as SVG: each picture is drawn by one code.
// Used by the files of this folder only.
//
// No library draws these. VTK's renderer aborts the process where there is no display. Cairo's SVG has no
// searchable or accessible text, differs between runs, and depends on the fonts of the machine. VTK sets the
// text with its built-in font and encodes the PNG; neither needs a display.

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace dimple::draw {

using Vec2 = Eigen::Vector2d;
using Pieces = std::vector<std::array<Vec2, 2>>;  ///< straight lines from one place to another

/// Components in 0..1. Not an Eigen type: pixels are blended millions of times, in debug builds too.
struct Colour {
  float red, green, blue;
};

inline Colour operator*(const Colour& c, float f) {
  return {c.red * f, c.green * f, c.blue * f};
}
inline Colour mixed(const Colour& a, const Colour& b, float t) {
  return {a.red + (b.red - a.red) * t, a.green + (b.green - a.green) * t, a.blue + (b.blue - a.blue) * t};
}

constexpr Colour rgb(unsigned hex) {
  const auto part = [&](unsigned shift) { return static_cast<float>(hex >> shift & 255U) / 255.0F; };
  return {part(16), part(8), part(0)};
}

inline constexpr Colour ink = rgb(0x1F2933), soft_ink = rgb(0x5F6B7A), hairline = rgb(0xD8DEE6),
                        page = rgb(0xEEF1F5), card = rgb(0xFFFFFF), fact_ink = rgb(0x3A4654),
                        warning_ink = rgb(0x8A4B00), warning_fill = rgb(0xFFF3DC), wall_ink = rgb(0x6B4FA0);

/// Text of a colour: "#1f2933".
std::string in_hex(const Colour& c);

/// Pixels are drawn this much larger, then averaged, for smooth edges.
constexpr int fine = 2;

/// A rectangle in picture pixels, y downward.
struct Rect {
  double x, y, w, h;
  Rect inset(double left, double top, double right, double bottom) const {
    return {x + left, y + top, std::max(w - left - right, 1.0), std::max(h - top - bottom, 1.0)};
  }
};

/// The pixel of a coordinate, within 0..most for every number, including those that are not a number.
inline int pixel_within(double coordinate, int most) {
  return coordinate > 0.0 ? static_cast<int>(std::min(coordinate, static_cast<double>(most))) : 0;
}

struct Style {
  double size = 15.0;  ///< approximate height of a line of text in picture pixels
  Colour colour = ink;
  bool bold = false;
};

inline constexpr Style small{.size = 14.0}, soft{.size = 14.0, .colour = soft_ink};

enum class Align { left, centre, right };
enum class Format { png, svg };

/// A picture. Coordinates are picture pixels, y downward.
class Canvas {
 public:
  Canvas(int width, int height, Format format = Format::png);

  int width() const { return columns_ / fine; }
  int height() const { return rows_ / fine; }

  /// Filled rectangle, with round corners of that radius.
  void rectangle(const Rect& r, const Colour& colour, double corner = 0.0);
  void disc(const Vec2& centre, double radius, const Colour& colour);
  void line(const Vec2& a, const Vec2& b, double thickness, const Colour& colour) {
    curve({a, b}, thickness, colour);
  }
  void curve(const std::vector<Vec2>& points, double thickness, const Colour& colour, bool dashed = false);
  void polygon(const std::vector<Vec2>& corners, const Colour& colour);

  static constexpr double any_room = std::numeric_limits<double>::infinity();
  /// One line of text; `at` is on its baseline. Text wider than `room` is shortened; an SVG then has the
  /// whole text as a tooltip. An SVG stores the width of every text, so that another font keeps the layout.
  void text(const Vec2& at, const std::string& text, const Style& style = {}, Align align = Align::left,
            double room = any_room);

  // ---------------------------------------------------------------------------------------- pixels alone

  /// Confines lines, discs, polygons and areas to a rectangle until the next call; without one: the picture.
  void clip(const Rect& r);
  void clip() { clip({0.0, 0.0, static_cast<double>(width()), static_cast<double>(height())}); }
  /// Fills the area that closed outlines enclose an odd number of times; their pieces may be in any order.
  void area(const Pieces& outline, const Colour& colour);
  /// A pixel of the enlarged picture.
  void blend(int x, int y, const Colour& colour, double cover) {
    if (!(cover > 0.0) || x < 0 || y < 0 || x >= columns_ || y >= rows_) return;
    const auto t = static_cast<float>(std::min(cover, 1.0));
    const auto part = [t](unsigned char from, float to) {
      const auto before = static_cast<float>(from);
      return static_cast<unsigned char>(before + (255.0F * to - before) * t + 0.5F);
    };
    Pixel& at = pixel_[index(x, y)];
    at = {part(at.red, colour.red), part(at.green, colour.green), part(at.blue, colour.blue)};
  }

  /// The bytes of the finished file. Throws OutputError: there is no memory for them.
  std::string bytes() const;

 private:
  // A quarter of a Colour's memory, which took more time than drawing for eight million pixels.
  struct Pixel {
    unsigned char red, green, blue;
  };
  static Pixel pixel_of(const Colour& c) {
    const auto part = [](float f) { return static_cast<unsigned char>(255.0F * std::min(f, 1.0F) + 0.5F); };
    return {part(c.red), part(c.green), part(c.blue)};
  }
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(x) + static_cast<std::size_t>(columns_) * static_cast<std::size_t>(y);
  }

  /// Paints where `distance` (picture pixels) is negative; `bounds` limits the search.
  template <class Distance>
  void paint(const Rect& bounds, const Colour& colour, Distance distance);
  void segment(const Vec2& a, const Vec2& b, double thickness, const Colour& colour);
  void set_pixels_of(const std::string& shown, const Vec2& at, const Style& style, Align align);
  /// The finished picture: averages of fine x fine blocks, three bytes a pixel, bottom row first for VTK.
  void average(unsigned char* to) const;

  int columns_, rows_;
  std::array<int, 4> shown_;  ///< first and last column, first and last row inside the clip
  bool is_svg_;
  std::vector<Pixel> pixel_;  ///< empty for an SVG
  std::string svg_;           ///< without its end
};

/// Width in picture pixels.
double text_width(const std::string& text, const Style& style);

/// Breaks a line between words so that no part is wider than `room`. A single longer word is cut.
std::vector<std::string> wrapped(const std::string& line, double room, const Style& style);

/// The text, shortened at its end until it fits.
std::string shortened(const std::string& text, double room, const Style& style);

/// 1, 2 or 5 times a power of ten, the largest that does not exceed `value` (> 0).
double round_below(double value);

/// Text of a tick with the decimals that a step of that size needs.
std::string tick_text(double value, double step);

}  // namespace dimple::draw
