#include "io/draw/before_after.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "io/draw/canvas.hpp"

namespace dimple {
namespace {

using namespace draw;
using Plane = BeforeAfter::Plane;

constexpr int width = 1600;
constexpr double edge = 20.0, between = 14.0, row = 21.0, letter_room = 20.0;
const Colour moved_ink = rgb(0xE8590C), rest_ink = rgb(0x1560A0), wall_ink = rgb(0x6B4FA0),
             mark_ink = rgb(0x00A07A), warning_ink = rgb(0x8A4B00), warning_fill = rgb(0xFFF3DC);

void check(const Plane& plane) {
  const auto all = static_cast<std::size_t>(3 * plane.columns * plane.rows);
  if (plane.before.size() != all || plane.after.size() != all || !(plane.width_mm > 0.0) ||
      !(plane.height_mm > 0.0))
    throw std::invalid_argument(fmt::format("the plane {} has {} and {} numbers for {} x {} places",
                                            plane.name, plane.before.size(), plane.after.size(),
                                            plane.columns, plane.rows));
}

// The values, each a rectangle of its own, pixel by pixel of the canvas.
void draw_values(Canvas& canvas, const Rect& r, const Plane& plane, const std::vector<std::uint8_t>& value) {
  if (value.empty()) return;
  const auto wide = static_cast<int>(r.w * fine), tall = static_cast<int>(r.h * fine);
  for (int y = 0; y < tall; ++y)
    for (int x = 0; x < wide; ++x) {
      const auto column = static_cast<std::ptrdiff_t>(x) * plane.columns / wide,
                 line = static_cast<std::ptrdiff_t>(y) * plane.rows / tall;
      const std::uint8_t* at = value.data() + 3 * (column + plane.columns * line);
      const auto part = [&](int c) { return static_cast<float>(at[c]) / 255.0F; };
      canvas.blend(static_cast<int>(r.x * fine) + x, static_cast<int>(r.y * fine) + y,
                   {part(0), part(1), part(2)}, 1.0);
    }
}

void draw_letters(Canvas& canvas, const Rect& r, const Plane& plane) {
  const Style style{.size = 15.0, .bold = true};
  write(canvas, {r.x - 11.0, r.y + r.h / 2.0 + 5.0}, plane.letters[0], style, Align::centre);
  write(canvas, {r.x + r.w + 11.0, r.y + r.h / 2.0 + 5.0}, plane.letters[1], style, Align::centre);
  write(canvas, {r.x + r.w / 2.0, r.y - 6.0}, plane.letters[2], style, Align::centre);
  write(canvas, {r.x + r.w / 2.0, r.y + r.h + 17.0}, plane.letters[3], style, Align::centre);
}

void draw_scale_bar(Canvas& canvas, const Rect& r, double pixels_per_mm) {
  const double length_mm = round_below(0.25 * r.w / pixels_per_mm), length = length_mm * pixels_per_mm;
  const double right = r.x + r.w, y = r.y + r.h + 14.0;
  canvas.line({right - length, y}, {right, y}, 2.0, ink);
  write(canvas, {right - length - 6.0, y + 5.0}, fmt::format("{:g} mm", length_mm), {.size = 14.0},
        Align::right);
}

void draw_plane(Canvas& canvas, const Rect& r, const Plane& plane, bool after) {
  const double scale = r.w / plane.width_mm;
  draw_values(canvas, r, plane, after ? plane.after : plane.before);
  const auto at = [&](const Vec2& p) {
    return Vec2(r.x + scale * std::clamp(p.x(), 0.0, plane.width_mm),
                r.y + scale * std::clamp(p.y(), 0.0, plane.height_mm));
  };
  const auto draw = [&](const BeforeAfter::Pieces& pieces, double thick, const Colour& colour) {
    for (const auto& piece : pieces) canvas.line(at(piece[0]), at(piece[1]), thick, colour);
  };
  draw(plane.wall, 2.0, wall_ink);
  draw(plane.rest, after ? 1.2 : 1.8, rest_ink);
  if (after) draw(plane.moved, 1.8, moved_ink);
  for (const Vec2& mark : after ? plane.mark_after : plane.mark_before) {
    canvas.disc(at(mark), 5.5, card);
    canvas.disc(at(mark), 4.0, mark_ink);
  }
  draw_letters(canvas, r, plane);
  draw_scale_bar(canvas, r, scale);
}

void draw_legend(Canvas& canvas, Vec2 at, const BeforeAfter& picture) {
  const Style style{.size = 15.0};
  const bool follows = std::any_of(picture.plane.begin(), picture.plane.end(),
                                   [](const Plane& p) { return !p.mark_before.empty(); });
  const auto entry = [&](const std::string& text, const Colour& colour, bool dot) {
    if (text.empty()) return;
    if (dot)
      canvas.disc(at + Vec2(8.0, -5.0), 4.0, colour);
    else
      canvas.line(at + Vec2(0.0, -5.0), at + Vec2(16.0, -5.0), 2.0, colour);
    write(canvas, at + Vec2(22.0, 0.0), text, style);
    at.x() += 22.0 + text_width(text, style) + 26.0;
  };
  entry("outline before", rest_ink, false);
  entry("outline after", moved_ink, false);
  entry(picture.wall, wall_ink, false);
  entry(follows ? "target" : "", mark_ink, true);
}

std::vector<std::string> rows_of(const std::vector<std::string>& texts, const std::string& before,
                                 const Style& style) {
  std::vector<std::string> rows;
  for (const std::string& text : texts)
    for (const std::string& part : wrapped(before + text, width - 2.0 * edge - 28.0, style))
      rows.push_back(part);
  return rows;
}

}  // namespace

std::string before_after_png(const BeforeAfter& picture) {
  double widths = 0.0, tallest = 0.0;
  for (const Plane& plane : picture.plane) {
    check(plane);
    widths += plane.width_mm;
    tallest = std::max(tallest, plane.height_mm);
  }
  const auto count = static_cast<double>(picture.plane.size());
  const double scale =
      picture.plane.empty()
          ? 1.0
          : std::min((width - 2.0 * edge - count * (2.0 * letter_room + between)) / widths, 480.0 / tallest);
  const Style warning{.size = 15.0, .colour = warning_ink}, fact{.size = 15.0, .colour = rgb(0x3A4654)};
  const std::vector<std::string> warnings = rows_of(picture.warnings, "Warning: ", warning),
                                 facts = rows_of(picture.lines, "", fact);
  const auto tall_of = [](const std::vector<std::string>& rows) {
    return rows.empty() ? 0.0 : static_cast<double>(rows.size()) * row + 12.0;
  };
  const double plane_tall = scale * tallest + 74.0;
  const double top = 66.0 + tall_of(warnings);
  Canvas canvas(width, static_cast<int>(top + 2.0 * plane_tall + 40.0 + tall_of(facts) + edge));
  canvas.rectangle({0.0, 0.0, static_cast<double>(canvas.width()), static_cast<double>(canvas.height())},
                   card);
  const Style title{.size = 26.0, .bold = true}, heading{.size = 17.0, .bold = true};
  write(canvas, {edge + 4.0, 44.0}, shortened(picture.title, width - 2.0 * edge, title), title);
  if (!warnings.empty())
    canvas.rectangle({edge, 60.0, width - 2.0 * edge, tall_of(warnings)}, warning_fill, 6.0);
  for (std::size_t k = 0; k < warnings.size(); ++k)
    write(canvas, {edge + 14.0, 81.0 + static_cast<double>(k) * row}, warnings[k], warning);
  for (const bool after : {false, true}) {
    double x = edge + letter_room, y = top + (after ? plane_tall : 0.0);
    for (const Plane& plane : picture.plane) {
      write(canvas, {x, y + 16.0}, fmt::format("{}, {}", plane.name, after ? "after" : "before"), heading);
      draw_plane(canvas, {x, y + 42.0, scale * plane.width_mm, scale * plane.height_mm}, plane, after);
      x += scale * plane.width_mm + 2.0 * letter_room + between;
    }
  }
  draw_legend(canvas, {edge + 4.0, top + 2.0 * plane_tall + 18.0}, picture);
  for (std::size_t k = 0; k < facts.size(); ++k)
    write(canvas, {edge + 4.0, top + 2.0 * plane_tall + 52.0 + static_cast<double>(k) * row}, facts[k], fact);
  return png(canvas);
}

}  // namespace dimple
