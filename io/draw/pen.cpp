#include "io/draw/pen.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <string_view>

#include "io/file.hpp"

namespace dimple::draw {

namespace {

constexpr std::array<double, 2> dash{7.0, 6.0};  ///< drawn, left out [pixels]

class RasterPen final : public Pen {
 public:
  RasterPen(int width, int height) : canvas_(width, height) {}

  void rectangle(const Rect& r, const Colour& colour, double corner) override {
    canvas_.rectangle(r, colour, corner);
  }

  void line(const std::vector<Vec2>& points, double thickness, const Colour& colour, bool dashed) override {
    std::size_t part = 0;
    double left = dash[0];  // of the running dash or gap
    for (std::size_t i = 1; i < points.size(); ++i) {
      const Vec2 a = points[i - 1], b = points[i];
      if (!dashed) {
        canvas_.line(a, b, thickness, colour);
        continue;
      }
      const double length = (b - a).norm();
      for (double from = 0.0; from < length;) {
        const double to = std::min(from + left, length);
        if (part == 0)
          canvas_.line(a + (b - a) * (from / length), a + (b - a) * (to / length), thickness, colour);
        left -= to - from;
        if (!(left > 1e-9)) part = 1 - part, left = dash[part];
        from = to;
      }
    }
  }

  void disc(const Vec2& centre, double radius, const Colour& fill, const Edge& edge) override {
    canvas_.disc(centre, radius + edge.thickness / 2.0, edge.colour);
    canvas_.disc(centre, radius - edge.thickness / 2.0, fill);
  }

  void polygon(const std::vector<Vec2>& corners, const Colour& fill, const Edge& edge) override {
    canvas_.polygon(corners, edge.colour, edge.thickness / 2.0);
    canvas_.polygon(corners, fill, -edge.thickness / 2.0);
  }

  void text(const Vec2& at, const std::string& text, const Style& style, Align align, double room) override {
    draw::write(canvas_, at, room < any_room ? shortened(text, room, style) : text, style, align);
  }

  void write(const std::filesystem::path& file) const override { write_png(file, canvas_); }

 private:
  Canvas canvas_;
};

/// The pixels' text stands this part of its size above the line it is given; the SVG's does as well.
constexpr double lift = 0.19;

/// Two decimals at most: far finer than a pixel, and short.
std::string number(double value) {
  std::string text = fmt::format("{:.2f}", value);
  while (text.back() == '0') text.pop_back();
  if (text.back() == '.') text.pop_back();
  return text == "-0" ? "0" : text;
}

std::string hex(const Colour& c) {
  const auto part = [](float value) { return std::lround(value * 255.0F); };
  return fmt::format("#{:02x}{:02x}{:02x}", part(c.red), part(c.green), part(c.blue));
}

/// The bytes of the character that starts at i, or 0 where none does that XML may hold.
std::size_t character_at(std::string_view text, std::size_t i) {
  const auto byte = [&](std::size_t k) -> unsigned {
    return i + k < text.size() ? static_cast<unsigned char>(text[i + k]) : 0U;
  };
  const unsigned first = byte(0);
  if (first < 0x80) return first >= 0x20 && first != 0x7F ? 1 : 0;
  const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4) return 0;
  unsigned code = first & (0xFFU >> (length + 1));
  for (std::size_t k = 1; k < length; ++k) {
    if ((byte(k) & 0xC0U) != 0x80U) return 0;
    code = code << 6 | (byte(k) & 0x3FU);
  }
  static constexpr std::array<unsigned, 5> smallest{0, 0, 0x80, 0x800, 0x10000};
  const bool allowed = code >= 0xA0 && !(code >= 0xD800 && code <= 0xDFFF) && (code & 0xFFFEU) != 0xFFFEU;
  return allowed && code >= smallest[length] && code <= 0x10FFFF ? length : 0;
}

/// For XML: signs with a meaning escaped; a blank for tabs and ends of lines; '?' for what is not UTF-8 or
/// not allowed.
std::string escaped(std::string_view text) {
  std::string clean;
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t length = character_at(text, i);
    const char c = text[i];
    if (c == '&')
      clean += "&amp;";
    else if (c == '<')
      clean += "&lt;";
    else if (c == '>')
      clean += "&gt;";
    else if (c == '"')
      clean += "&quot;";
    else if (length > 0)
      clean += text.substr(i, length);
    else
      clean += c == '\t' || c == '\n' || c == '\r' ? ' ' : '?';
    i += std::max<std::size_t>(length, 1);
  }
  return clean;
}

class SvgPen final : public Pen {
 public:
  SvgPen(int width, int height)
      : body_(fmt::format("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
                          "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0}\" height=\"{1}\" "
                          "viewBox=\"0 0 {0} {1}\" font-family=\"sans-serif\">\n"
                          "<rect width=\"{0}\" height=\"{1}\" fill=\"{2}\"/>\n",
                          width, height, hex(page))) {}

  void rectangle(const Rect& r, const Colour& colour, double corner) override {
    body_ += fmt::format("<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"{} fill=\"{}\"/>\n", number(r.x),
                         number(r.y), number(r.w), number(r.h),
                         corner > 0.0 ? fmt::format(" rx=\"{}\"", number(corner)) : "", hex(colour));
  }

  void line(const std::vector<Vec2>& points, double thickness, const Colour& colour, bool dashed) override {
    body_ += fmt::format(
        "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" "
        "stroke-linecap=\"round\" stroke-linejoin=\"round\"{}/>\n",
        list(points), hex(colour), number(thickness),
        dashed ? fmt::format(" stroke-dasharray=\"{} {}\"", number(dash[0]), number(dash[1])) : "");
  }

  void disc(const Vec2& centre, double radius, const Colour& fill, const Edge& edge) override {
    body_ += fmt::format("<circle cx=\"{}\" cy=\"{}\" r=\"{}\" fill=\"{}\"{}/>\n", number(centre.x()),
                         number(centre.y()), number(radius), hex(fill), stroke(edge));
  }

  void polygon(const std::vector<Vec2>& corners, const Colour& fill, const Edge& edge) override {
    body_ += fmt::format("<polygon points=\"{}\" fill=\"{}\"{}/>\n", list(corners), hex(fill), stroke(edge));
  }

  void text(const Vec2& at, const std::string& text, const Style& style, Align align, double room) override {
    if (printable(text).find_first_not_of(' ') == std::string::npos) return;
    const double wide = text_width(text, style);
    const std::string shown = wide <= room ? text : shortened(text, room, style);
    const char* anchor = align == Align::left ? "" : align == Align::centre ? "middle" : "end";
    // A character that the built-in font lacks was measured as '?': its line is left as wide as it comes.
    const bool measured = printable(shown) == shown;
    body_ += fmt::format("<text x=\"{}\" y=\"{}\" font-size=\"{}\"{}{}{} fill=\"{}\">{}{}</text>\n",
                         number(at.x()), number(at.y() - lift * style.size), number(style.size),
                         style.bold ? " font-weight=\"bold\"" : "",
                         align == Align::left ? "" : fmt::format(" text-anchor=\"{}\"", anchor),
                         measured ? fmt::format(" textLength=\"{}\" lengthAdjust=\"spacingAndGlyphs\"",
                                                number(text_width(shown, style)))
                                  : "",
                         hex(style.colour),
                         wide <= room ? "" : fmt::format("<title>{}</title>", escaped(text)), escaped(shown));
  }

  void write(const std::filesystem::path& file) const override { write_file(file, body_ + "</svg>\n"); }

 private:
  static std::string list(const std::vector<Vec2>& points) {
    std::string text;
    for (const Vec2& p : points)
      text += fmt::format("{}{},{}", text.empty() ? "" : " ", number(p.x()), number(p.y()));
    return text;
  }

  static std::string stroke(const Edge& edge) {
    return edge.thickness > 0.0
               ? fmt::format(" stroke=\"{}\" stroke-width=\"{}\"", hex(edge.colour), number(edge.thickness))
               : "";
  }

  std::string body_;
};

}  // namespace

std::unique_ptr<Pen> raster_pen(int width, int height) {
  return std::make_unique<RasterPen>(width, height);
}

std::unique_ptr<Pen> svg_pen(int width, int height) {
  return std::make_unique<SvgPen>(width, height);
}

}  // namespace dimple::draw
