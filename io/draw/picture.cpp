#include "io/draw/picture.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <future>
#include <limits>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <utility>

#include "io/draw/body_frame.hpp"
#include "io/draw/canvas.hpp"
#include "io/words.hpp"

// No library draws this: io/draw/canvas.hpp says why.

namespace dimple {

namespace {

using namespace draw;

constexpr int width = 1600;
constexpr int height = 1200;

// Hues that the common colour-vision deficiencies keep apart; the lightness differs as well.
const Colour interior = rgb(0xB9C8D8), base = rgb(0x1560A0), circle = rgb(0xE8590C), cross = rgb(0x8794A4),
             curve = rgb(0x1560A0), band = rgb(0xBCD5EA), other_curve = rgb(0x00805E),
             node_dot = rgb(0x6F8AA6), tool_metal = rgb(0x4F9DA6), tool_fill = rgb(0xDCECEE),
             tool_ink = rgb(0x1F6F78), wall_ink = rgb(0x6B4FA0), warning_ink = rgb(0x8A4B00),
             warning_fill = rgb(0xFFF3DC);

bool is_base(int set) {
  return (set & 1) != 0;
}
bool is_circle(int set) {
  return (set & 2) != 0;
}
const Colour& colour_of(int set) {
  return is_circle(set) ? circle : is_base(set) ? base : interior;
}

/// Pale to dark through yellow, red and purple: the lightness falls evenly, so it also reads in grey.
Colour heat(double fraction) {
  static const std::array<Colour, 7> stops{rgb(0xECEBE6), rgb(0xF9DFA3), rgb(0xF9B768), rgb(0xEE7F52),
                                           rgb(0xCB4A5C), rgb(0x8C2B6B), rgb(0x47175A)};
  const double t = std::clamp(fraction, 0.0, 1.0) * (static_cast<double>(stops.size()) - 1.0);
  const std::size_t i = std::min<std::size_t>(static_cast<std::size_t>(t), stops.size() - 2);
  const auto f = static_cast<float>(t - static_cast<double>(i));
  return mixed(stops[i], stops[i + 1], f);
}

// -------------------------------------------------------------------------------------------------- numbers

struct Scale {
  double factor;
  std::string unit;
};

/// The unit of an axis up to `largest` newtons.
Scale force_scale(double largest_N) {
  const Written written = force_written(largest_N);
  return {written.per_unit, written.unit};
}

// ----------------------------------------------------------------------------------------------------- view

/// A view without perspective: right, up and toward the viewer.
struct Camera {
  Vec3 right, up, toward;
  Vec3 seen(const Vec3& p) const { return {right.dot(p), up.dot(p), toward.dot(p)}; }
};

bool usable(const Vec3& p) {
  return p.allFinite();
}

BodyFrame frame_of(const Overview& o) {
  return body_frame(o.nodes_mm, o.centre_mm, o.push);
}

/// From above the horizon by `elevation` degrees and turned by `azimuth` degrees about the push.
Camera camera(const BodyFrame& f, double elevation, double azimuth) {
  const double e = elevation * std::numbers::pi / 180.0, a = azimuth * std::numbers::pi / 180.0;
  const Vec3 right = std::cos(a) * f.broad - std::sin(a) * f.front;
  const Vec3 front = std::sin(a) * f.broad + std::cos(a) * f.front;
  return {right, std::cos(e) * f.up - std::sin(e) * front, std::sin(e) * f.up + std::cos(e) * front};
}

/// Where a camera puts points in a rectangle.
struct Projection {
  Camera camera;
  Vec2 middle_mm = Vec2::Zero();  ///< shown at the rectangle's centre
  Vec2 centre = Vec2::Zero();     ///< of the rectangle [pixels]
  double scale = 1.0;             ///< pixels per mm

  /// x, y in picture pixels; z in mm toward the viewer.
  Vec3 operator()(const Vec3& p) const {
    const Vec3 q = camera.seen(p);
    return {centre.x() + scale * (q.x() - middle_mm.x()), centre.y() - scale * (q.y() - middle_mm.y()),
            q.z()};
  }
};

/// Fits all points into the rectangle.
Projection fitted(const Camera& camera, const Rect& rect, std::initializer_list<const Points*> clouds,
                  double margin_mm) {
  Eigen::AlignedBox2d box;
  for (const Points* cloud : clouds)
    for (Index n = 0; n < cloud->cols(); ++n)
      if (usable(cloud->col(n))) box.extend(Vec2(camera.seen(cloud->col(n)).head<2>()));
  Projection projection{.camera = camera, .centre = {rect.x + rect.w / 2.0, rect.y + rect.h / 2.0}};
  if (box.isEmpty()) return projection;
  projection.middle_mm = box.center();
  const Vec2 size = box.sizes().array() + 2.0 * std::max(margin_mm, 1e-6);
  projection.scale = std::min(rect.w / size.x(), rect.h / size.y());
  return projection;
}

/// Pixels with depth for one rectangle; drawn into, shaded, then laid on the canvas.
class Scene {
 public:
  Scene(const Projection& projection, const Rect& rect)
      : projection_(projection),
        x0_(static_cast<int>(rect.x * fine)),
        y0_(static_cast<int>(rect.y * fine)),
        w_(static_cast<int>(rect.w * fine)),
        h_(static_cast<int>(rect.h * fine)),
        depth_(static_cast<std::size_t>(w_ * h_), nothing),
        colour_(depth_.size(), card) {}

  /// A lit ball; `lift_mm` moves it toward the viewer in the test of what hides what.
  void ball(const Vec3& centre_mm, double radius_mm, const Colour& colour, double lift_mm = 0.0) {
    const Vec3 p = projection_(centre_mm);
    const double r = std::max(radius_mm * projection_.scale, 0.8) * fine;
    const double cx = p.x() * fine - x0_, cy = p.y() * fine - y0_;
    if (!(cx > -r && cy > -r && cx < w_ + r && cy < h_ + r)) return;
    const int x0 = pixel_within(cx - r, w_ - 1), x1 = pixel_within(cx + r, w_ - 1);
    const int y0 = pixel_within(cy - r, h_ - 1), y1 = pixel_within(cy + r, h_ - 1);
    for (int y = y0; y <= y1; ++y)
      for (int x = x0; x <= x1; ++x) {
        const double u = (x + 0.5 - cx) / r, v = (cy - y - 0.5) / r, rest = 1.0 - u * u - v * v;
        if (rest < 0.0) continue;
        const double n = std::sqrt(rest);
        put(x, y, p.z() + n * radius_mm + lift_mm, [&] { return lit(colour, u, v, n); });
      }
  }

  /// A lit triangle with a normal at each corner; `colour` of the weights of the corners.
  template <class ColourAt>
  void triangle(const std::array<Vec3, 3>& corner_mm, const std::array<Vec3, 3>& normal, ColourAt colour) {
    std::array<Vec3, 3> p;
    for (std::size_t c = 0; c < 3; ++c) {
      p[c] = projection_(corner_mm[c]);
      p[c].x() = p[c].x() * fine - x0_;
      p[c].y() = p[c].y() * fine - y0_;
    }
    const double area =
        (p[1].x() - p[0].x()) * (p[2].y() - p[0].y()) - (p[2].x() - p[0].x()) * (p[1].y() - p[0].y());
    if (!(std::abs(area) > 1e-12)) return;
    const auto [low_x, high_x] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
    const auto [low_y, high_y] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
    if (high_x < 0.0 || high_y < 0.0 || low_x > w_ || low_y > h_) return;
    std::array<Vec3, 3> seen;  // normals
    for (std::size_t c = 0; c < 3; ++c) seen[c] = projection_.camera.seen(normal[c]);
    // The weights of the corners are linear in x and y.
    const double a_x = (p[1].y() - p[2].y()) / area, a_y = (p[2].x() - p[1].x()) / area;
    const double b_x = (p[2].y() - p[0].y()) / area, b_y = (p[0].x() - p[2].x()) / area;
    const double x2 = p[2].x() - 0.5, y2 = p[2].y() - 0.5;
    const double z0 = p[0].z(), z1 = p[1].z(), z2 = p[2].z();
    const int x0 = pixel_within(low_x, w_ - 1), x1 = pixel_within(high_x, w_ - 1);
    const int y0 = pixel_within(low_y, h_ - 1), y1 = pixel_within(high_y, h_ - 1);
    for (int y = y0; y <= y1; ++y)
      for (int x = x0; x <= x1; ++x) {
        const double a = a_x * (x - x2) + a_y * (y - y2), b = b_x * (x - x2) + b_y * (y - y2);
        const double c = 1.0 - a - b;
        if (a < 0.0 || b < 0.0 || c < 0.0) continue;
        put(x, y, a * z0 + b * z1 + c * z2, [&] {
          const Vec3 n = (a * seen[0] + b * seen[1] + c * seen[2]).normalized();
          return lit(colour(a, b, c), n.x(), n.y(), n.z());
        });
      }
  }

  /// Darkens what lies behind its surroundings: rims and gaps stand out, the shape reads without colours.
  /// `thickness_mm` is the step in depth that gives a clear edge.
  void lay_on(Canvas& canvas, double thickness_mm) const {
    static constexpr int ring = 16;
    static constexpr int dx[ring] = {2, 2, 0, -2, -2, -2, 0, 2, 7, 5, 0, -5, -7, -5, 0, 5};
    static constexpr int dy[ring] = {0, 2, 2, 2, 0, -2, -2, -2, 0, 5, 7, 5, 0, -5, -7, -5};
    const float unit = 1.0F / static_cast<float>(std::max(thickness_mm, 1e-9));
    for (int y = 0; y < h_; ++y)
      for (int x = 0; x < w_; ++x) {
        const float* here = depth_.data() + x + w_ * y;
        if (*here == nothing) continue;
        float hidden = 0.0F;
        for (int n = 0; n < ring; ++n) {
          const int nx = x + dx[n], ny = y + dy[n];
          if (nx < 0 || ny < 0 || nx >= w_ || ny >= h_) continue;
          const float step = (here[dx[n] + w_ * dy[n]] - *here) * unit;
          if (step > 0.0F) hidden += step < 1.0F ? step : 1.0F;
        }
        const float shade = std::exp(-1.1F * hidden / ring);
        canvas.blend(x0_ + x, y0_ + y, colour_[static_cast<std::size_t>(x + w_ * y)] * shade, 1.0);
      }
  }

 private:
  static constexpr float nothing = -std::numeric_limits<float>::infinity();

  template <class Shade>
  void put(int x, int y, double depth, Shade shade) {
    const std::size_t i = static_cast<std::size_t>(x + w_ * y);
    if (!(static_cast<float>(depth) > depth_[i])) return;
    depth_[i] = static_cast<float>(depth);
    colour_[i] = shade();
  }

  /// Light from the upper left in front, a little from everywhere, a soft highlight. Both sides are lit.
  /// (x, y, z) is the unit normal: right, up, toward the viewer.
  static Colour lit(const Colour& colour, double x, double y, double z) {
    static const Vec3 light = Vec3(-0.45, 0.65, 0.75).normalized(),
                      half = (light + Vec3::UnitZ()).normalized();
    static const double lx = light.x(), ly = light.y(), lz = light.z();
    static const double hx = half.x(), hy = half.y(), hz = half.z();
    if (z < 0.0) x = -x, y = -y, z = -z;
    const double diffuse = std::max(x * lx + y * ly + z * lz, 0.0), sky = 0.5 + 0.5 * y;
    const double gloss = std::max(x * hx + y * hy + z * hz, 0.0), gloss2 = gloss * gloss;
    const double gloss8 = gloss2 * gloss2 * gloss2 * gloss2;
    const auto highlight = static_cast<float>(0.14 * gloss8 * gloss8 * gloss8);
    const auto brightness = static_cast<float>(0.40 + 0.16 * sky + 0.54 * diffuse);
    const auto part = [&](float c) { return std::min(c * brightness + highlight, 1.0F); };
    return {part(colour.red), part(colour.green), part(colour.blue)};
  }

  Projection projection_;
  int x0_, y0_, w_, h_;
  std::vector<float> depth_;
  std::vector<Colour> colour_;
};

// ------------------------------------------------------------------------------------------------ furniture

constexpr double header = 40.0;  // of a panel [pixels]

/// What a heading leaves of a panel.
Rect room_of(const Rect& panel) {
  return panel.inset(14.0, header, 14.0, 12.0);
}

/// A white card with a heading and a few words; returns the room that is left.
Rect panel(Canvas& canvas, const Rect& r, const std::string& heading, const std::string& words) {
  canvas.rectangle({r.x - 1.0, r.y - 1.0, r.w + 2.0, r.h + 2.0}, hairline, 9.0);
  canvas.rectangle(r, card, 8.0);
  const Style title{.size = 17.0, .bold = true}, note{.size = 14.0, .colour = soft_ink};
  write(canvas, {r.x + 18.0, r.y + 28.0}, heading, title);
  const double used = text_width(heading, title) + 34.0;
  write(canvas, {r.x + used, r.y + 28.0}, shortened(words, r.w - used - 14.0, note), note);
  return room_of(r);
}

void scale_bar(Canvas& canvas, const Rect& room, double pixels_per_mm) {
  const double length_mm = round_below(0.22 * room.w / pixels_per_mm), length = length_mm * pixels_per_mm;
  const double right = room.x + room.w - 8.0, y = room.y + room.h - 8.0;
  canvas.rectangle({right - length - 6.0, y - 24.0, length + 12.0, 32.0}, card, 4.0);
  canvas.line({right - length, y}, {right, y}, 2.0, ink);
  canvas.line({right - length, y - 4.0}, {right - length, y + 4.0}, 2.0, ink);
  canvas.line({right, y - 4.0}, {right, y + 4.0}, 2.0, ink);
  write(canvas, {right - length / 2.0, y - 8.0}, fmt::format("{:g} mm", length_mm), {.size = 14.0},
        Align::centre);
}

/// Which way left, posterior and superior (or their opposites) point: the half of each axis that is seen
/// better.
void triad(Canvas& canvas, const Rect& room, const Camera& camera) {
  const Vec2 origin(room.x + 42.0, room.y + room.h - 40.0);
  constexpr double length = 28.0;
  static constexpr std::array<const char*, 3> positive{"L", "P", "S"}, negative{"R", "A", "I"};
  for (int axis = 0; axis < 3; ++axis) {
    Vec3 seen = camera.seen(Vec3::Unit(axis));
    const bool flip = std::abs(seen.z()) > 0.35 ? seen.z() < 0.0 : seen.y() + 0.5 * seen.x() < 0.0;
    if (flip) seen = -seen;
    const Vec2 along(seen.x(), -seen.y());
    const Vec2 tip = origin + length * along;
    const bool head_on = along.norm() < 0.15;
    canvas.line(origin, tip, 1.8, soft_ink);
    canvas.disc(tip, head_on ? 3.6 : 2.4, soft_ink);
    const Vec2 out = head_on ? Vec2(-1.0, 0.4) : Vec2(along.normalized());
    const auto letter = static_cast<std::size_t>(axis);
    write(canvas, tip + 11.0 * out + Vec2(0.0, 5.0), flip ? negative[letter] : positive[letter],
          {.size = 14.0, .bold = true}, Align::centre);
  }
}

struct LegendEntry {
  std::string text;
  Colour colour;
  char mark;  ///< 'o' dot, '+' cross, '-' line, 's' solid
};

/// Without its last parts where there is no room for them: of a tool its measures, which stand below.
std::string as_short_as(double room, std::string text, const Style& style) {
  for (const char* part : {", ", " of "})
    while (text_width(text, style) > room && text.rfind(part) != std::string::npos)
      text.resize(text.rfind(part));
  return text;
}

/// Entries side by side from the left, to `right` at most.
void legend(Canvas& canvas, Vec2 at, double right, const std::vector<LegendEntry>& entries) {
  const Style style{.size = 14.0};
  for (const LegendEntry& entry : entries) {
    const std::string text = as_short_as(right - at.x() - 20.0, entry.text, style);
    const Vec2 mark = at + Vec2(7.0, -5.0);
    if (entry.mark == 'o') canvas.disc(mark, 5.0, entry.colour);
    if (entry.mark == 's') canvas.rectangle({mark.x() - 6.0, mark.y() - 6.0, 12.0, 12.0}, entry.colour, 2.0);
    if (entry.mark == '-') canvas.line(mark - Vec2(8.0, 0.0), mark + Vec2(8.0, 0.0), 2.0, entry.colour);
    if (entry.mark == '+') {
      canvas.line(mark - Vec2(5.0, 0.0), mark + Vec2(5.0, 0.0), 1.6, entry.colour);
      canvas.line(mark - Vec2(0.0, 5.0), mark + Vec2(0.0, 5.0), 1.6, entry.colour);
    }
    write(canvas, at + Vec2(20.0, 0.0), text, style);
    at.x() += 20.0 + text_width(text, style) + 24.0;
  }
}

void say_nothing_to_show(Canvas& canvas, const Rect& room, const std::string& text) {
  write(canvas, {room.x + room.w / 2.0, room.y + room.h / 2.0}, text, {.size = 16.0, .colour = soft_ink},
        Align::centre);
}

// ---------------------------------------------------------------------------------------------------- parts

int set_of(const Overview& o, Index n) {
  return n < static_cast<Index>(o.node_set.size()) ? o.node_set[static_cast<std::size_t>(n)] : 0;
}

Points moved(const Points& rest, const Points& displacement) {
  return displacement.cols() == rest.cols() ? Points(rest + displacement) : rest;
}

/// The usual distance between neighbours: the middle one of at most 200 nodes, each with its six nearest.
double node_spacing(const Points& nodes) {
  std::vector<double> mean, distance2;
  const Index stride = std::max<Index>(1, nodes.cols() / 200);
  for (Index n = 0; n < nodes.cols(); n += stride) {
    distance2.clear();
    for (Index m = 0; m < nodes.cols(); ++m) {
      const double d2 = (nodes.col(m) - nodes.col(n)).squaredNorm();
      if (d2 > 0.0 && std::isfinite(d2)) distance2.push_back(d2);
    }
    if (distance2.empty()) continue;
    const std::size_t count = std::min<std::size_t>(6, distance2.size());
    std::nth_element(distance2.begin(), distance2.begin() + static_cast<std::ptrdiff_t>(count - 1),
                     distance2.end());
    double sum = 0.0;
    for (std::size_t i = 0; i < count; ++i) sum += std::sqrt(distance2[i]);
    mean.push_back(sum / static_cast<double>(count));
  }
  if (mean.empty()) return 1.0;
  const auto middle = mean.begin() + static_cast<std::ptrdiff_t>(mean.size() / 2);
  std::nth_element(mean.begin(), middle, mean.end());
  return *middle;
}

void draw_cloud(Canvas& canvas, const Rect& rect, const Overview& o, const BodyFrame& frame, double spacing) {
  const auto count = o.nodes_mm.cols();
  const Rect room =
      panel(canvas, rect, "Nodes at rest", fmt::format("{} nodes, seen from the side of the tool", count));
  const Camera view = camera(frame, 28.0, 18.0);
  const Rect space = room.inset(20.0, 34.0, 20.0, 44.0);
  const Projection projection = fitted(view, space, {&o.nodes_mm}, spacing);
  if (count == 0) say_nothing_to_show(canvas, room, "no nodes");
  Scene scene(projection, room);
  for (Index n = 0; n < count; ++n) {
    const int set = set_of(o, n);
    if (usable(o.nodes_mm.col(n)))
      scene.ball(o.nodes_mm.col(n), (set == 0 ? 0.36 : 0.42) * spacing, colour_of(set));
  }
  scene.lay_on(canvas, 2.0 * spacing);
  triad(canvas, room, view);
  scale_bar(canvas, room, projection.scale);
  const auto in = [&](int bit) {
    return std::count_if(o.node_set.begin(), o.node_set.end(), [&](int set) { return (set & bit) != 0; });
  };
  std::vector<LegendEntry> entries = {{"free", interior, 'o'},
                                      {fmt::format("fixed base ({})", in(1)), base, 'o'}};
  if (o.tool.empty()) entries.push_back({fmt::format("tool circle ({})", in(2)), circle, 'o'});
  legend(canvas, {room.x + 6.0, room.y + 18.0}, room.x + room.w, entries);
}

/// Where the surface crosses the plane through `on` across `normal`: pairs of points.
std::vector<std::pair<Vec3, Vec3>> cut(const Points& surface, const Triangles& triangles, const Vec3& on,
                                       const Vec3& normal) {
  std::vector<std::pair<Vec3, Vec3>> pieces;
  for (Index t = 0; t < triangles.cols(); ++t) {
    std::array<Vec3, 3> crossing;
    std::size_t found = 0;
    for (int e = 0; e < 3; ++e) {
      const Vec3 a = surface.col(triangles(e, t)), b = surface.col(triangles((e + 1) % 3, t));
      const double da = (a - on).dot(normal), db = (b - on).dot(normal);
      if ((da < 0.0) != (db < 0.0)) crossing[found++] = a + (b - a) * (da / (da - db));
    }
    if (found == 2) pieces.emplace_back(crossing[0], crossing[1]);
  }
  return pieces;
}

/// Below 0 where the tool has been drawn out again.
double depth_of(const Overview& o) {
  return !o.depth_mm.empty() && std::isfinite(o.depth_mm.back()) ? o.depth_mm.back() : 0.0;
}

Points tool_at_the_end(const Overview& o) {
  return usable(o.push) ? Points(o.tool_mm.colwise() + (o.carried_mm + depth_of(o) * o.push + o.aside_mm))
                        : o.tool_mm;
}

std::vector<LegendEntry> tool_entry(const Overview& o) {
  if (o.tool_triangles.cols() == 0) return {};
  return {{o.tool.empty() ? fmt::format("tool, {} mm in diameter", three_digits(2.0 * o.radius_mm)) : o.tool,
           tool_metal, 's'}};
}

/// What of a line lies in a rectangle; nothing: none of it.
std::optional<std::array<Vec2, 2>> within(const Rect& r, const Vec2& a, const Vec2& b) {
  const Vec2 low(r.x, r.y), high(r.x + r.w, r.y + r.h), d = b - a;
  double from = 0.0, to = 1.0;
  for (int axis = 0; axis < 2; ++axis) {
    if (std::abs(d[axis]) < 1e-12) {
      if (a[axis] < low[axis] || a[axis] > high[axis]) return std::nullopt;
      continue;
    }
    const double s = (low[axis] - a[axis]) / d[axis], t = (high[axis] - a[axis]) / d[axis];
    from = std::max(from, std::min(s, t)), to = std::min(to, std::max(s, t));
  }
  if (!(from <= to)) return std::nullopt;
  return std::array<Vec2, 2>{a + from * d, a + to * d};
}

using Pieces = std::vector<std::pair<Vec3, Vec3>>;

/// A section on the picture, and what of it is shown.
struct SectionView {
  Projection projection;
  Rect shown;
  bool near = false;  ///< the tool and its surroundings alone
  Vec2 at(const Vec3& p) const { return Vec2(projection(p).head<2>()); }
  bool holds(const Vec2& p) const {
    return p.x() >= shown.x && p.y() >= shown.y && p.x() <= shown.x + shown.w && p.y() <= shown.y + shown.h;
  }
};

constexpr double tool_above = 50.0;  // the surface at rest [pixels]

/// The whole section, unless the tool would be tiny in it. `centre`: at the end.
SectionView section_view(const Rect& room, const Overview& o, const Camera& camera, const Vec3& centre,
                         double margin_mm) {
  constexpr double tiny = 60.0, wide = 110.0;  // pixels across the tool
  const Points at_the_end =
      centre == o.centre_mm ? Points(3, 0) : moved(o.surface_mm, o.surface_displacement_mm);
  SectionView view{.projection = fitted(camera, room.inset(24.0, 84.0, 24.0, 72.0),
                                        {&o.nodes_mm, &o.surface_mm, &at_the_end}, margin_mm),
                   .shown = room.inset(0.0, 30.0, 0.0, 0.0)};
  const double tool_mm = 2.0 * o.radius_mm;
  if (!(tool_mm > 0.0) || !usable(o.centre_mm) || !(tool_mm * view.projection.scale < tiny)) return view;
  view.near = true;
  view.projection.scale = wide / tool_mm;
  const double below =
      0.5 * view.shown.h - tool_above - 12.0;  // the picture's middle, below the skin [pixels]
  view.projection.centre = Vec2(view.shown.x + view.shown.w / 2.0, view.shown.y + view.shown.h / 2.0);
  view.projection.middle_mm = camera.seen(centre).head<2>() - Vec2(0.0, below / view.projection.scale);
  return view;
}

/// The section of a tool that touches, as it is: between its lower and its upper side.
void draw_touching_tool(Canvas& canvas, const Overview& o, const SectionView& view, const Camera& camera,
                        const Vec3& centre) {
  const Points tool = tool_at_the_end(o);
  if (o.tool_triangles.cols() == 0 || !tool.allFinite()) return;
  std::vector<Vec2> outline;
  Vec2 middle = Vec2::Zero();
  const auto pieces = cut(tool, o.tool_triangles, centre, camera.toward);
  for (const auto& [a, b] : pieces) {
    outline.push_back(view.at(a));
    outline.push_back(view.at(b));
  }
  for (Vec2& p : outline) p.y() = std::max(p.y(), view.shown.y);
  for (const Vec2& p : outline) middle += p / static_cast<double>(outline.size());
  std::sort(outline.begin(), outline.end(), [&](const Vec2& p, const Vec2& q) {  // it is convex
    return std::atan2(p.y() - middle.y(), p.x() - middle.x()) <
           std::atan2(q.y() - middle.y(), q.x() - middle.x());
  });
  if (outline.size() > 2) canvas.polygon(outline, tool_fill, 0.3);
  for (const auto& [a, b] : pieces)
    if (const auto seen = within(view.shown, view.at(a), view.at(b)))
      canvas.line((*seen)[0], (*seen)[1], 1.6, tool_metal);
  const Vec2 foot = view.at(centre);
  if (depth_of(o) > 0.0)
    write(canvas, {foot.x() + o.radius_mm * view.projection.scale + 10.0, foot.y() - tool_above + 14.0},
          fmt::format("{} mm deep", three_digits(depth_of(o))), {.size = 14.0, .colour = tool_ink});
}

/// The tool's section: each piece of its foot is filled up to the head.
void draw_tool(Canvas& canvas, const Overview& o, const SectionView& view, const Camera& camera,
               const Vec3& centre) {
  if (!o.tool.empty()) return draw_touching_tool(canvas, o, view, camera, centre);
  const Points tool = tool_at_the_end(o);
  if (o.tool_triangles.cols() == 0 || !tool.allFinite()) return;
  const double head = view.at(centre).y() - tool_above;
  std::array<Vec2, 2> side = {view.at(centre), view.at(centre)};  // the foot's ends, left and right
  std::vector<std::array<Vec2, 2>> foot;
  for (const auto& [a, b] : cut(tool, o.tool_triangles, centre, camera.toward)) {
    const Vec2 left = view.at(a).x() < view.at(b).x() ? view.at(a) : view.at(b);
    const Vec2 right = view.at(a).x() < view.at(b).x() ? view.at(b) : view.at(a);
    if (!(right.x() - left.x() > 0.05) || left.y() < head || right.y() < head) continue;
    foot.push_back({left, right});
    if (left.x() < side[0].x()) side[0] = left;
    if (right.x() > side[1].x()) side[1] = right;
  }
  for (const auto& [left, right] : foot)
    canvas.polygon({{left.x(), head}, {right.x(), head}, right, left}, tool_fill, 0.3);
  for (const auto& [left, right] : foot) canvas.line(left, right, 1.6, tool_metal);
  for (const Vec2& end : side) canvas.line({end.x(), head}, end, 1.6, tool_metal);
  canvas.line({side[0].x(), head}, {side[1].x(), head}, 1.6, tool_metal);
  const double middle = view.at(centre).x();
  canvas.arrow({middle, head + 6.0}, {middle, head + 40.0}, 2.4, tool_ink);
  if (depth_of(o) > 0.0)
    write(canvas, {side[1].x() + 10.0, head + 14.0}, fmt::format("{} mm deep", three_digits(depth_of(o))),
          {.size = 14.0, .colour = tool_ink});
}

/// The whole outline, small, with a frame around what is shown.
void draw_where(Canvas& canvas, const Rect& room, const SectionView& view, const Camera& camera,
                const Pieces& outline) {
  Points ends(3, static_cast<Index>(2 * outline.size()));
  for (std::size_t k = 0; k < outline.size(); ++k) {
    ends.col(static_cast<Index>(2 * k)) = outline[k].first;
    ends.col(static_cast<Index>(2 * k + 1)) = outline[k].second;
  }
  const Rect corner{room.x + room.w - 142.0, room.y + 30.0, 136.0, 104.0};
  canvas.rectangle({corner.x - 1.0, corner.y - 1.0, corner.w + 2.0, corner.h + 2.0}, hairline, 5.0);
  canvas.rectangle(corner, card, 4.0);
  const Projection small = fitted(camera, corner.inset(6.0, 6.0, 6.0, 6.0), {&ends}, 0.0);
  for (const auto& [a, b] : outline) canvas.line(small(a).head<2>(), small(b).head<2>(), 1.2, soft_ink);
  const double zoom = small.scale / view.projection.scale;
  const Vec2 size = zoom * Vec2(view.shown.w, view.shown.h);
  const Vec2 middle(small.centre.x() + small.scale * (view.projection.middle_mm.x() - small.middle_mm.x()),
                    small.centre.y() - small.scale * (view.projection.middle_mm.y() - small.middle_mm.y()));
  const std::array<Vec2, 4> frame = {
      middle + Vec2(-0.5, -0.5).cwiseProduct(size), middle + Vec2(0.5, -0.5).cwiseProduct(size),
      middle + Vec2(0.5, 0.5).cwiseProduct(size), middle + Vec2(-0.5, 0.5).cwiseProduct(size)};
  for (std::size_t k = 0; k < 4; ++k)
    if (const auto seen = within(corner, frame[k], frame[(k + 1) % 4]))
      canvas.line((*seen)[0], (*seen)[1], 1.8, tool_ink);
}

/// The nodes that a section shows.
Points nodes_near(const Overview& o, const SectionView& view, const Vec3& centre) {
  const double reach = 0.5 * view.shown.w / view.projection.scale;
  std::vector<Index> near;
  for (Index n = 0; n < o.nodes_mm.cols(); ++n)
    if ((o.nodes_mm.col(n) - centre).norm() < reach) near.push_back(n);
  return o.nodes_mm(Eigen::all, near);
}

/// Where walls cross the section.
void draw_walls(Canvas& canvas, const GapAt& walls, const SectionView& view, const Vec3& centre) {
  if (!walls) return;
  constexpr double cell = 4.0;  // pixels
  const Projection& p = view.projection;
  const Vec3 on_plane = centre.dot(p.camera.toward) * p.camera.toward;
  const Vec2 corner(view.shown.x, view.shown.y);
  const auto gap = [&](const Vec2& pixel) {
    const Vec2 mm = (pixel + corner - p.centre) / p.scale;
    return walls(on_plane + (p.middle_mm.x() + mm.x()) * p.camera.right +
                 (p.middle_mm.y() - mm.y()) * p.camera.up);
  };
  for (const auto& [a, b] : zero_pieces(view.shown.w, view.shown.h, cell, gap))
    canvas.line(corner + a, corner + b, 2.2, wall_ink);
}

void draw_section(Canvas& canvas, const Rect& rect, const Overview& o, const BodyFrame& frame,
                  double spacing) {
  const Camera camera_ahead = camera(frame, 0.0, 0.0);
  const Vec3 centre = usable(o.centre_mm) ? o.centre_mm : Vec3(Vec3::Zero());
  const Vec3 there = usable(o.axis_mm) ? o.axis_mm : centre;  // loads and steps have carried the tool
  const SectionView view = section_view(room_of(rect), o, camera_ahead, there, spacing / 2.0);
  if (view.near) spacing = node_spacing(nodes_near(o, view, centre));
  const double thickness = 1.25 * spacing;
  const Rect room = panel(canvas, rect, view.near ? "Section at the tool" : "Section through the tool's axis",
                          fmt::format("nodes at rest in a slab of {} mm", three_digits(thickness)));
  const auto in_slab = [&](const Vec3& p) {
    return usable(p) && std::abs((p - centre).dot(camera_ahead.toward)) <= thickness / 2.0;
  };
  const auto draw = [&](const Pieces& pieces, double thick, const Colour& colour, double opacity) {
    for (const auto& [a, b] : pieces)
      if (const auto seen = within(view.shown, view.at(a), view.at(b)))
        canvas.line((*seen)[0], (*seen)[1], thick, colour, opacity);
  };
  // The tool first: what it presses upon is drawn over it.
  draw_tool(canvas, o, view, camera_ahead, there);
  draw_walls(canvas, o.walls, view, there);
  const Pieces at_rest = cut(o.surface_mm, o.surface_triangles, centre, camera_ahead.toward);
  draw(at_rest, 1.2, soft_ink, 0.8);
  const double step = spacing * view.projection.scale;  // nodes on the picture are about this far apart
  const double arm = std::clamp(0.16 * step, 1.5, 5.0), dot = std::clamp(0.20 * step, 1.2, 6.0);
  for (Index q = 0; q < o.points_mm.cols(); ++q) {
    if (!in_slab(o.points_mm.col(q))) continue;
    const Vec2 p = view.at(o.points_mm.col(q));
    if (!view.holds(p)) continue;
    canvas.line(p - Vec2(arm, 0.0), p + Vec2(arm, 0.0), 1.1, cross);
    canvas.line(p - Vec2(0.0, arm), p + Vec2(0.0, arm), 1.1, cross);
  }
  for (const bool special : {false, true})
    for (Index n = 0; n < o.nodes_mm.cols(); ++n) {
      const int set = set_of(o, n);
      if (special == (set == 0) || !in_slab(o.nodes_mm.col(n)) || !view.holds(view.at(o.nodes_mm.col(n))))
        continue;
      canvas.disc(view.at(o.nodes_mm.col(n)), special ? 1.25 * dot : dot,
                  special ? colour_of(set) : node_dot);
    }
  if (o.surface_displacement_mm.cols() == o.surface_mm.cols())
    draw(cut(moved(o.surface_mm, o.surface_displacement_mm), o.surface_triangles, there, camera_ahead.toward),
         1.8, circle, 1.0);
  if (view.near && !at_rest.empty()) draw_where(canvas, room, view, camera_ahead, at_rest);
  triad(canvas, room, camera_ahead);
  scale_bar(canvas, room, view.projection.scale);
  std::vector<LegendEntry> entries = {{"node", node_dot, 'o'},
                                      {"integration point", cross, '+'},
                                      {"outline at rest", soft_ink, '-'},
                                      {o.moment, circle, '-'}};
  if (o.walls) entries.push_back({"wall", wall_ink, '-'});
  for (const LegendEntry& entry : tool_entry(o)) entries.push_back(entry);
  legend(canvas, {room.x + 6.0, room.y + 18.0}, room.x + room.w, entries);
}

/// Colours from 0 to `most` mm with a number at every step, standing at the right edge.
void colour_bar(Canvas& canvas, const Rect& room, double most_mm) {
  const Rect bar{room.x + room.w - 76.0, room.y + 40.0, 14.0, room.h - 110.0};
  const int bands = static_cast<int>(bar.h * fine);
  for (int i = 0; i < bands; ++i) {
    const double y = bar.y + bar.h * (1.0 - (i + 1.0) / bands);
    canvas.rectangle({bar.x, y, bar.w, std::min(2.0 / fine, bar.y + bar.h - y)}, heat((i + 0.5) / bands));
  }
  const Style style{.size = 14.0};
  write(canvas, {bar.x - 2.0, bar.y - 12.0}, "mm", style);
  const double step = round_below(most_mm / 3.9);
  for (double value = 0.0; value <= most_mm * (1.0 + 1e-9); value += step) {
    const double y = bar.y + bar.h * (1.0 - value / most_mm);
    canvas.line({bar.x + bar.w, y}, {bar.x + bar.w + 5.0, y}, 1.2, ink);
    write(canvas, {bar.x + bar.w + 10.0, y + 5.0}, tick_text(value, step), style);
  }
}

/// Smaller displacements are rounding: no part of the tool's size that anybody sees [mm].
double least_seen(const Overview& o) {
  return std::max(1e-9, 1e-5 * o.radius_mm);
}

/// The body at the end, drawn and not yet laid on; nothing in it is text, which VTK sets in one thread only.
struct Deformed {
  bool has_surface = false, empty = false;
  double most_mm = 0.0;  ///< displacement
  Projection projection;
  Scene scene;
};

Deformed deformed(const Rect& room, const Overview& o, const BodyFrame& frame, double spacing) {
  const Points nodes = moved(o.nodes_mm, o.displacement_mm);
  const Points surface = moved(o.surface_mm, o.surface_displacement_mm);
  const bool has_surface = o.surface_triangles.cols() > 0 && surface.cols() > 0;
  const Points& shown = has_surface ? o.surface_displacement_mm : o.displacement_mm;
  double most = 0.0;
  for (Index n = 0; n < shown.cols(); ++n)
    if (usable(shown.col(n))) most = std::max(most, shown.col(n).norm());
  const auto value = [&](Index n) {
    return n < shown.cols() && most > least_seen(o) && usable(shown.col(n)) ? shown.col(n).norm() / most
                                                                            : 0.0;
  };

  const Points tool = tool_at_the_end(o);
  const Projection projection = fitted(camera(frame, 42.0, 18.0), room.inset(20.0, 34.0, 100.0, 44.0),
                                       {&nodes, &surface, &tool}, spacing / 2.0);
  Scene scene(projection, room);
  for (Index t = 0; t < o.tool_triangles.cols() && tool.allFinite(); ++t) {
    const Vec3 a = tool.col(o.tool_triangles(0, t)), b = tool.col(o.tool_triangles(1, t)),
               c = tool.col(o.tool_triangles(2, t));
    const Vec3 n = (b - a).cross(c - a);
    scene.triangle({a, b, c}, {n, n, n}, [](double, double, double) { return tool_metal; });
  }
  if (has_surface) {
    Points normal = Points::Zero(3, surface.cols());
    const auto corner = [&](Index c, Index t) { return surface.col(o.surface_triangles(c, t)); };
    for (Index t = 0; t < o.surface_triangles.cols(); ++t) {
      const Vec3 n = (corner(1, t) - corner(0, t)).cross(corner(2, t) - corner(0, t));
      if (!n.allFinite()) continue;
      for (int c = 0; c < 3; ++c) normal.col(o.surface_triangles(c, t)) += n;
    }
    Eigen::VectorXd level(surface.cols());
    for (Index v = 0; v < surface.cols(); ++v) {
      normal.col(v).normalize();
      level[v] = value(v);
    }
    for (Index t = 0; t < o.surface_triangles.cols(); ++t) {
      const Index a = o.surface_triangles(0, t), b = o.surface_triangles(1, t), c = o.surface_triangles(2, t);
      if (!usable(surface.col(a)) || !usable(surface.col(b)) || !usable(surface.col(c))) continue;
      scene.triangle(
          {surface.col(a), surface.col(b), surface.col(c)}, {normal.col(a), normal.col(b), normal.col(c)},
          [&](double u, double v, double w) { return heat(u * level[a] + v * level[b] + w * level[c]); });
    }
  }
  for (Index n = 0; n < nodes.cols(); ++n) {
    if (!usable(nodes.col(n))) continue;
    // Nodes lie a little inside the skin: lifted, those of the circle show through it but not through a rim.
    // A tool stands on them.
    if (is_circle(set_of(o, n)) && o.tool_triangles.cols() > 0) continue;
    if (is_circle(set_of(o, n)))
      scene.ball(nodes.col(n), 0.27 * spacing, circle, 0.75 * spacing);
    else if (!has_surface)
      scene.ball(nodes.col(n), 0.42 * spacing, heat(value(n)));
  }
  return {has_surface, !has_surface && nodes.cols() == 0, most, projection, std::move(scene)};
}

void draw_body(Canvas& canvas, const Rect& room, const Overview& o, const Deformed& body, double spacing) {
  if (body.empty) say_nothing_to_show(canvas, room, "no surface and no nodes");
  body.scene.lay_on(canvas, 2.0 * spacing);
  triad(canvas, room, body.projection.camera);
  scale_bar(canvas, room, body.projection.scale);
  if (body.most_mm > least_seen(o)) colour_bar(canvas, room, body.most_mm);
  const std::vector<LegendEntry> tool = tool_entry(o);
  legend(canvas, {room.x + 6.0, room.y + 18.0}, room.x + room.w,
         tool.empty() ? std::vector<LegendEntry>{{"nodes of the tool circle", circle, 'o'}} : tool);
}

void draw_dimple(Canvas& canvas, const Rect& rect, const Overview& o, const Deformed& body, double spacing) {
  draw_body(canvas,
            panel(canvas, rect, body.has_surface ? "Deformed surface" : "Deformed nodes",
                  body.most_mm > least_seen(o) ? fmt::format("coloured by displacement {}, up to {} mm",
                                                             o.moment, three_digits(body.most_mm))
                                               : "not displaced " + o.moment),
            o, body, spacing);
}

/// What the chart shows, where it is finite: depth [mm] or, of a scene of steps, time [s]; and force.
struct ForceCurve {
  std::vector<Vec2> points;
  std::vector<double> half;   ///< of the band at each of them, or none
  std::vector<Vec2> beside;   ///< another curve
  std::vector<Vec2> lateral;  ///< over time: the force across the push
};

std::vector<Vec2> finite_points(const std::vector<double>& along, const std::vector<double>& force_N) {
  std::vector<Vec2> points;
  for (std::size_t i = 0; i < std::min(along.size(), force_N.size()); ++i)
    if (std::isfinite(along[i]) && std::isfinite(force_N[i])) points.emplace_back(along[i], force_N[i]);
  return points;
}

bool has_band(const Overview& o) {
  return !o.half_N.empty() && o.half_N.size() == o.force_N.size();
}

bool over_time(const Overview& o) {
  return !o.time_s.empty();
}

ForceCurve force_curve(const Overview& o) {
  ForceCurve shown{.points = finite_points(over_time(o) ? o.time_s : o.depth_mm, o.force_N),
                   .half = {},
                   .beside = finite_points(o.beside_depth_mm, o.beside_force_N),
                   .lateral = finite_points(o.time_s, o.lateral_N)};
  if (has_band(o))
    for (std::size_t i = 0; i < std::min(o.depth_mm.size(), o.force_N.size()); ++i)
      if (std::isfinite(o.depth_mm[i]) && std::isfinite(o.force_N[i])) shown.half.push_back(o.half_N[i]);
  return shown;
}

/// With its band and the origin.
Eigen::AlignedBox2d range_of(const ForceCurve& shown) {
  Eigen::AlignedBox2d range(Vec2(0.0, 0.0));
  for (const Vec2& p : shown.points) range.extend(p);
  for (const Vec2& p : shown.beside) range.extend(p);
  for (const Vec2& p : shown.lateral) range.extend(p);
  for (std::size_t i = 0; i < shown.half.size(); ++i)
    range.extend(shown.points[i] + Vec2(0.0, shown.half[i]))
        .extend(shown.points[i] - Vec2(0.0, shown.half[i]));
  return range;
}

ForceCurve in_unit(ForceCurve shown, const Scale& scale) {
  for (Vec2& p : shown.points) p.y() *= scale.factor;
  for (Vec2& p : shown.beside) p.y() *= scale.factor;
  for (Vec2& p : shown.lateral) p.y() *= scale.factor;
  for (double& h : shown.half) h *= scale.factor;
  return shown;
}

/// Where values lie in a chart, and the ticks of both axes.
struct ChartAxes {
  Rect plot;
  Vec2 low, high;
  Vec2 step, first;  ///< of the ticks
  Vec2 at(const Vec2& p) const {
    return {plot.x + plot.w * (p.x() - low.x()) / (high.x() - low.x()),
            plot.y + plot.h * (1.0 - (p.y() - low.y()) / (high.y() - low.y()))};
  }
};

/// For values from `low` to `high`.
ChartAxes chart_axes(const Rect& plot, Vec2 low, Vec2 high) {
  if (!(high.x() - low.x() > 1e-9)) high.x() = low.x() + 1.0;
  if (!(high.y() - low.y() > 1e-9)) high.y() = low.y() + 1.0;
  const Vec2 step(round_below((high.x() - low.x()) / 3.9), round_below((high.y() - low.y()) / 3.9));
  const Vec2 first = (low.array() / step.array() - 1e-9).ceil() * step.array();
  if (low.x() < 0.0) low.x() -= 0.04 * (high.x() - low.x());
  if (low.y() < 0.0) low.y() -= 0.08 * (high.y() - low.y());
  high += Vec2(0.06, 0.14).cwiseProduct(high - low);  // room for the last point and its label
  return {plot, low, high, step, first};
}

void draw_axes(Canvas& canvas, const Rect& room, const ChartAxes& axes, const std::string& along,
               const std::string& unit) {
  const auto& [plot, low, high, step, first] = axes;
  const Style label{.size = 14.0};
  for (int i = 0; first.x() + i * step.x() <= high.x(); ++i) {
    const double value = first.x() + i * step.x(), x = axes.at({value, 0.0}).x();
    canvas.line({x, plot.y}, {x, plot.y + plot.h}, 1.0, hairline);
    write(canvas, {x, plot.y + plot.h + 20.0}, tick_text(value, step.x()), label, Align::centre);
  }
  for (int i = 0; first.y() + i * step.y() <= high.y(); ++i) {
    const double value = first.y() + i * step.y(), y = axes.at({0.0, value}).y();
    canvas.line({plot.x, y}, {plot.x + plot.w, y}, 1.0, hairline);
    write(canvas, {plot.x - 9.0, y + 5.0}, tick_text(value, step.y()), label, Align::right);
  }
  const double zero = axes.at({0.0, std::max(low.y(), 0.0)}).y();
  canvas.line({plot.x, zero}, {plot.x + plot.w, zero}, 1.4, soft_ink);
  canvas.line({plot.x, plot.y}, {plot.x, plot.y + plot.h}, 1.4, soft_ink);
  write(canvas, {plot.x + plot.w / 2.0, plot.y + plot.h + 44.0}, along, label, Align::centre);
  write(canvas, {room.x + 6.0, plot.y - 14.0}, fmt::format("force [{}]", unit), label);
}

void draw_force_curve(Canvas& canvas, const ChartAxes& axes, const ForceCurve& shown) {
  const auto& [points, half, beside, lateral] = shown;
  for (std::size_t i = 1; i < half.size(); ++i) {
    std::vector<Vec2> corners = {axes.at(points[i - 1] + Vec2(0.0, half[i - 1])),
                                 axes.at(points[i] + Vec2(0.0, half[i])),
                                 axes.at(points[i] - Vec2(0.0, half[i]))};
    if (half[i - 1] > 0.0) corners.push_back(axes.at(points[i - 1] - Vec2(0.0, half[i - 1])));
    canvas.polygon(corners, band, 0.2);
  }
  for (std::size_t i = 1; i < points.size(); ++i)
    canvas.line(axes.at(points[i - 1]), axes.at(points[i]), 2.6, curve);
  for (std::size_t i = 1; i < lateral.size(); ++i)
    canvas.line(axes.at(lateral[i - 1]), axes.at(lateral[i]), 2.0, other_curve);
  const double dot = beside.size() > 40 ? 2.4 : 4.5;
  for (const Vec2& p : beside) canvas.disc(axes.at(p), dot, other_curve);
}

/// Says what force the curve ends with.
void draw_end_of_curve(Canvas& canvas, const ChartAxes& axes, const ForceCurve& shown,
                       const std::string& text) {
  const auto& [points, half, beside, lateral] = shown;
  const Rect& plot = axes.plot;
  const Vec2 last = axes.at(points.back());
  canvas.disc(last, 6.5, card);
  canvas.disc(last, 5.0, circle);
  const Style strong{.size = 16.0, .bold = true};
  // Above the last point, unless the curve comes down to it; inside the plot in any case.
  const bool falls = (points.size() > 1 && points[points.size() - 2].y() > points.back().y()) ||
                     (!beside.empty() && beside.back().y() > points.back().y());
  const double room_for_text = text_width(text, strong);
  const double end = std::clamp(last.x() + 12.0, plot.x + room_for_text + 8.0, plot.x + plot.w);
  const Vec2 foot(end, last.y() + (falls ? 26.0 : -14.0));
  if (!beside.empty())
    canvas.rectangle({foot.x() - room_for_text - 4.0, foot.y() - 16.0, room_for_text + 8.0, 22.0}, card, 4.0);
  write(canvas, foot, text, strong, Align::right);
}

void draw_chart(Canvas& canvas, const Rect& rect, const Overview& o) {
  const Rect room = panel(
      canvas, rect, over_time(o) ? "Force over time" : "Force against indentation",
      fmt::format("{}; {}", o.tool.empty() ? "reaction of the circle's nodes" : "contact force on the tool",
                  has_band(o) ? "shaded: how far the discretisation may be off"
                              : "its discretisation error is not known"));
  const ForceCurve in_newton = force_curve(o);
  if (in_newton.points.empty()) return say_nothing_to_show(canvas, room, "no force recorded");
  const Eigen::AlignedBox2d range = range_of(in_newton);
  const Scale scale = force_scale(std::max(range.max().y(), -range.min().y()));
  const ForceCurve shown = in_unit(in_newton, scale);
  const Vec2 per_unit(1.0, scale.factor);
  const Rect plot = room.inset(66.0, 34.0, 20.0, 52.0);
  const ChartAxes axes =
      chart_axes(plot, range.min().cwiseProduct(per_unit), range.max().cwiseProduct(per_unit));
  draw_axes(canvas, room, axes, over_time(o) ? "time [s]" : "indentation [mm]", scale.unit);
  draw_force_curve(canvas, axes, shown);
  if (!shown.beside.empty())
    legend(canvas, {plot.x + 14.0, plot.y + 20.0}, plot.x + plot.w,
           {{"this run", curve, '-'}, {o.beside, other_curve, 'o'}});
  if (!shown.lateral.empty())
    legend(canvas, {plot.x + 14.0, plot.y + 20.0}, plot.x + plot.w,
           {{"along the push", curve, '-'}, {"across it", other_curve, '-'}});
  draw_end_of_curve(canvas, axes, shown, end_of_curve(o));
}

}  // namespace

namespace {

void check(const Triangles& triangles, const Points& points) {
  if (triangles.size() > 0 && (triangles.minCoeff() < 0 || triangles.maxCoeff() >= points.cols()))
    throw std::invalid_argument(fmt::format("triangle corners run from {} to {}, on {} points",
                                            triangles.minCoeff(), triangles.maxCoeff(), points.cols()));
}

void check(const Overview& overview) {
  check(overview.surface_triangles, overview.surface_mm);
  check(overview.tool_triangles, overview.tool_mm);
}

constexpr double row = 21.0;  // of small text

/// Lines between words, at most `most` of them: the last then says how many are left out.
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

}  // namespace

std::string end_of_curve(const Overview& o) {
  if (o.force_N.empty()) return {};
  const double force_N = o.force_N.back();
  if (!o.time_s.empty()) {
    const double largest = *std::max_element(o.force_N.begin(), o.force_N.end(),
                                             [](double a, double b) { return std::abs(a) < std::abs(b); });
    const Written written = force_written(largest);
    return written(largest) + " largest, " + (force_N == 0.0 ? "0 N" : written(force_N)) + " at the end";
  }
  std::string text = force_in_words(force_N) + " at " + length_in_words(o.depth_mm.back());
  const auto add = [&](const char* what, double half_N) {
    text += what + percent(half_N / std::abs(force_N));
  };
  if (!o.half_N.empty() && o.half_N.size() == o.force_N.size()) add(", +- ", o.half_N.back());
  if (o.image_half_N >= 0.0) add(", voxels +- ", o.image_half_N);
  return text;
}

void write_overview(const std::filesystem::path& file, const Overview& overview) {
  check(overview);
  Canvas canvas(width, height);
  constexpr double edge = 20.0, between = 14.0, inner = width - 2.0 * edge - 8.0;

  double top = 66.0;
  const Style title{.size = 26.0, .bold = true};
  write(canvas, {edge + 4.0, 44.0}, shortened(overview.title, inner, title), title);
  const Style warning{.size = 15.0, .colour = warning_ink};
  std::vector<std::string> warnings;
  for (const std::string& text : overview.warnings) warnings.push_back("Warning: " + text);
  warnings = rows_of(warnings, inner - 20.0, warning, 6, 2);
  if (!warnings.empty()) {
    const double tall = static_cast<double>(warnings.size()) * row + 12.0;
    canvas.rectangle({edge, top, width - 2.0 * edge, tall}, warning_fill, 6.0);
    for (std::size_t i = 0; i < warnings.size(); ++i)
      write(canvas, {edge + 14.0, top + 21.0 + static_cast<double>(i) * row}, warnings[i], warning);
    top += tall + between;
  }

  // Facts at the bottom take what they need; the panels share the rest.
  const Style fact{.size = 15.0, .colour = rgb(0x3A4654)};
  const std::vector<std::string> facts = rows_of(overview.lines, inner, fact, 11, 4);
  const double strip = facts.empty() ? 0.0 : static_cast<double>(facts.size()) * row + 10.0;
  for (std::size_t i = 0; i < facts.size(); ++i)
    write(canvas, {edge + 4.0, height - edge - strip + 24.0 + static_cast<double>(i) * row}, facts[i], fact);

  const double w = (width - 2.0 * edge - between) / 2.0;
  const double h = (height - top - edge - strip - between) / 2.0;
  const double right = edge + w + between, low = top + h + between;
  const BodyFrame frame = frame_of(overview);
  const double spacing = node_spacing(overview.nodes_mm);
  const Rect at_the_end{edge, low, w, h};
  auto body = std::async(overview.two_threads ? std::launch::async : std::launch::deferred,
                         [&] { return deformed(room_of(at_the_end), overview, frame, spacing); });
  draw_cloud(canvas, {edge, top, w, h}, overview, frame, spacing);
  draw_section(canvas, {right, top, w, h}, overview, frame, spacing);
  draw_dimple(canvas, at_the_end, overview, body.get(), spacing);
  draw_chart(canvas, {right, low, w, h}, overview);
  write_png(file, canvas);
}

std::string body_png(const Overview& overview) {
  check(overview);
  constexpr int wide = 1040, tall = 640;
  Canvas canvas(wide, tall);
  const Rect all{0.0, 0.0, wide, tall};
  canvas.rectangle(all, card);
  const Rect room = all.inset(12.0, 8.0, 12.0, 12.0);
  const double spacing = node_spacing(overview.nodes_mm);
  draw_body(canvas, room, overview, deformed(room, overview, frame_of(overview), spacing), spacing);
  return png(canvas);
}

}  // namespace dimple
