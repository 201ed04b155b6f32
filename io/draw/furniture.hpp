#pragma once

// Common elements of pictures: cards, legends, scale bars, axes with curves, strips of text. Used by the
// files of this folder only.

#include <string>
#include <vector>

#include "io/draw/canvas.hpp"
#include "io/draw/chart.hpp"

namespace dimple::draw {

constexpr double picture_edge = 20.0, text_row = 21.0;  // [pixels]

/// A white card with a hairline around it.
void draw_card(Canvas& canvas, const Rect& r, double corner = 8.0);

void say_in_the_middle(Canvas& canvas, const Rect& room, const std::string& text);

/// A bar of a round length, at most 0.22 of the room, with its number, in the lower right of the room.
void draw_scale_bar(Canvas& canvas, const Rect& room, double pixels_per_mm);

enum class Mark { dot, cross, line, solid };

struct LegendEntry {
  std::string text;
  Colour colour;
  Mark mark;
};

/// Entries side by side from the left, to `right` at most. A text without room loses its last parts.
void draw_legend(Canvas& canvas, Vec2 at, double right, const std::vector<LegendEntry>& entries);

/// Texts broken between words, `most_of_one` rows of each and `most` in all: the last then gives the number
/// of those left out.
std::vector<std::string> rows_of(const std::vector<std::string>& texts, double room, const Style& style,
                                 std::size_t most, std::size_t most_of_one);

/// The height of the rows with a margin; 0 if there are none.
double height_of_rows(const std::vector<std::string>& rows);

/// The picture's title, and below it a strip with warnings in rows.
void draw_title(Canvas& canvas, const std::string& title, const std::vector<std::string>& warnings);

/// Small text from the top of a strip at height y.
void draw_facts(Canvas& canvas, double y, const std::vector<std::string>& rows);

inline constexpr Style warning_style{.size = 15.0, .colour = warning_ink},
    fact_style{.size = 15.0, .colour = fact_ink};

/// The axes, the curves and the legend of a chart, without its title.
void draw_plot(Canvas& canvas, const Rect& room, const Chart& chart);

}  // namespace dimple::draw
