#include "io/draw/chart.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <set>
#include <stdexcept>
#include <utility>

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

/// The part of a-b inside the rectangle.
std::optional<std::pair<Vec2, Vec2>> clipped(const Vec2& a, const Vec2& b, const Rect& r) {
  double from = 0.0, to = 1.0;
  const auto cut = [&](double start, double step, double low, double high) {
    if (step == 0.0) return start >= low && start <= high;
    const double t0 = (low - start) / step, t1 = (high - start) / step;
    from = std::max(from, std::min(t0, t1));
    to = std::min(to, std::max(t0, t1));
    return from <= to;
  };
  if (!cut(a.x(), b.x() - a.x(), r.x, r.x + r.w) || !cut(a.y(), b.y() - a.y(), r.y, r.y + r.h))
    return std::nullopt;
  return std::pair<Vec2, Vec2>{from > 0.0 ? Vec2(a + from * (b - a)) : a,
                               to < 1.0 ? Vec2(a + to * (b - a)) : b};
}

double overlap(const Rect& a, const Rect& b) {
  const double w = std::min(a.x + a.w, b.x + b.w) - std::max(a.x, b.x);
  const double h = std::min(a.y + a.h, b.y + b.h) - std::max(a.y, b.y);
  return w > 0.0 && h > 0.0 ? w * h : 0.0;
}

// ----------------------------------------------------------------------------------------------------- axes

/// Numbers beyond are no measurements, and their differences would not be numbers.
constexpr double largest_shown = 1e300;

/// From values to fractions of the plot's width or height.
struct Axis {
  bool log = false;
  double low = 0.0, high = 1.0;  ///< decades on a logarithmic axis

  bool has(double value) const { return std::abs(value) <= largest_shown && (!log || value > 0.0); }
  double fraction(double value) const {
    const double f = ((log ? std::log10(value) : value) - low) / (high - low);
    return std::clamp(f, -1e4, 1e4);  // far outside; keeps what is drawn from there finite
  }
  bool shows(double value) const {
    return has(value) && fraction(value) >= -1e-9 && fraction(value) <= 1.0 + 1e-9;
  }
};

struct Tick {
  double value;
  std::string text;  ///< empty: a grid line only
};

Axis axis_of(const std::vector<double>& values, bool log, const std::optional<std::array<double, 2>>& range) {
  Axis axis{.log = log};
  if (range) {
    const auto [low, high] = *range;
    if (!axis.has(low) || !axis.has(high) || !(low < high))
      throw std::invalid_argument(
          fmt::format("an axis cannot run from {} to {}{}", low, high, log ? " logarithmically" : ""));
    return {log, log ? std::log10(low) : low, log ? std::log10(high) : high};
  }
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const double value : values) {
    if (!axis.has(value)) continue;
    low = std::min(low, log ? std::log10(value) : value);
    high = std::max(high, log ? std::log10(value) : value);
  }
  if (!(low <= high)) return axis;
  if (log) {
    const double margin = high - low > 1e-6 ? std::max(0.05 * (high - low), 0.03) : 0.5;
    return {log, low - margin, high + margin};
  }
  const double most = std::max(std::abs(low), std::abs(high));
  if (!(high - low > 1e-9 * most)) {
    const double margin = most > 1e-300 ? 0.1 * most : 1.0;
    return {log, low - margin, high + margin};
  }
  const double margin = 0.06 * (high - low);
  if (low >= 0.0 && low < 0.3 * high) return {log, 0.0, high + margin};  // zero where it is near
  if (high <= 0.0 && high > 0.3 * low) return {log, low - margin, 0.0};
  return {log, low - margin, high + margin};
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

/// At 1, 2 and 5 in every decade, or at every `stride`-th decade alone; grid lines between them.
std::vector<Tick> decade_ticks(const Axis& axis, const std::vector<int>& leads, int stride) {
  std::vector<Tick> ticks;
  const bool close = axis.high - axis.low <= 6.0;
  const int first = static_cast<int>(std::floor(axis.low)), last = static_cast<int>(std::floor(axis.high));
  for (int decade = first; decade <= last; ++decade)
    for (int lead = 1; lead <= 9; ++lead) {
      const double value = lead * std::pow(10.0, decade);
      if (!axis.shows(value)) continue;
      const bool named = decade % stride == 0 && std::find(leads.begin(), leads.end(), lead) != leads.end();
      if (named || lead == 1 || close) ticks.push_back({value, named ? plain(value, 1) : ""});
    }
  return ticks;
}

/// The most detailed ticks of which no two come nearer than `room_of` two texts in the middle of which they
/// stand.
template <class Room>
std::vector<Tick> ticks_of(const Axis& axis, double pixels, Room room_of) {
  std::vector<Tick> ticks;
  const auto fits = [&] {
    double at = -1e9, half = 0.0;
    for (const Tick& tick : ticks) {
      if (tick.text.empty()) continue;
      const double here = axis.fraction(tick.value) * pixels, own = room_of(tick.text) / 2.0;
      if (here - at < own + half) return false;
      at = here, half = own;
    }
    return true;
  };
  const auto named = [&] {
    return std::count_if(ticks.begin(), ticks.end(), [](const Tick& tick) { return !tick.text.empty(); });
  };
  if (axis.log) {
    for (const auto& leads : {std::vector<int>{1, 2, 5}, std::vector<int>{1, 3}, std::vector<int>{1}}) {
      ticks = decade_ticks(axis, leads, 1);
      if (named() >= 3 && fits()) return ticks;
    }
    if (axis.high - axis.low > 2.0) {
      int stride = 1;
      while (!fits() && stride < 700) ticks = decade_ticks(axis, {1}, ++stride);
      return ticks;
    }
  }
  const double low = axis.log ? std::pow(10.0, axis.low) : axis.low;
  const double high = axis.log ? std::pow(10.0, axis.high) : axis.high;
  for (int most = 9; most >= 2; --most) {
    ticks = even_ticks(low, high, most);
    if (fits()) break;
  }
  return ticks;
}

// --------------------------------------------------------------------------------------------------- series

/// A series as it is drawn: pixels instead of values.
struct Trace {
  const ChartSeries* series = nullptr;
  std::size_t look = 0;                   ///< number of hue and marker
  std::vector<std::vector<Vec2>> line;    ///< pieces
  std::vector<Vec2> point;                ///< inside the plot
  std::vector<const std::string*> label;  ///< of these points

  const Colour& colour() const { return hues[look % hues.size()]; }
};

constexpr double marker_radius = 5.0;

void draw_marker(Pen& pen, const Vec2& at, const Trace& trace) {
  const bool hollow = trace.series->hollow;
  const Colour fill = hollow ? card : trace.colour();
  const Edge edge = hollow ? Edge{trace.colour(), 2.0} : Edge{card, 1.0};
  const double r = hollow ? marker_radius - 0.5 : marker_radius;
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

// --------------------------------------------------------------------------------------------------- labels

/// Finds room for texts beside points: of some places the one that hides and is hidden least. No text is left
/// out. Greedy, then improved a few times; depends on the input's order alone.
class Labels {
 public:
  explicit Labels(const Rect& frame) : frame_(frame) {}

  void add_point(const Vec2& at) { points_.push_back(at); }
  void add_line(const Vec2& a, const Vec2& b) { lines_.emplace_back(a, b); }

  /// One text; `places` are where it may stand, the best first, each with its price.
  struct Place {
    Rect box;
    double price = 0.0;
  };
  void add(std::vector<Place> places) { wishes_.push_back(std::move(places)); }

  /// The box of each text, in the order of adding.
  std::vector<Rect> placed() const {
    std::vector<std::optional<Rect>> chosen(wishes_.size());
    for (int pass = 0; pass < 5; ++pass)
      for (std::size_t n = 0; n < wishes_.size(); ++n) {
        double least = std::numeric_limits<double>::infinity();
        chosen[n].reset();
        std::optional<Rect> best;
        for (const Place& place : wishes_[n]) {
          if (place.price >= least) continue;
          const double cost = place.price + trouble(place.box, chosen, least - place.price);
          if (cost < least) least = cost, best = place.box;
        }
        chosen[n] = best;
      }
    std::vector<Rect> boxes;
    for (const auto& box : chosen) boxes.push_back(box.value_or(Rect{}));
    return boxes;
  }

 private:
  double trouble(const Rect& box, const std::vector<std::optional<Rect>>& others, double limit) const {
    double sum = 0.0;
    const double inside = overlap(box, frame_);
    if (inside < box.w * box.h - 1e-6) sum += 200.0 + (box.w * box.h - inside);
    for (const auto& other : others)
      if (other && sum < limit)
        if (const double shared = overlap(box, *other); shared > 0.0) sum += 100.0 + shared;
    for (const Vec2& p : points_) {
      if (sum >= limit) return sum;
      const Rect mark{p.x() - 6.0, p.y() - 6.0, 12.0, 12.0};
      if (const double shared = overlap(box, mark); shared > 0.0) sum += 30.0 + 0.5 * shared;
    }
    for (const auto& [a, b] : lines_) {
      if (sum >= limit) return sum;
      if (const auto hit = clipped(a, b, box)) sum += 14.0 + 0.4 * (hit->second - hit->first).norm();
    }
    return sum;
  }

  Rect frame_;
  std::vector<Vec2> points_;
  std::vector<std::pair<Vec2, Vec2>> lines_;
  std::vector<std::vector<Place>> wishes_;
};

constexpr Style label_style{.size = 13.0};
constexpr double label_height = 15.0, label_baseline = 13.0;

/// Of its box; an SVG shown with a wider font that takes no advice has some room, too.
double label_width(const std::string& text, double most) {
  return std::min(1.1 * text_width(text, label_style) + 4.0, most);
}

/// Around a point, near ones first.
std::vector<Labels::Place> places_around(const Vec2& at, double w) {
  struct Way {
    double x, y;         ///< direction from the point to the box
    double left, above;  ///< the part of the box on that side of where the direction ends
  };
  static constexpr double c = 0.707;
  static constexpr std::array<Way, 12> ways{{{c, -c, 0.0, 1.0},
                                             {1.0, 0.0, 0.0, 0.5},
                                             {0.0, -1.0, 0.5, 1.0},
                                             {c, c, 0.0, 0.0},
                                             {-c, -c, 1.0, 1.0},
                                             {0.0, 1.0, 0.5, 0.0},
                                             {-1.0, 0.0, 1.0, 0.5},
                                             {-c, c, 1.0, 0.0},
                                             {0.0, -1.0, 0.2, 1.0},
                                             {0.0, 1.0, 0.2, 0.0},
                                             {0.0, -1.0, 0.8, 1.0},
                                             {0.0, 1.0, 0.8, 0.0}}};
  std::vector<Labels::Place> places;
  const double h = label_height;
  for (const double away : {7.0, 13.0, 22.0, 34.0, 48.0, 64.0, 84.0})
    for (std::size_t n = 0; n < ways.size(); ++n) {
      const Way& way = ways[n];
      places.push_back({{at.x() + away * way.x - w * way.left, at.y() + away * way.y - h * way.above, w, h},
                        0.8 * (away - 7.0) + 0.3 * static_cast<double>(n)});
    }
  return places;
}

/// At the ends of a reference line, on either side.
std::vector<Labels::Place> places_along(const Rect& plot, bool vertical, const Vec2& at, double w) {
  std::vector<Labels::Place> places;
  const double h = label_height;
  for (int row = 0; row < 5; ++row)
    for (const bool far : {false, true})
      for (const bool other : {false, true}) {
        const double price = 3.0 * row + (far ? 5.0 : 0.0) + (other ? 2.0 : 0.0);
        const double down = 4.0 + row * (h + 2.0), across = 6.0 + row * 0.16 * plot.w;
        const double x = vertical ? (other ? at.x() - 4.0 - w : at.x() + 4.0)
                                  : (far ? plot.x + across : plot.x + plot.w - across - w);
        const double y = vertical ? (far ? plot.y + plot.h - down - h : plot.y + down)
                                  : (other ? at.y() + 3.0 : at.y() - 3.0 - h);
        places.push_back({{x, y, w, h}, price});
      }
  return places;
}

// ---------------------------------------------------------------------------------------------------- chart

void check(const Chart& chart) {
  for (const ChartSeries& s : chart.series) {
    if (s.x.size() != s.y.size())
      throw std::invalid_argument(
          fmt::format("the series \"{}\" has {} x and {} y", s.name, s.x.size(), s.y.size()));
    if (!s.label.empty() && s.label.size() != s.x.size())
      throw std::invalid_argument(
          fmt::format("the series \"{}\" has {} labels for {} points", s.name, s.label.size(), s.x.size()));
  }
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
  const Colour faint = mixed(card, hairline, 0.45F);
  for (const bool named : {false, true})
    for (const Tick& tick : ticks) {
      if (tick.text.empty() == named || !axis.shows(tick.value)) continue;
      const double f = axis.fraction(tick.value);
      const Vec2 at(plot.x + f * plot.w, plot.y + (1.0 - f) * plot.h);
      const bool zero = tick.value == 0.0 && f > 1e-6 && f < 1.0 - 1e-6;
      const Colour colour = zero ? soft_ink : named ? hairline : faint;
      if (horizontal) {
        pen.line({{at.x(), plot.y}, {at.x(), plot.y + plot.h}}, 1.0, colour, false);
        if (named) pen.text({at.x(), plot.y + plot.h + 20.0}, tick.text, small, Align::centre);
      } else {
        pen.line({{plot.x, at.y()}, {plot.x + plot.w, at.y()}}, 1.0, colour, false);
        if (named) pen.text({plot.x - 9.0, at.y() + 5.0}, tick.text, small, Align::right);
      }
    }
}

/// What is not shown, in words; empty if everything is.
std::string left_out(std::size_t not_positive, std::size_t outside) {
  const auto points = [](std::size_t n) { return fmt::format("{} point{}", n, n == 1 ? "" : "s"); };
  std::string text;
  if (not_positive > 0)
    text = fmt::format("{} not shown: not positive on a logarithmic axis", points(not_positive));
  if (outside > 0)
    text += fmt::format("{}{} outside the range shown", text.empty() ? "" : "; ", points(outside));
  return text;
}

/// Where the series run in the plot.
struct Traces {
  std::vector<Trace> trace;
  std::size_t not_positive = 0, outside = 0;
};

Traces traces_of(const Chart& chart, const Axis& x, const Axis& y, const Rect& plot) {
  Traces result;
  const std::vector<std::size_t> looks = looks_of(chart.series);
  for (std::size_t n = 0; n < chart.series.size(); ++n) {
    const ChartSeries& s = chart.series[n];
    Trace trace;
    trace.series = &s;
    trace.look = looks[n];
    std::optional<Vec2> before;
    for (std::size_t i = 0; i < s.x.size(); ++i) {
      if (!x.has(s.x[i]) || !y.has(s.y[i])) {
        const bool finite = std::abs(s.x[i]) <= largest_shown && std::abs(s.y[i]) <= largest_shown;
        if (finite) ++result.not_positive;
        before.reset();
        continue;
      }
      const Vec2 at(plot.x + plot.w * x.fraction(s.x[i]), plot.y + plot.h * (1.0 - y.fraction(s.y[i])));
      if (const auto piece = before && s.line ? clipped(*before, at, plot) : std::nullopt) {
        const bool goes_on = !trace.line.empty() && trace.line.back().back() == piece->first;
        if (!goes_on) trace.line.push_back({piece->first});
        trace.line.back().push_back(piece->second);
      }
      before = at;
      if (!x.shows(s.x[i]) || !y.shows(s.y[i])) {
        ++result.outside;
        continue;
      }
      trace.point.push_back(at);
      trace.label.push_back(s.label.empty() ? nullptr : &s.label[i]);
    }
    result.trace.push_back(std::move(trace));
  }
  return result;
}

void draw_lines_and_labels(Pen& pen, const Rect& plot, const Chart& chart, const Axis& x, const Axis& y,
                           const std::vector<Trace>& traces) {
  Labels labels(plot.inset(2.0, 2.0, 2.0, 2.0));
  const double widest = 0.45 * plot.w;
  struct Text {
    const std::string* text;
    Style style;
    std::optional<Vec2> at;  ///< the point, for a leader
  };
  std::vector<Text> texts;

  for (const Trace& trace : traces) {
    for (const auto& piece : trace.line)
      for (std::size_t i = 1; i < piece.size(); ++i) labels.add_line(piece[i - 1], piece[i]);
    for (const Vec2& at : trace.point) labels.add_point(at);
  }
  for (const ChartLine& line : chart.lines) {
    const Axis& axis = line.vertical ? x : y;
    if (!axis.shows(line.at)) continue;
    const double f = axis.fraction(line.at);
    const Vec2 at(plot.x + f * plot.w, plot.y + (1.0 - f) * plot.h);
    const Vec2 a = line.vertical ? Vec2(at.x(), plot.y) : Vec2(plot.x, at.y());
    const Vec2 b = line.vertical ? Vec2(at.x(), plot.y + plot.h) : Vec2(plot.x + plot.w, at.y());
    pen.line({a, b}, 1.4, soft_ink, true);
    labels.add_line(a, b);
    if (line.text.empty()) continue;
    labels.add(places_along(plot, line.vertical, at, label_width(line.text, widest)));
    texts.push_back({&line.text, {.size = label_style.size, .colour = soft_ink, .bold = true}, std::nullopt});
  }
  for (const Trace& trace : traces)
    for (std::size_t i = 0; i < trace.point.size(); ++i) {
      if (trace.label[i] == nullptr || trace.label[i]->empty()) continue;
      labels.add(places_around(trace.point[i], label_width(*trace.label[i], widest)));
      texts.push_back({trace.label[i],
                       {.size = label_style.size, .colour = mixed(trace.colour(), ink, 0.35F)},
                       trace.point[i]});
    }
  const std::vector<Rect> boxes = labels.placed();

  for (std::size_t n = 0; n < boxes.size(); ++n) {  // leaders below everything else
    if (!texts[n].at) continue;
    const Vec2 at = *texts[n].at;
    const Rect& b = boxes[n];
    const Vec2 near(std::clamp(at.x(), b.x + 1.0, b.x + b.w - 1.0),
                    std::clamp(at.y(), b.y + 2.0, b.y + b.h - 2.0));
    if ((near - at).norm() > 16.0) pen.line({at, near}, 0.8, mixed(texts[n].style.colour, card, 0.4F), false);
  }
  for (const Trace& trace : traces)
    for (const auto& piece : trace.line) pen.line(piece, 2.2, trace.colour(), trace.series->dashed);
  for (const Trace& trace : traces)
    for (const Vec2& at : trace.point) {
      if (trace.series->markers)
        draw_marker(pen, at, trace);
      else if (trace.series->line && trace.line.empty())
        pen.disc(at, 1.6, trace.colour(), {trace.colour(), 0.0});  // a line of one point
    }
  for (std::size_t n = 0; n < boxes.size(); ++n)
    pen.text({boxes[n].x + boxes[n].w / 2.0, boxes[n].y + label_baseline}, *texts[n].text, texts[n].style,
             Align::centre, widest);
}

void draw_panel(Pen& pen, const Rect& tile, const Chart& chart) {
  std::vector<double> xs, ys;
  const Axis any_x{.log = chart.log_x}, any_y{.log = chart.log_y};
  for (const ChartSeries& s : chart.series)
    for (std::size_t i = 0; i < s.x.size(); ++i)
      if (any_x.has(s.x[i]) && any_y.has(s.y[i])) xs.push_back(s.x[i]), ys.push_back(s.y[i]);
  const bool empty = xs.empty();
  for (const ChartLine& line : chart.lines) (line.vertical ? xs : ys).push_back(line.at);
  const Axis x = axis_of(xs, chart.log_x, chart.x_range), y = axis_of(ys, chart.log_y, chart.y_range);

  // From the outside in: the texts above and below leave the height, the numbers of y the width.
  const Rect room = card_with_title(pen, tile, chart.title, chart.subtitle);
  const LegendPlan legend = plan_legend(chart, room);
  const double above = chart.y_label.empty() ? 14.0 : 36.0;
  const double legend_height = legend.rows > 0 ? static_cast<double>(legend.rows) * legend_row + 8.0 : 0.0;
  const auto below = [&](bool with_note) {
    return 28.0 + (chart.x_label.empty() ? 0.0 : 24.0) + (with_note ? 20.0 : 0.0) + legend_height;
  };
  const Traces counted = traces_of(chart, x, y, room);  // how many are left out does not depend on the plot
  const std::string words = left_out(counted.not_positive, counted.outside);
  Rect plot =
      room.inset(0.0, above, legend.on_the_right ? legend.column + 24.0 : 20.0, below(!words.empty()));
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
  double baseline = foot + 20.0;
  if (!chart.x_label.empty())
    pen.text({plot.x + plot.w / 2.0, baseline += 24.0}, chart.x_label, small, Align::centre, plot.w);
  if (!words.empty()) pen.text({room.x, baseline += 21.0}, words, note, Align::left, room.w);

  const Traces traces = traces_of(chart, x, y, plot);
  draw_lines_and_labels(pen, plot, chart, x, y, traces.trace);
  if (empty) say_in_the_middle(pen, plot, "no data");
  draw_legend(pen, room, plot, legend, traces.trace);
}

// -------------------------------------------------------------------------------------------------- tornado

void check(const Tornado& tornado) {
  for (const Tornado::Row& row : tornado.rows)
    if (!(std::abs(row.low) <= largest_shown) || !(std::abs(row.high) <= largest_shown))
      throw std::invalid_argument(fmt::format("the bar \"{}\" ends nowhere", row.name));
}

void draw_panel(Pen& pen, const Rect& tile, const Tornado& tornado) {
  const Rect room = card_with_title(pen, tile, tornado.title, tornado.subtitle);
  constexpr double names = 430.0, numbers = 70.0, most_row = 46.0;
  const double legend_height = tornado.legend.empty() ? 0.0 : legend_row + 6.0;
  Rect plot = room.inset(names, 16.0, 12.0, 58.0 + legend_height);
  if (tornado.rows.empty()) return say_in_the_middle(pen, room, "no data");

  std::vector<double> values = {0.0, -tornado.shade, tornado.shade};
  for (const Tornado::Row& row : tornado.rows) values.insert(values.end(), {row.low, row.high});
  Axis axis = axis_of(values, false, std::nullopt);
  // Room for the numbers at the ends of the bars.
  const double margin = numbers / plot.w * (axis.high - axis.low);
  axis.low = std::min(axis.low, *std::min_element(values.begin(), values.end()) - margin);
  axis.high = std::max(axis.high, *std::max_element(values.begin(), values.end()) + margin);
  const double height = std::min(plot.h / static_cast<double>(tornado.rows.size()), most_row);
  plot.h = height * static_cast<double>(tornado.rows.size());
  const auto across = [&](double value) { return plot.x + axis.fraction(value) * plot.w; };
  if (tornado.shade > 0.0)
    pen.rectangle({across(-tornado.shade), plot.y, across(tornado.shade) - across(-tornado.shade), plot.h},
                  mixed(card, hairline, 0.55F), 0.0);
  draw_grid(pen, plot, axis,
            ticks_of(axis, plot.w, [](const std::string& text) { return text_width(text, small) + 18.0; }),
            true);
  for (std::size_t r = 0; r < tornado.rows.size(); ++r) {
    const Tornado::Row& row = tornado.rows[r];
    const double middle = plot.y + (static_cast<double>(r) + 0.5) * height;
    const bool two_lines = height >= 34.0;
    const Style bold{.size = 14.0, .bold = true};
    if (two_lines || row.note.empty()) {
      pen.text({plot.x - 14.0, middle + (row.note.empty() ? 5.0 : -2.0)}, row.name, bold, Align::right,
               names - 16.0);
      pen.text({plot.x - 14.0, middle + 14.0}, row.note, note, Align::right, names - 16.0);
    } else {
      pen.text({plot.x - 14.0, middle + 5.0}, fmt::format("{}: {}", row.name, row.note), small, Align::right,
               names - 16.0);
    }
    const double low = std::min(row.low, 0.0), high = std::max(row.high, 0.0),
                 thick = std::min(0.62 * height, 24.0);
    const auto number = static_cast<std::size_t>(std::max(row.colour, 0));
    pen.rectangle({across(low), middle - thick / 2.0, std::max(across(high) - across(low), 2.0), thick},
                  hues[number % hues.size()], 2.0);
    const auto text = [](double value) { return fmt::format("{:+.1f}", value); };
    if (row.low < 0.0 || row.high <= 0.0)
      pen.text({across(low) - 6.0, middle + 5.0}, text(row.low), small, Align::right);
    if (row.high > 0.0) pen.text({across(high) + 6.0, middle + 5.0}, text(row.high), small, Align::left);
  }
  pen.line({{across(0.0), plot.y}, {across(0.0), plot.y + plot.h}}, 1.4, soft_ink, false);
  double baseline = plot.y + plot.h + 44.0;
  pen.text({plot.x + plot.w / 2.0, baseline}, tornado.x_label, small, Align::centre, plot.w);
  if (tornado.shade > 0.0) pen.text({room.x, baseline}, tornado.shade_text, note, Align::left, names - 20.0);
  double x = room.x;
  baseline += legend_row;
  for (const auto& [colour, meaning] : tornado.legend) {
    const auto number = static_cast<std::size_t>(std::max(colour, 0));
    pen.rectangle({x, baseline - 12.0, 14.0, 14.0}, hues[number % hues.size()], 2.0);
    pen.text({x + 20.0, baseline}, meaning, small, Align::left);
    x += 20.0 + text_width(meaning, small) + 26.0;
  }
}

// ----------------------------------------------------------------------------------------------------- both

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
  const std::unique_ptr<Pen> pen = make_pen(across * panel_width, down * panel_height);
  for (int n = 0; n < count; ++n) {
    const Rect tile{static_cast<double>(n % across) * panel_width,
                    static_cast<double>(n / across) * panel_height, panel_width, panel_height};
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
