#include "io/draw/chart.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <utility>

#include "io/digits.hpp"
#include "io/draw/furniture.hpp"
#include "io/file.hpp"

namespace dimple {

namespace draw {
namespace {

constexpr int panel_width = 1000, panel_height = 650;

// Hues that the common colour-vision deficiencies keep apart, after Okabe and Ito.
constexpr std::array<Colour, 8> hues{rgb(0x0072B2), rgb(0xD55E00), rgb(0x009E73), rgb(0xB5588F),
                                     rgb(0xD99100), rgb(0x4AA3D9), rgb(0x3A4654), rgb(0x7A1F4B)};

const Colour& hue(std::size_t number) {
  return hues[number % hues.size()];
}

/// A white card with title and subtitle; returns the room that is left.
Rect card_with_title(Canvas& canvas, const Rect& tile, const std::string& title,
                     const std::vector<std::string>& subtitle) {
  const Rect r = tile.inset(8.0, 8.0, 8.0, 8.0);
  draw_card(canvas, r);
  Rect room = r.inset(22.0, 14.0, 22.0, 16.0);
  const auto put = [&](const std::vector<std::string>& texts, const Style& style, double row) {
    for (const std::string& text : rows_of(texts, room.w, style, 2 * texts.size(), 2)) {
      room = room.inset(0.0, row, 0.0, 0.0);
      canvas.text({room.x, room.y - 5.0}, text, style);
    }
  };
  constexpr std::ptrdiff_t most_lines = 6;
  put({title}, {.size = 19.0, .bold = true}, 25.0);
  put({subtitle.begin(), subtitle.begin() + std::min(std::ssize(subtitle), most_lines)}, soft, 19.0);
  return room;
}

// ----------------------------------------------------------------------------------------------------- axes

/// Larger numbers are no measurements, and their differences may overflow.
constexpr double largest_shown = 1e300;

bool is_shown(double value) {
  return std::abs(value) <= largest_shown;
}

/// From values to fractions of the plot's width or height.
struct Axis {
  double low = 0.0, high = 1.0;
  double fraction(double value) const { return (value - low) / (high - low); }
};

/// Range of values with a margin of that fraction.
Axis axis_of(const std::vector<double>& values, double part) {
  if (values.empty()) return {};
  const auto [least, largest] = std::minmax_element(values.begin(), values.end());
  const double low = *least, high = *largest, most = std::max(std::abs(low), std::abs(high));
  if (!(high - low > 1e-9 * most)) {
    const double margin = most > 1e-300 ? 0.1 * most : 1.0;
    return {low - margin, high + margin};
  }
  const double margin = part * (high - low);
  if (low >= 0.0 && low < 0.3 * high) return {0.0, high + margin};  // zero where it is near
  if (high <= 0.0 && high > 0.3 * low) return {low - margin, 0.0};
  return {low - margin, high + margin};
}

struct Tick {
  double value;
  std::string text;
};

/// At multiples of a round step between low and high, about `most` of them.
std::vector<Tick> even_ticks(double low, double high, int most) {
  double step = round_below((high - low) / most);
  if (step * most < (high - low) * (1.0 - 1e-9)) step = round_below(2.5 * step);  // 1, 2, 5, 10
  std::vector<Tick> ticks;
  if (!(step > 0.0) || !std::isfinite(step)) return ticks;
  const double largest = std::max(std::abs(low), std::abs(high));
  const bool decimals = largest < 1e6 && step >= 1e-6;
  const int digits = std::clamp(static_cast<int>(std::floor(std::log10(largest / step) + 1e-9)) + 2, 1, 15);
  const double first = std::ceil(low / step - 1e-9);
  for (int i = 0; i <= 2 * most && (first + i) * step <= high + 1e-9 * step; ++i) {
    const double value = (first + i) * step;
    ticks.push_back({value, decimals ? tick_text(value, step) : fmt::format("{:.{}g}", value, digits)});
  }
  return ticks;
}

/// Ticks, as many as the texts have room for: next to each other or one above the other.
std::vector<Tick> ticks_of(const Axis& axis, double pixels, bool vertical) {
  std::vector<Tick> ticks;
  const auto fits = [&] {
    double at = -1e9, half = 0.0;
    for (const Tick& tick : ticks) {
      const double here = axis.fraction(tick.value) * pixels,
                   own = (vertical ? text_width(tick.text, small) + 18.0 : 24.0) / 2.0;
      if (here - at < own + half) return false;
      at = here, half = own;
    }
    return true;
  };
  for (int most = 9; most >= 2; --most) {
    ticks = even_ticks(axis.low, axis.high, most);
    if (fits()) break;
  }
  return ticks;
}

void draw_grid(Canvas& canvas, const Rect& plot, const Axis& axis, const std::vector<Tick>& ticks,
               bool vertical) {
  for (const Tick& tick : ticks) {
    const double f = axis.fraction(tick.value);
    if (f < -1e-9 || f > 1.0 + 1e-9) continue;
    const Vec2 at(plot.x + f * plot.w, plot.y + (1.0 - f) * plot.h);
    const Colour colour = tick.value == 0.0 && f > 1e-6 && f < 1.0 - 1e-6 ? soft_ink : hairline;
    if (vertical) {
      canvas.line({at.x(), plot.y}, {at.x(), plot.y + plot.h}, 1.0, colour);
      canvas.text({at.x(), plot.y + plot.h + 20.0}, tick.text, small, Align::centre);
    } else {
      canvas.line({plot.x, at.y()}, {plot.x + plot.w, at.y()}, 1.0, colour);
      canvas.text({plot.x - 9.0, at.y() + 5.0}, tick.text, small, Align::right);
    }
  }
}

// --------------------------------------------------------------------------------------------------- series

/// A series as it is drawn: pixels instead of values.
struct Trace {
  const ChartSeries* series = nullptr;
  std::size_t look = 0;                 ///< number of hue and marker
  std::vector<std::vector<Vec2>> line;  ///< pieces
  std::vector<Vec2> point;
  std::vector<Vec2> error_bounds;  ///< its corners
};

void draw_marker(Canvas& canvas, const Vec2& at, std::size_t look, double radius) {
  static const std::array<std::vector<Vec2>, 5> shapes{{{},  // a disc
                                                        {{-0.9, -0.9}, {0.9, -0.9}, {0.9, 0.9}, {-0.9, 0.9}},
                                                        {{0.0, -1.25}, {1.15, 0.85}, {-1.15, 0.85}},
                                                        {{0.0, -1.3}, {1.3, 0.0}, {0.0, 1.3}, {-1.3, 0.0}},
                                                        {{-1.15, -0.85}, {1.15, -0.85}, {0.0, 1.25}}}};
  const std::vector<Vec2>& shape = shapes[look % shapes.size()];  // look 8: the hue of 0, another marker
  for (const bool edge : {true, false}) {
    const double r = radius + (edge ? 0.7 : -0.3);
    const Colour& colour = edge ? card : hue(look);
    std::vector<Vec2> corners;
    for (const Vec2& corner : shape) corners.emplace_back(at + r * corner);
    if (shape.empty())
      canvas.disc(at, r, colour);
    else
      canvas.polygon(corners, colour);
  }
}

/// Requested numbers as they are; the others count up past them.
std::vector<std::size_t> looks_of(const std::vector<ChartSeries>& series) {
  std::set<std::size_t> taken;
  for (const ChartSeries& s : series)
    if (s.colour >= 0) taken.insert(static_cast<std::size_t>(s.colour));
  std::vector<std::size_t> looks;
  std::size_t next = 0;
  for (const ChartSeries& s : series) {
    if (s.colour < 0)
      while (taken.contains(next)) ++next;
    looks.push_back(s.colour >= 0 ? static_cast<std::size_t>(s.colour) : next++);
  }
  return looks;
}

/// Traces of the series in the plot.
std::vector<Trace> traces_of(const Chart& chart, const Axis& x, const Axis& y, const Rect& plot) {
  std::vector<Trace> traces;
  const std::vector<std::size_t> looks = looks_of(chart.series);
  const auto at = [&](double value_x, double value_y) {
    return Vec2(plot.x + plot.w * x.fraction(value_x), plot.y + plot.h * (1.0 - y.fraction(value_y)));
  };
  for (std::size_t n = 0; n < chart.series.size(); ++n) {
    const ChartSeries& s = chart.series[n];
    Trace trace{.series = &s, .look = looks[n], .line = {}, .point = {}, .error_bounds = {}};
    std::vector<Vec2> back;  // along the lower side of the error bounds
    bool continues = false;
    for (std::size_t i = 0; i < s.x.size(); ++i) {
      const bool shown = is_shown(s.x[i]) && is_shown(s.y[i]);
      if (shown) {
        trace.point.push_back(at(s.x[i], s.y[i]));
        if (!continues) trace.line.emplace_back();
        trace.line.back().push_back(trace.point.back());
        if (!s.low.empty()) {
          trace.error_bounds.push_back(at(s.x[i], s.high[i]));
          back.push_back(at(s.x[i], s.low[i]));
        }
      }
      continues = shown;
    }
    trace.error_bounds.insert(trace.error_bounds.end(), back.rbegin(), back.rend());
    std::erase_if(trace.line, [&](const auto& piece) { return !s.line || piece.size() < 2; });
    traces.push_back(std::move(trace));
  }
  return traces;
}

/// The text at the last point: above it, unless the curve comes down to it; always inside the plot. On a
/// white ground where other series may be below it.
void draw_end(Canvas& canvas, const Rect& plot, const Trace& trace, bool on_white) {
  const Style strong{.size = 16.0, .bold = true};
  const Vec2 last = trace.point.back();
  canvas.disc(last, 6.5, card);
  canvas.disc(last, 5.0, hues[1]);
  const bool falls = trace.point.size() > 1 && trace.point[trace.point.size() - 2].y() < last.y();
  const double wide = text_width(trace.series->end, strong);
  const Vec2 foot(
      std::clamp(last.x() + 12.0, plot.x + wide + 8.0, std::max(plot.x + plot.w, plot.x + wide + 8.0)),
      last.y() + (falls ? 26.0 : -14.0));
  if (on_white) canvas.rectangle({foot.x() - wide - 4.0, foot.y() - 16.0, wide + 8.0, 22.0}, card, 4.0);
  canvas.text(foot, trace.series->end, strong, Align::right);
}

void draw_traces(Canvas& canvas, const Rect& plot, const std::vector<Trace>& traces) {
  for (const Trace& trace : traces)
    if (trace.error_bounds.size() > 3)
      canvas.polygon(trace.error_bounds, mixed(hue(trace.look), card, 0.72F));
  for (const Trace& trace : traces)
    for (const auto& piece : trace.line) canvas.curve(piece, 2.2, hue(trace.look), trace.series->dashed);
  for (const Trace& trace : traces)
    for (const Vec2& at : trace.point) {
      if (trace.series->markers)
        draw_marker(canvas, at, trace.look, trace.point.size() > 40 ? 2.4 : 5.0);
      else if (trace.series->line && trace.line.empty())
        canvas.disc(at, 1.6, hue(trace.look));  // a line of one point
    }
  for (const Trace& trace : traces)
    if (!trace.series->end.empty() && !trace.point.empty()) draw_end(canvas, plot, trace, traces.size() > 1);
}

// --------------------------------------------------------------------------------------------------- legend

constexpr double legend_mark = 36.0, legend_gap = 26.0, legend_row = 22.0;

/// Positions of the samples below the plot, from the upper left, for each series with a name.
struct LegendPlan {
  std::vector<std::pair<std::size_t, Vec2>> entries;
  double height = 0.0;
};

LegendPlan plan_legend(const Chart& chart, double room) {
  LegendPlan plan;
  Vec2 at(0.0, 0.0);
  for (std::size_t n = 0; n < chart.series.size(); ++n) {
    const std::string& name = chart.series[n].name;
    if (name.empty()) continue;
    const double wide = std::min(legend_mark + text_width(name, small), room);
    if (at.x() + wide > room) at = Vec2(0.0, at.y() + legend_row);
    plan.entries.emplace_back(n, at);
    plan.height = at.y() + legend_row;
    at.x() += wide + legend_gap;
  }
  return plan;
}

void draw_names(Canvas& canvas, const Rect& room, const LegendPlan& plan, const std::vector<Trace>& traces) {
  const Vec2 first(room.x, room.y + room.h - 4.0 - plan.height + legend_row);
  for (const auto& [series, place] : plan.entries) {
    const Trace& trace = traces[series];
    const Vec2 at = first + place, mark = at + Vec2(15.0, -5.0), across(14.0, 0.0);
    if (trace.series->line)
      canvas.curve({mark - across, mark + across}, 2.2, hue(trace.look), trace.series->dashed);
    if (trace.series->markers) draw_marker(canvas, mark, trace.look, 5.0);
    canvas.text(at + Vec2(legend_mark, 0.0), trace.series->name, small, Align::left,
                room.w - legend_mark + 4.0);
  }
}

}  // namespace

void draw_plot(Canvas& canvas, const Rect& room, const Chart& chart) {
  std::vector<double> xs, ys;
  for (const ChartSeries& s : chart.series)
    for (std::size_t i = 0; i < s.x.size(); ++i) {
      if (!is_shown(s.x[i]) || !is_shown(s.y[i])) continue;
      xs.push_back(s.x[i]);
      ys.push_back(s.y[i]);
      if (!s.low.empty()) ys.insert(ys.end(), {s.low[i], s.high[i]});
    }
  const Axis x = axis_of(xs, 0.06), y = axis_of(ys, 0.1);

  // From outside to inside: the texts above and below leave the height, the numbers of y the width.
  const LegendPlan legend = plan_legend(chart, room.w);
  const double above = chart.y_label.empty() ? 14.0 : 36.0;
  const double below =
      28.0 + (chart.x_label.empty() ? 0.0 : 24.0) + (legend.height > 0.0 ? legend.height + 8.0 : 0.0);
  Rect plot = room.inset(0.0, above, 20.0, below);
  const auto y_ticks = ticks_of(y, plot.h, false);
  double numbers = 0.0;
  for (const Tick& tick : y_ticks) numbers = std::max(numbers, text_width(tick.text, small));
  plot = plot.inset(numbers + 12.0, 0.0, 0.0, 0.0);

  draw_grid(canvas, plot, x, ticks_of(x, plot.w, true), true);
  draw_grid(canvas, plot, y, y_ticks, false);
  const double right = plot.x + plot.w, foot = plot.y + plot.h;
  canvas.curve({{plot.x, plot.y}, {right, plot.y}, {right, foot}}, 1.0, hairline);
  canvas.curve({{plot.x, plot.y}, {plot.x, foot}, {right, foot}}, 1.4, soft_ink);
  canvas.text({room.x, plot.y - 14.0}, chart.y_label, small, Align::left, room.w);
  canvas.text({plot.x + plot.w / 2.0, foot + 44.0}, chart.x_label, small, Align::centre, plot.w);

  const std::vector<Trace> traces = traces_of(chart, x, y, plot);
  draw_traces(canvas, plot, traces);
  if (xs.empty()) say_in_the_middle(canvas, plot, "no data");
  draw_names(canvas, room, legend, traces);
}

// --------------------------------------------------------------------------------------------------- panels

namespace {

void check(const Chart& chart) {
  for (const ChartSeries& s : chart.series)
    if (s.x.size() != s.y.size() || s.low.size() != s.high.size() ||
        (!s.low.empty() && s.low.size() != s.y.size()))
      throw std::invalid_argument(
          fmt::format("the series \"{}\" has {} x, {} y, {} lower and {} upper bounds", s.name, s.x.size(),
                      s.y.size(), s.low.size(), s.high.size()));
}

double height_of(const Chart&) {
  return panel_height;
}

void draw_panel(Canvas& canvas, const Rect& tile, const Chart& chart) {
  draw_plot(canvas, card_with_title(canvas, tile, chart.title, chart.subtitle), chart);
}

void check(const Tornado& tornado) {
  for (const Tornado::Row& row : tornado.rows)
    if (!is_shown(row.low) || !is_shown(row.high))
      throw std::invalid_argument(fmt::format("the bar \"{}\" has no finite end", row.name));
}

constexpr Style bar_name{.size = 14.0, .bold = true}, bar_note{.size = 13.0, .colour = soft_ink};
const Colour shade_grey = mixed(card, hairline, 0.55F);

/// Plot area of a panel of that size, without the room for the names of the rows.
Rect plot_of(const Rect& room, const Tornado& tornado) {
  const bool has_legend = !tornado.legend.empty() || tornado.shade > 0.0;
  return room.inset(0.0, 16.0, 12.0, 58.0 + (has_legend ? legend_row + 6.0 : 0.0));
}

double row_height(const Rect& plot, const Tornado& tornado) {
  constexpr double most = 46.0;
  return std::min(plot.h / static_cast<double>(tornado.rows.size()), most);
}

/// A panel ends below its rows.
double height_of(const Tornado& tornado) {
  constexpr Rect most{0.0, 0.0, panel_width, panel_height};
  if (tornado.rows.empty()) return most.h;
  Canvas nothing(1, 1);
  const Rect plot = plot_of(card_with_title(nothing, most, tornado.title, tornado.subtitle), tornado);
  return std::ceil(most.h - plot.h + row_height(plot, tornado) * static_cast<double>(tornado.rows.size()));
}

/// Text next to a bar: its name, and a note below it where there is room for two lines.
struct BarWords {
  std::string name, under;
  Style style;
};

BarWords words_of(const Tornado::Row& row, double height) {
  if (height >= 34.0 || row.note.empty()) return {row.name, row.note, bar_name};
  return {fmt::format("{}: {}", row.name, row.note), "", small};
}

/// Axis over zero, the shade and every end, with room for the numbers at the ends.
Axis axis_of_bars(const Tornado& tornado, double pixels) {
  constexpr double number = 70.0;
  std::vector<double> values = {0.0, -tornado.shade, tornado.shade};
  for (const Tornado::Row& row : tornado.rows) values.insert(values.end(), {row.low, row.high});
  Axis axis = axis_of(values, 0.06);
  const double margin = number / pixels * (axis.high - axis.low);
  axis.low = std::min(axis.low, *std::min_element(values.begin(), values.end()) - margin);
  axis.high = std::max(axis.high, *std::max_element(values.begin(), values.end()) + margin);
  return axis;
}

/// The bar at that height, and the numbers at its ends.
void draw_bar(Canvas& canvas, const Rect& plot, const Axis& axis, const Tornado::Row& row, double middle,
              double thick) {
  const auto across = [&](double value) { return plot.x + axis.fraction(value) * plot.w; };
  const double low = across(std::min(row.low, 0.0)), high = across(std::max(row.high, 0.0));
  canvas.rectangle({low, middle - thick / 2.0, std::max(high - low, 2.0), thick},
                   hue(static_cast<std::size_t>(std::max(row.colour, 0))), 2.0);
  if (row.low < 0.0 || row.high <= 0.0)
    canvas.text({low - 6.0, middle + 5.0}, with_sign(row.low), small, Align::right);
  if (row.high > 0.0) canvas.text({high + 6.0, middle + 5.0}, with_sign(row.high), small);
}

/// Width of the longest name of the rows, within a limit.
double width_of_names(const Tornado& tornado, double height) {
  constexpr double most_names = 430.0;
  double names = 0.0;
  for (const Tornado::Row& row : tornado.rows) {
    const auto [name, under, style] = words_of(row, height);
    names = std::max({names, text_width(name, style), text_width(under, bar_note)});
  }
  return std::min(names + 20.0, most_names);
}

/// The meanings of the colours and of the shade, from that place to the right edge.
void draw_meanings(Canvas& canvas, const Vec2& at, double right, const Tornado& tornado) {
  std::vector<LegendEntry> entries;
  for (const auto& [colour, meaning] : tornado.legend)
    entries.push_back({meaning, hue(static_cast<std::size_t>(std::max(colour, 0))), Mark::solid});
  if (tornado.shade > 0.0) entries.push_back({tornado.shade_text, shade_grey, Mark::solid});
  draw_legend(canvas, at, right, entries);
}

void draw_panel(Canvas& canvas, const Rect& tile, const Tornado& tornado) {
  const Rect room = card_with_title(canvas, tile, tornado.title, tornado.subtitle);
  if (tornado.rows.empty()) return say_in_the_middle(canvas, room, "no data");
  Rect plot = plot_of(room, tornado);
  const double height = row_height(plot, tornado), names = width_of_names(tornado, height);
  plot = plot.inset(names, 0.0, 0.0, 0.0);
  plot.h = height * static_cast<double>(tornado.rows.size());
  const Axis axis = axis_of_bars(tornado, plot.w);
  const double zero = plot.x + axis.fraction(0.0) * plot.w,
               shade = plot.x + axis.fraction(tornado.shade) * plot.w - zero;
  if (tornado.shade > 0.0) canvas.rectangle({zero - shade, plot.y, 2.0 * shade, plot.h}, shade_grey);
  draw_grid(canvas, plot, axis, ticks_of(axis, plot.w, true), true);
  for (std::size_t r = 0; r < tornado.rows.size(); ++r) {
    const double middle = plot.y + (static_cast<double>(r) + 0.5) * height;
    const auto [name, under, style] = words_of(tornado.rows[r], height);
    canvas.text({plot.x - 14.0, middle + (under.empty() ? 5.0 : -2.0)}, name, style, Align::right,
                names - 16.0);
    canvas.text({plot.x - 14.0, middle + 14.0}, under, bar_note, Align::right, names - 16.0);
    draw_bar(canvas, plot, axis, tornado.rows[r], middle, std::min(0.62 * height, 24.0));
  }
  canvas.line({zero, plot.y}, {zero, plot.y + plot.h}, 1.4, soft_ink);
  const double baseline = plot.y + plot.h + 44.0;
  canvas.text({plot.x + plot.w / 2.0, baseline}, tornado.x_label, small, Align::centre, plot.w);
  draw_meanings(canvas, {room.x, baseline + legend_row}, room.x + room.w, tornado);
}

template <class Panel>
void write_panels(const std::filesystem::path& file, const std::vector<Panel>& panels) {
  if (panels.empty()) throw std::invalid_argument("a picture without panels");
  double tall = 0.0;
  for (const Panel& panel : panels) {
    check(panel);
    tall = std::max(tall, height_of(panel));
  }
  Canvas canvas(panel_width, static_cast<int>(panels.size()) * static_cast<int>(tall),
                file.extension() == ".svg" ? Format::svg : Format::png);
  double top = 0.0;
  for (const Panel& panel : panels) {
    draw_panel(canvas, {0.0, top, panel_width, tall}, panel);
    top += tall;
  }
  write_file(file, canvas.bytes());
}

}  // namespace
}  // namespace draw

void write_chart(const std::filesystem::path& file, const std::vector<Chart>& panels) {
  draw::write_panels(file, panels);
}

void write_tornado(const std::filesystem::path& file, const std::vector<Tornado>& panels) {
  draw::write_panels(file, panels);
}

}  // namespace dimple
