#include "io/draw/furniture.hpp"

#include <fmt/format.h>

namespace dimple::draw {

void draw_card(Canvas& canvas, const Rect& r, double corner) {
  canvas.rectangle({r.x - 1.0, r.y - 1.0, r.w + 2.0, r.h + 2.0}, hairline, corner + 1.0);
  canvas.rectangle(r, card, corner);
}

void say_in_the_middle(Canvas& canvas, const Rect& room, const std::string& text) {
  canvas.text({room.x + room.w / 2.0, room.y + room.h / 2.0}, text, {.size = 17.0, .colour = soft_ink},
              Align::centre);
}

void draw_scale_bar(Canvas& canvas, const Rect& room, double pixels_per_mm) {
  const double length_mm = round_below(0.22 * room.w / pixels_per_mm), length = length_mm * pixels_per_mm;
  const double right = room.x + room.w - 8.0, y = room.y + room.h - 8.0;
  canvas.rectangle({right - length - 6.0, y - 24.0, length + 12.0, 32.0}, card, 4.0);
  canvas.line({right - length, y}, {right, y}, 2.0, ink);
  for (const double x : {right - length, right}) canvas.line({x, y - 4.0}, {x, y + 4.0}, 2.0, ink);
  canvas.text({right - length / 2.0, y - 8.0}, fmt::format("{:g} mm", length_mm), small, Align::centre);
}

void draw_legend(Canvas& canvas, Vec2 at, double right, const std::vector<LegendEntry>& entries) {
  for (const auto& [text, colour, mark] : entries) {
    std::string shown = text;  // a tool loses its measures first: they are among the facts
    for (const char* part : {", ", " of "})
      while (text_width(shown, small) > right - at.x() - 20.0 && shown.rfind(part) != std::string::npos)
        shown.resize(shown.rfind(part));
    const Vec2 middle = at + Vec2(7.0, -5.0), across(mark == Mark::line ? 8.0 : 5.0, 0.0), down(0.0, 5.0);
    const double thick = mark == Mark::line ? 2.0 : 1.6;
    if (mark == Mark::dot) canvas.disc(middle, 5.0, colour);
    if (mark == Mark::solid) canvas.rectangle({middle.x() - 6.0, middle.y() - 6.0, 12.0, 12.0}, colour, 2.0);
    if (mark == Mark::line || mark == Mark::cross)
      canvas.line(middle - across, middle + across, thick, colour);
    if (mark == Mark::cross) canvas.line(middle - down, middle + down, thick, colour);
    canvas.text(at + Vec2(20.0, 0.0), shown, small);
    at.x() += 20.0 + text_width(shown, small) + 24.0;
  }
}

std::vector<std::string> rows_of(const std::vector<std::string>& texts, double room, const Style& style,
                                 std::size_t most, std::size_t most_of_one) {
  std::vector<std::string> rows;
  for (std::size_t k = 0; k < texts.size(); ++k) {
    std::vector<std::string> parts = wrapped(texts[k], room - 16.0, style);
    if (parts.size() > most_of_one) {
      parts.resize(most_of_one);
      parts.back() = shortened(parts.back() + " ...", room - 16.0, style);
    }
    if (rows.size() + parts.size() > most || (rows.size() + parts.size() == most && k + 1 < texts.size())) {
      rows.push_back(fmt::format("and {} more, in summary.json", texts.size() - k));
      break;
    }
    for (std::size_t i = 0; i < parts.size(); ++i) rows.push_back((i > 0 ? "    " : "") + parts[i]);
  }
  return rows;
}

double height_of_rows(const std::vector<std::string>& rows) {
  return rows.empty() ? 0.0 : static_cast<double>(rows.size()) * text_row + 12.0;
}

void draw_title(Canvas& canvas, const std::string& title, const std::vector<std::string>& warnings) {
  const double inner = canvas.width() - 2.0 * picture_edge, top = 66.0;
  canvas.text({picture_edge + 4.0, 44.0}, title, {.size = 26.0, .bold = true}, Align::left, inner - 8.0);
  if (!warnings.empty())
    canvas.rectangle({picture_edge, top, inner, height_of_rows(warnings)}, warning_fill, 6.0);
  for (std::size_t i = 0; i < warnings.size(); ++i)
    canvas.text({picture_edge + 14.0, top + 21.0 + static_cast<double>(i) * text_row}, warnings[i],
                warning_style);
}

void draw_facts(Canvas& canvas, double y, const std::vector<std::string>& rows) {
  for (std::size_t i = 0; i < rows.size(); ++i)
    canvas.text({picture_edge + 4.0, y + 24.0 + static_cast<double>(i) * text_row}, rows[i], fact_style);
}

}  // namespace dimple::draw
