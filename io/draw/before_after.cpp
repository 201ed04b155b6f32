#include "io/draw/before_after.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "io/draw/furniture.hpp"

namespace dimple {
namespace {

using namespace draw;
using Plane = BeforeAfter::Plane;

constexpr int width = 1600;
constexpr double letter_room = 20.0;
const Colour moved_ink = rgb(0xE8590C), undeformed_ink = rgb(0x1560A0), mark_ink = rgb(0x00A07A);

void check(const Plane& plane) {
  const auto all = static_cast<std::size_t>(3 * plane.columns * plane.rows);
  if (plane.before.size() != all || plane.after.size() != all || !(plane.width_mm > 0.0) ||
      !(plane.height_mm > 0.0))
    throw std::invalid_argument(fmt::format("the plane {} has {} and {} numbers for {} x {} places",
                                            plane.name, plane.before.size(), plane.after.size(),
                                            plane.columns, plane.rows));
}

// Draws the values, each as a rectangle, pixel by pixel of the canvas.
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
  const std::array<Vec2, 4> at{Vec2(r.x - 11.0, r.y + r.h / 2.0 + 5.0),
                               {r.x + r.w + 11.0, r.y + r.h / 2.0 + 5.0},
                               {r.x + r.w / 2.0, r.y - 6.0},
                               {r.x + r.w / 2.0, r.y + r.h + 17.0}};
  for (std::size_t k = 0; k < at.size(); ++k)
    canvas.text(at[k], plane.letters[k], {.size = 15.0, .bold = true}, Align::centre);
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
  draw(plane.undeformed, after ? 1.2 : 1.8, undeformed_ink);
  if (after) draw(plane.moved, 1.8, moved_ink);
  for (const Vec2& mark : after ? plane.mark_after : plane.mark_before) {
    canvas.disc(at(mark), 5.5, card);
    canvas.disc(at(mark), 4.0, mark_ink);
  }
  draw_letters(canvas, r, plane);
  draw_scale_bar(canvas, {r.x, r.y, r.w + 8.0, r.h + 40.0}, scale);
}

void draw_meanings(Canvas& canvas, const Vec2& at, const BeforeAfter& picture) {
  std::vector<LegendEntry> entries{{"outline before", undeformed_ink, Mark::line},
                                   {"outline after", moved_ink, Mark::line}};
  if (!picture.wall.empty()) entries.push_back({picture.wall, wall_ink, Mark::line});
  if (std::any_of(picture.plane.begin(), picture.plane.end(),
                  [](const Plane& p) { return !p.mark_before.empty(); }))
    entries.push_back({"target", mark_ink, Mark::dot});
  draw_legend(canvas, at, width - picture_edge, entries);
}

}  // namespace

std::string before_after_png(const BeforeAfter& picture) {
  constexpr double edge = picture_edge, between = 14.0, tallest_plane = 480.0;
  double widths = 0.0, tallest = 0.0;
  for (const Plane& plane : picture.plane) {
    check(plane);
    widths += plane.width_mm;
    tallest = std::max(tallest, plane.height_mm);
  }
  const auto count = static_cast<double>(picture.plane.size());
  const double room = width - 2.0 * edge - count * (2.0 * letter_room + between);
  const double scale = picture.plane.empty() ? 1.0 : std::min(room / widths, tallest_plane / tallest);
  constexpr std::size_t all = 1000;
  std::vector<std::string> warnings;
  for (const std::string& text : picture.warnings) warnings.push_back("Warning: " + text);
  warnings = rows_of(warnings, width - 2.0 * edge - 12.0, warning_style, all, all);
  const std::vector<std::string> facts =
      rows_of(picture.lines, width - 2.0 * edge - 12.0, fact_style, all, all);
  const double top = 72.0 + height_of_rows(warnings), plane_tall = scale * tallest + 82.0;
  const double below = top + 2.0 * plane_tall;
  Canvas canvas(width, static_cast<int>(below + 40.0 + height_of_rows(facts) + edge));
  canvas.rectangle({0.0, 0.0, static_cast<double>(canvas.width()), static_cast<double>(canvas.height())},
                   card);
  draw_title(canvas, picture.title, warnings);
  for (const bool after : {false, true}) {
    double x = edge + letter_room;
    const double y = top + (after ? plane_tall : 0.0);
    for (const Plane& plane : picture.plane) {
      canvas.text({x, y + 16.0}, fmt::format("{}, {}", plane.name, after ? "after" : "before"),
                  {.size = 17.0, .bold = true});
      draw_plane(canvas, {x, y + 42.0, scale * plane.width_mm, scale * plane.height_mm}, plane, after);
      x += scale * plane.width_mm + 2.0 * letter_room + between;
    }
  }
  draw_meanings(canvas, {edge + 4.0, below + 18.0}, picture);
  draw_facts(canvas, below + 28.0, facts);
  return canvas.bytes();
}

}  // namespace dimple
