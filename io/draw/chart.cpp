#include "io/draw/chart.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <utility>

#include "io/digits.hpp"
#include "io/draw/canvas.hpp"
#include "io/draw/pen.hpp"

// No library draws this: VTK's charts need its renderer, which aborts the process where there is no display.

namespace dimple {

namespace {

using namespace draw;

constexpr int panel_width = 1000, panel_height = 650;

// Hues that the common colour-vision deficiencies keep apart, after Okabe and Ito.
constexpr std::array<Colour, 8> hues{rgb(0x0072B2), rgb(0xD55E00), rgb(0x009E73), rgb(0xB5588F),
                                     rgb(0xD99100), rgb(0x4AA3D9), rgb(0x3A4654), rgb(0x7A1F4B)};

constexpr Style small{.size = 14.0}, soft{.size = 14.0, .colour = soft_ink},
    note{.size = 13.0, .colour = soft_ink};

// -------------------------------------------------------------------------------------------------- layout

/// A white card with title and subtitle; returns the room that is left.
Rect card_with_title(Pen& pen, const Rect& tile, const std::string& title,
                     const std::vector<std::string>& subtitle) {
  const Rect r = tile.inset(8.0, 8.0, 8.0, 8.0);
  pen.rectangle({r.x - 1.0, r.y - 1.0, r.w + 2.0, r.h + 2.0}, hairline, 9.0);
  pen.rectangle(r, card, 8.0);
  Rect room = r.inset(22.0, 14.0, 22.0, 16.0);
  const auto put = [&](const std::string& text, const Style& style, std::size_t most_rows, double row) {
    std::vector<std::string> rows = wrapped(text.substr(0, 2000), room.w, style);
    const bool cut = rows.size() > most_rows || text.size() > 2000;
    if (rows.size() > most_rows) rows.resize(most_rows);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      room = room.inset(0.0, row, 0.0, 0.0);
      pen.text({room.x, room.y - 5.0}, cut && i + 1 == rows.size() ? rows[i] + " ..." : rows[i], style,
               Align::left, room.w);
    }
  };
  put(title, {.size = 19.0, .bold = true}, 2, 25.0);
  constexpr std::size_t most_lines = 6;
  for (std::size_t i = 0; i < std::min(subtitle.size(), most_lines); ++i) put(subtitle[i], soft, 2, 19.0);
  return room;
}

void say_in_the_middle(Pen& pen, const Rect& room, const std::string& text) {
  pen.text({room.x + room.w / 2.0, room.y + room.h / 2.0}, text, {.size = 18.0, .colour = soft_ink},
           Align::centre);
}

// ----------------------------------------------------------------------------------------------------- axes

/// Numbers beyond are no measurements, and their differences would not be numbers.
constexpr double largest_shown = 1e300;

bool is_shown(double value) {
  return std::abs(value) <= largest_shown;
}

/// From values to fractions of the plot's width or height.
struct Axis {
  double low = 0.0, high = 1.0;
  double fraction(double value) const { return (value - low) / (high - low); }
};

struct Tick {
  double value;
  std::string text;
};

Axis axis_of(const std::vector<double>& values) {
  if (values.empty()) return {};
  const auto [least, largest] = std::minmax_element(values.begin(), values.end());
  const double low = *least, high = *largest, most = std::max(std::abs(low), std::abs(high));
  if (!(high - low > 1e-9 * most)) {
    const double margin = most > 1e-300 ? 0.1 * most : 1.0;
    return {low - margin, high + margin};
  }
  const double margin = 0.06 * (high - low);
  if (low >= 0.0 && low < 0.3 * high) return {0.0, high + margin};  // zero where it is near
  if (high <= 0.0 && high > 0.3 * low) return {low - margin, 0.0};
  return {low - margin, high + margin};
}

/// Short without being cryptic: 0.002, 50, 20000; else 2e-7. `digits` are significant.
std::string plain(double value, int digits) {
  if (value == 0.0) return "0";
  const double size = std::abs(value);
  if (size >= 9.99e-5 && size < 9.99e5) {
    const int decimals = digits - 1 - static_cast<int>(std::floor(std::log10(size) + 1e-9));
    std::string text = fmt::format("{:.{}f}", value, std::clamp(decimals, 0, 12));
    if (text.find('.') != std::string::npos) {
      while (text.back() == '0') text.pop_back();
      if (text.back() == '.') text.pop_back();
    }
    return text;
  }
  std::string text = fmt::format("{:.{}e}", value, digits - 1);
  const std::size_t e = text.find('e');
  std::string lead = text.substr(0, e);
  if (lead.find('.') != std::string::npos) {
    while (lead.back() == '0') lead.pop_back();
    if (lead.back() == '.') lead.pop_back();
  }
  return fmt::format("{}e{}", lead, std::stoi(text.substr(e + 1)));
}

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
    ticks.push_back({value, decimals ? tick_text(value, step) : plain(value, digits)});
  }
  return ticks;
}

/// The most ticks of which no two come nearer than `room_of` two texts in the middle of which they stand.
template <class Room>
std::vector<Tick> ticks_of(const Axis& axis, double pixels, Room room_of) {
  std::vector<Tick> ticks;
  const auto fits = [&] {
    double at = -1e9, half = 0.0;
    for (const Tick& tick : ticks) {
      const double here = axis.fraction(tick.value) * pixels, own = room_of(tick.text) / 2.0;
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

// --------------------------------------------------------------------------------------------------- series

/// A series as it is drawn: pixels instead of values.
struct Trace {
  const ChartSeries* series = nullptr;
  std::size_t look = 0;                 ///< number of hue and marker
  std::vector<std::vector<Vec2>> line;  ///< pieces
  std::vector<Vec2> point;

  const Colour& colour() const { return hues[look % hues.size()]; }
};

constexpr double marker_radius = 5.0;

void draw_marker(Pen& pen, const Vec2& at, const Trace& trace) {
  const Colour fill = trace.colour();
  const Edge edge{card, 1.0};
  constexpr double r = marker_radius;
  const auto shape = [&](std::initializer_list<Vec2> corners) {
    std::vector<Vec2> moved;
    for (const Vec2& corner : corners) moved.emplace_back(at + r * corner);
    pen.polygon(moved, fill, edge);
  };
  switch (trace.look % 7) {  // not a divisor of the number of hues: look 8 has the hue of 0, another marker
    case 0:
      return pen.disc(at, r, fill, edge);
    case 1:
      return shape({{-0.9, -0.9}, {0.9, -0.9}, {0.9, 0.9}, {-0.9, 0.9}});
    case 2:
      return shape({{0.0, -1.25}, {1.15, 0.85}, {-1.15, 0.85}});
    case 3:
      return shape({{0.0, -1.3}, {1.3, 0.0}, {0.0, 1.3}, {-1.3, 0.0}});
    case 4:
      return shape({{-1.15, -0.85}, {1.15, -0.85}, {0.0, 1.25}});
    case 5:
      return shape({{-0.5, -1.1}, {0.5, -1.1}, {1.1, 0.0}, {0.5, 1.1}, {-0.5, 1.1}, {-1.1, 0.0}});
    default:
      return shape({{-1.25, -0.6}, {1.25, -0.6}, {1.25, 0.6}, {-1.25, 0.6}});
  }
}

/// Asked-for numbers as they are; the others count up past them.
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

// ---------------------------------------------------------------------------------------------------- chart

void check(const Chart& chart) {
  for (const ChartSeries& s : chart.series)
    if (s.x.size() != s.y.size())
      throw std::invalid_argument(
          fmt::format("the series \"{}\" has {} x and {} y", s.name, s.x.size(), s.y.size()));
}

/// Where the legend goes: rows below the plot if a few do, else a column on its right.
struct LegendPlan {
  std::vector<std::size_t> entry;   ///< series with a name
  std::vector<std::size_t> row_of;  ///< below
  std::vector<double> width;
  std::size_t rows = 0, left_out = 0;
  bool on_the_right = false;
  double column = 0.0;  ///< width of the right one
};

constexpr double legend_mark = 40.0, legend_gap = 26.0, legend_row = 22.0;

LegendPlan plan_legend(const Chart& chart, const Rect& room) {
  LegendPlan plan;
  for (std::size_t n = 0; n < chart.series.size(); ++n)
    if (!chart.series[n].name.empty()) plan.entry.push_back(n);
  double all = 0.0, widest = 0.0;
  for (const std::size_t n : plan.entry) {
    const double w = std::min(legend_mark + text_width(chart.series[n].name, small), room.w);
    all += w + legend_gap;
    widest = std::max(widest, w);
    plan.width.push_back(w);
  }
  std::size_t columns = plan.entry.size();
  if (all - legend_gap > room.w) {  // several rows: their entries stand below each other
    columns = static_cast<std::size_t>(std::max((room.w + legend_gap) / (widest + legend_gap), 1.0));
    plan.width.assign(plan.entry.size(), widest);
  }
  if (!plan.entry.empty()) plan.rows = (plan.entry.size() - 1) / columns + 1;
  for (std::size_t i = 0; i < plan.entry.size(); ++i) plan.row_of.push_back(i / columns);
  const auto height = static_cast<double>(plan.entry.size()) * legend_row;
  if (plan.rows > 2 && widest <= 320.0 && height <= room.h - 90.0) {
    plan.on_the_right = true;
    plan.column = widest;
    plan.rows = 0;
  }
  constexpr std::size_t most_rows = 9;
  if (plan.rows > most_rows) {
    plan.rows = most_rows;
    while (plan.row_of.back() + 1 >= most_rows) {
      ++plan.left_out;
      plan.entry.pop_back();
      plan.row_of.pop_back();
    }
  }
  return plan;
}

/// The sample stands left of `at`, which is on the name's baseline.
void draw_entry(Pen& pen, const Vec2& at, double room, const Trace& trace) {
  const Vec2 mark = at + Vec2(15.0, -5.0);
  if (trace.series->line)
    pen.line({mark - Vec2(14.0, 0.0), mark + Vec2(14.0, 0.0)}, 2.2, trace.colour(), trace.series->dashed);
  if (trace.series->markers) draw_marker(pen, mark, trace);
  pen.text(at + Vec2(legend_mark - 4.0, 0.0), trace.series->name, small, Align::left,
           room - legend_mark + 8.0);
}

void draw_legend(Pen& pen, const Rect& room, const Rect& plot, const LegendPlan& plan,
                 const std::vector<Trace>& traces) {
  Vec2 at(plot.x + plot.w + 24.0, plot.y + 16.0);
  std::size_t row = plan.rows;  // none yet
  for (std::size_t i = 0; i < plan.entry.size(); ++i) {
    if (!plan.on_the_right && plan.row_of[i] != row) {
      row = plan.row_of[i];
      const auto up = static_cast<double>(plan.rows - row - 1) * legend_row;
      at = Vec2(room.x, room.y + room.h - 4.0 - up);
    }
    draw_entry(pen, at, plan.on_the_right ? plan.column : room.w, traces[plan.entry[i]]);
    at += plan.on_the_right ? Vec2(0.0, legend_row) : Vec2(plan.width[i] + legend_gap, 0.0);
  }
  if (plan.left_out > 0)
    pen.text({room.x, room.y + room.h - 4.0}, fmt::format("... and {} more series", plan.left_out), note,
             Align::left);
}

void draw_grid(Pen& pen, const Rect& plot, const Axis& axis, const std::vector<Tick>& ticks,
               bool horizontal) {
  for (const Tick& tick : ticks) {
    const double f = axis.fraction(tick.value);
    if (f < -1e-9 || f > 1.0 + 1e-9) continue;
    const Vec2 at(plot.x + f * plot.w, plot.y + (1.0 - f) * plot.h);
    const Colour colour = tick.value == 0.0 && f > 1e-6 && f < 1.0 - 1e-6 ? soft_ink : hairline;
    if (horizontal) {
      pen.line({{at.x(), plot.y}, {at.x(), plot.y + plot.h}}, 1.0, colour, false);
      pen.text({at.x(), plot.y + plot.h + 20.0}, tick.text, small, Align::centre);
    } else {
      pen.line({{plot.x, at.y()}, {plot.x + plot.w, at.y()}}, 1.0, colour, false);
      pen.text({plot.x - 9.0, at.y() + 5.0}, tick.text, small, Align::right);
    }
  }
}

/// Where the series run in the plot.
std::vector<Trace> traces_of(const Chart& chart, const Axis& x, const Axis& y, const Rect& plot) {
  std::vector<Trace> traces;
  const std::vector<std::size_t> looks = looks_of(chart.series);
  for (std::size_t n = 0; n < chart.series.size(); ++n) {
    const ChartSeries& s = chart.series[n];
    Trace trace;
    trace.series = &s;
    trace.look = looks[n];
    bool goes_on = false;
    for (std::size_t i = 0; i < s.x.size(); ++i) {
      if (!is_shown(s.x[i]) || !is_shown(s.y[i])) {
        goes_on = false;
        continue;
      }
      trace.point.emplace_back(plot.x + plot.w * x.fraction(s.x[i]),
                               plot.y + plot.h * (1.0 - y.fraction(s.y[i])));
      if (!goes_on) trace.line.emplace_back();
      trace.line.back().push_back(trace.point.back());
      goes_on = true;
    }
    std::erase_if(trace.line, [&](const auto& piece) { return !s.line || piece.size() < 2; });
    traces.push_back(std::move(trace));
  }
  return traces;
}

void draw_traces(Pen& pen, const std::vector<Trace>& traces) {
  for (const Trace& trace : traces)
    for (const auto& piece : trace.line) pen.line(piece, 2.2, trace.colour(), trace.series->dashed);
  for (const Trace& trace : traces)
    for (const Vec2& at : trace.point) {
      if (trace.series->markers)
        draw_marker(pen, at, trace);
      else if (trace.series->line && trace.line.empty())
        pen.disc(at, 1.6, trace.colour(), {trace.colour(), 0.0});  // a line of one point
    }
}

void draw_panel(Pen& pen, const Rect& tile, const Chart& chart) {
  std::vector<double> xs, ys;
  for (const ChartSeries& series : chart.series)
    for (std::size_t i = 0; i < series.x.size(); ++i)
      if (is_shown(series.x[i]) && is_shown(series.y[i]))
        xs.push_back(series.x[i]), ys.push_back(series.y[i]);
  const Axis x = axis_of(xs), y = axis_of(ys);

  // From the outside in: the texts above and below leave the height, the numbers of y the width.
  const Rect room = card_with_title(pen, tile, chart.title, chart.subtitle);
  const LegendPlan legend = plan_legend(chart, room);
  const double above = chart.y_label.empty() ? 14.0 : 36.0;
  const double legend_height = legend.rows > 0 ? static_cast<double>(legend.rows) * legend_row + 8.0 : 0.0;
  const double below = 28.0 + (chart.x_label.empty() ? 0.0 : 24.0) + legend_height;
  Rect plot = room.inset(0.0, above, legend.on_the_right ? legend.column + 24.0 : 20.0, below);
  const auto y_ticks = ticks_of(y, plot.h, [](const std::string&) { return 24.0; });
  double numbers = 0.0;
  for (const Tick& tick : y_ticks) numbers = std::max(numbers, text_width(tick.text, small));
  plot = plot.inset(numbers + 12.0, 0.0, 0.0, 0.0);
  const auto x_ticks =
      ticks_of(x, plot.w, [](const std::string& text) { return text_width(text, small) + 18.0; });

  draw_grid(pen, plot, x, x_ticks, true);
  draw_grid(pen, plot, y, y_ticks, false);
  const double right = plot.x + plot.w, foot = plot.y + plot.h;
  pen.line({{plot.x, plot.y}, {right, plot.y}, {right, foot}}, 1.0, hairline, false);
  pen.line({{plot.x, plot.y}, {plot.x, foot}, {right, foot}}, 1.4, soft_ink, false);
  pen.text({room.x, plot.y - 14.0}, chart.y_label, small, Align::left, room.w);
  if (!chart.x_label.empty())
    pen.text({plot.x + plot.w / 2.0, foot + 44.0}, chart.x_label, small, Align::centre, plot.w);

  const std::vector<Trace> traces = traces_of(chart, x, y, plot);
  draw_traces(pen, traces);
  if (xs.empty()) say_in_the_middle(pen, plot, "no data");
  draw_legend(pen, room, plot, legend, traces);
}

// -------------------------------------------------------------------------------------------------- tornado

void check(const Tornado& tornado) {
  for (const Tornado::Row& row : tornado.rows)
    if (!(std::abs(row.low) <= largest_shown) || !(std::abs(row.high) <= largest_shown))
      throw std::invalid_argument(fmt::format("the bar \"{}\" ends nowhere", row.name));
}

constexpr double most_row = 46.0, two_lines_row = 34.0;
const Colour shade_grey = mixed(card, hairline, 0.55F);

/// What a panel of that size has for the rows, and beside them for their names.
Rect plot_of(const Rect& room, const Tornado& tornado) {
  const bool has_legend = !tornado.legend.empty() || tornado.shade > 0.0;
  return room.inset(0.0, 16.0, 12.0, 58.0 + (has_legend ? legend_row + 6.0 : 0.0));
}

double row_height(const Rect& plot, const Tornado& tornado) {
  return std::min(plot.h / static_cast<double>(tornado.rows.size()), most_row);
}

/// A panel ends below its rows.
double height_of(const Tornado& tornado) {
  constexpr Rect most{0.0, 0.0, panel_width, panel_height};
  if (tornado.rows.empty()) return most.h;
  const Rect plot =
      plot_of(card_with_title(*raster_pen(1, 1), most, tornado.title, tornado.subtitle), tornado);
  return std::ceil(most.h - plot.h + row_height(plot, tornado) * static_cast<double>(tornado.rows.size()));
}

std::string in_one_line(const Tornado::Row& row) {
  return fmt::format("{}: {}", row.name, row.note);
}

void draw_panel(Pen& pen, const Rect& tile, const Tornado& tornado) {
  const Rect room = card_with_title(pen, tile, tornado.title, tornado.subtitle);
  if (tornado.rows.empty()) return say_in_the_middle(pen, room, "no data");
  Rect plot = plot_of(room, tornado);
  const double height = row_height(plot, tornado);
  const bool two_lines = height >= two_lines_row;
  const Style bold{.size = 14.0, .bold = true};
  constexpr double most_names = 430.0, numbers = 70.0;
  double names = 0.0;  // as wide as the widest
  for (const Tornado::Row& row : tornado.rows)
    names = std::max(names, two_lines || row.note.empty()
                                ? std::max(text_width(row.name, bold), text_width(row.note, note))
                                : text_width(in_one_line(row), small));
  names = std::min(names + 20.0, most_names);
  plot = plot.inset(names, 0.0, 0.0, 0.0);

  std::vector<double> values = {0.0, -tornado.shade, tornado.shade};
  for (const Tornado::Row& row : tornado.rows) values.insert(values.end(), {row.low, row.high});
  Axis axis = axis_of(values);
  // Room for the numbers at the ends of the bars.
  const double margin = numbers / plot.w * (axis.high - axis.low);
  axis.low = std::min(axis.low, *std::min_element(values.begin(), values.end()) - margin);
  axis.high = std::max(axis.high, *std::max_element(values.begin(), values.end()) + margin);
  plot.h = height * static_cast<double>(tornado.rows.size());
  const auto across = [&](double value) { return plot.x + axis.fraction(value) * plot.w; };
  if (tornado.shade > 0.0)
    pen.rectangle({across(-tornado.shade), plot.y, across(tornado.shade) - across(-tornado.shade), plot.h},
                  shade_grey, 0.0);
  draw_grid(pen, plot, axis,
            ticks_of(axis, plot.w, [](const std::string& text) { return text_width(text, small) + 18.0; }),
            true);
  for (std::size_t r = 0; r < tornado.rows.size(); ++r) {
    const Tornado::Row& row = tornado.rows[r];
    const double middle = plot.y + (static_cast<double>(r) + 0.5) * height;
    if (two_lines || row.note.empty()) {
      pen.text({plot.x - 14.0, middle + (row.note.empty() ? 5.0 : -2.0)}, row.name, bold, Align::right,
               names - 16.0);
      pen.text({plot.x - 14.0, middle + 14.0}, row.note, note, Align::right, names - 16.0);
    } else {
      pen.text({plot.x - 14.0, middle + 5.0}, in_one_line(row), small, Align::right, names - 16.0);
    }
    const double low = std::min(row.low, 0.0), high = std::max(row.high, 0.0),
                 thick = std::min(0.62 * height, 24.0);
    const auto number = static_cast<std::size_t>(std::max(row.colour, 0));
    pen.rectangle({across(low), middle - thick / 2.0, std::max(across(high) - across(low), 2.0), thick},
                  hues[number % hues.size()], 2.0);
    if (row.low < 0.0 || row.high <= 0.0)
      pen.text({across(low) - 6.0, middle + 5.0}, with_sign(row.low), small, Align::right);
    if (row.high > 0.0) pen.text({across(high) + 6.0, middle + 5.0}, with_sign(row.high), small, Align::left);
  }
  pen.line({{across(0.0), plot.y}, {across(0.0), plot.y + plot.h}}, 1.4, soft_ink, false);
  double baseline = plot.y + plot.h + 44.0;
  pen.text({plot.x + plot.w / 2.0, baseline}, tornado.x_label, small, Align::centre, plot.w);
  double x = room.x;
  baseline += legend_row;
  const auto add = [&](const Colour& colour, const std::string& meaning) {
    pen.rectangle({x, baseline - 12.0, 14.0, 14.0}, colour, 2.0);
    pen.text({x + 20.0, baseline}, meaning, small, Align::left);
    x += 20.0 + text_width(meaning, small) + 26.0;
  };
  for (const auto& [colour, meaning] : tornado.legend)
    add(hues[static_cast<std::size_t>(std::max(colour, 0)) % hues.size()], meaning);
  if (tornado.shade > 0.0) add(shade_grey, tornado.shade_text);
}

// ----------------------------------------------------------------------------------------------------- both

double height_of(const Chart&) {
  return panel_height;
}

template <class Panel, class Draw>
void write_panels(const std::filesystem::path& file, const std::vector<Panel>& panels, int columns,
                  std::unique_ptr<Pen> (*make_pen)(int, int), Draw draw_one) {
  constexpr std::size_t most_panels = 40;
  if (columns < 1) throw std::invalid_argument(fmt::format("panels in {} columns", columns));
  if (panels.empty() || panels.size() > most_panels)
    throw std::invalid_argument(
        fmt::format("{} panels; from 1 to {} make a picture", panels.size(), most_panels));
  for (const Panel& panel : panels) check(panel);
  const int count = static_cast<int>(panels.size()), across = std::min(columns, count);
  const int down = (count + across - 1) / across;
  double tall = 0.0;
  for (const Panel& panel : panels) tall = std::max(tall, height_of(panel));
  const std::unique_ptr<Pen> pen = make_pen(across * panel_width, down * static_cast<int>(tall));
  for (int n = 0; n < count; ++n) {
    const Rect tile{static_cast<double>(n % across) * panel_width, static_cast<double>(n / across) * tall,
                    panel_width, tall};
    draw_one(*pen, tile, panels[static_cast<std::size_t>(n)]);
  }
  pen->write(file);
}

void write_charts(const std::filesystem::path& file, const std::vector<Chart>& panels, int columns,
                  std::unique_ptr<Pen> (*make_pen)(int, int)) {
  write_panels(file, panels, columns, make_pen,
               [](Pen& pen, const Rect& tile, const Chart& chart) { draw_panel(pen, tile, chart); });
}

void write_tornados(const std::filesystem::path& file, const std::vector<Tornado>& panels, int columns,
                    std::unique_ptr<Pen> (*make_pen)(int, int)) {
  write_panels(file, panels, columns, make_pen,
               [](Pen& pen, const Rect& tile, const Tornado& tornado) { draw_panel(pen, tile, tornado); });
}

}  // namespace

void write_chart_png(const std::filesystem::path& file, const std::vector<Chart>& panels, int columns) {
  write_charts(file, panels, columns, raster_pen);
}

void write_chart_svg(const std::filesystem::path& file, const std::vector<Chart>& panels, int columns) {
  write_charts(file, panels, columns, svg_pen);
}

void write_tornado_png(const std::filesystem::path& file, const std::vector<Tornado>& panels, int columns) {
  write_tornados(file, panels, columns, raster_pen);
}

void write_tornado_svg(const std::filesystem::path& file, const std::vector<Tornado>& panels, int columns) {
  write_tornados(file, panels, columns, svg_pen);
}

}  // namespace dimple
