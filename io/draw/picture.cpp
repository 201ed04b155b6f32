#include "io/draw/picture.hpp"

#include <fmt/format.h>

#include <future>
#include <stdexcept>
#include <utility>

#include "io/draw/depth_image.hpp"
#include "io/draw/furniture.hpp"
#include "io/file.hpp"
#include "io/words.hpp"

namespace dimple {

namespace {

using namespace draw;

// Hues that the common colour-vision deficiencies keep apart; the lightness differs as well.
const Colour interior = rgb(0xB9C8D8), base = rgb(0x1560A0), bonded_patch = rgb(0xE8590C),
             cross = rgb(0x8794A4), node_dot = rgb(0x6F8AA6), tool_metal = rgb(0x4F9DA6),
             tool_fill = rgb(0xDCECEE), tool_ink = rgb(0x1F6F78);

bool is_bonded_patch(int set) {
  return (set & 2) != 0;
}
const Colour& colour_of(int set) {
  return is_bonded_patch(set) ? bonded_patch : (set & 1) != 0 ? base : interior;
}

/// Pale to dark through yellow, red and purple: the lightness falls evenly, for print in grey.
Colour warm_colour(double fraction) {
  static const std::array<Colour, 7> stops{rgb(0xECEBE6), rgb(0xF9DFA3), rgb(0xF9B768), rgb(0xEE7F52),
                                           rgb(0xCB4A5C), rgb(0x8C2B6B), rgb(0x47175A)};
  const double t = std::clamp(fraction, 0.0, 1.0) * (static_cast<double>(stops.size()) - 1.0);
  const std::size_t i = std::min<std::size_t>(static_cast<std::size_t>(t), stops.size() - 2);
  const auto f = static_cast<float>(t - static_cast<double>(i));
  return mixed(stops[i], stops[i + 1], f);
}

BodyFrame frame_of(const Overview& o) {
  return body_frame(o.nodes_mm, o.centre_mm, o.approach);
}

/// Room of a panel below its heading.
Rect room_of(const Rect& panel) {
  return panel.inset(14.0, 40.0, 14.0, 12.0);
}

/// A white card with a heading and a few words; returns the remaining room.
Rect draw_panel(Canvas& canvas, const Rect& r, const std::string& heading, const std::string& words) {
  const Style title{.size = 17.0, .bold = true};
  draw_card(canvas, r);
  canvas.text({r.x + 18.0, r.y + 28.0}, heading, title);
  const double used = text_width(heading, title) + 34.0;
  canvas.text({r.x + used, r.y + 28.0}, words, soft, Align::left, r.w - used - 14.0);
  return room_of(r);
}

/// Directions left, posterior and superior (or their opposites): the half of each axis that is more visible.
void draw_triad(Canvas& canvas, const Rect& room, const Camera& camera) {
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
    canvas.text(tip + 11.0 * out + Vec2(0.0, 5.0), flip ? negative[letter] : positive[letter],
                {.size = 14.0, .bold = true}, Align::centre);
  }
}

/// The triad, the scale bar and a legend in the corners of a room.
void draw_corners(Canvas& canvas, const Rect& room, const Projection& projection,
                  const std::vector<LegendEntry>& entries) {
  draw_triad(canvas, room, projection.camera);
  draw_scale_bar(canvas, room, projection.scale);
  draw_legend(canvas, {room.x + 6.0, room.y + 18.0}, room.x + room.w, entries);
}

int set_of(const Overview& o, Index n) {
  return n < static_cast<Index>(o.node_flags.size()) ? o.node_flags[static_cast<std::size_t>(n)] : 0;
}

Points moved(const Points& undeformed, const Points& displacement) {
  return displacement.cols() == undeformed.cols() ? Points(undeformed + displacement) : undeformed;
}

double middle_of(std::vector<double>& values, std::size_t at) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return values[at];
}

/// Typical distance of neighbours: the median, over at most 200 nodes, to the fourth nearest.
double node_spacing(const Points& nodes) {
  std::vector<double> fourth, distance2;
  const Index stride = std::max<Index>(1, nodes.cols() / 200);
  for (Index n = 0; n < nodes.cols(); n += stride) {
    distance2.clear();
    for (Index m = 0; m < nodes.cols(); ++m) {
      const double d2 = (nodes.col(m) - nodes.col(n)).squaredNorm();
      if (d2 > 0.0 && std::isfinite(d2)) distance2.push_back(d2);
    }
    if (!distance2.empty())
      fourth.push_back(std::sqrt(middle_of(distance2, std::min<std::size_t>(3, distance2.size() - 1))));
  }
  return fourth.empty() ? 1.0 : middle_of(fourth, fourth.size() / 2);
}

void draw_nodes(Canvas& canvas, const Rect& rect, const Overview& o, const BodyFrame& frame, double spacing) {
  const auto count = o.nodes_mm.cols();
  const Rect room = draw_panel(canvas, rect, "Nodes at rest",
                               fmt::format("{} nodes, seen from the side of the tool", count));
  const Projection projection =
      fitted(camera(frame, 28.0, 18.0), room.inset(20.0, 34.0, 20.0, 44.0), {&o.nodes_mm}, spacing);
  if (count == 0) say_in_the_middle(canvas, room, "no nodes");
  DepthImage image(projection, room);
  for (Index n = 0; n < count; ++n) {
    const int set = set_of(o, n);
    if (usable(o.nodes_mm.col(n)))
      image.ball(o.nodes_mm.col(n), (set == 0 ? 0.36 : 0.42) * spacing, colour_of(set));
  }
  image.lay_on(canvas, 2.0 * spacing);
  const auto in = [&](int bit) {
    return std::count_if(o.node_flags.begin(), o.node_flags.end(), [&](int set) { return (set & bit) != 0; });
  };
  std::vector<LegendEntry> entries = {{"free", interior, Mark::dot},
                                      {fmt::format("fixed base ({})", in(1)), base, Mark::dot}};
  if (o.tool.empty()) entries.push_back({fmt::format("contact patch ({})", in(2)), bonded_patch, Mark::dot});
  draw_corners(canvas, room, projection, entries);
}

/// Final depth; negative if the tool has been withdrawn.
double depth_of(const Overview& o) {
  return !o.depth_mm.empty() && std::isfinite(o.depth_mm.back()) ? o.depth_mm.back() : 0.0;
}

Points tool_at_the_end(const Overview& o) {
  return usable(o.approach)
             ? Points(o.tool_mm.colwise() + (o.carried_mm + depth_of(o) * o.approach + o.aside_mm))
             : o.tool_mm;
}

std::vector<LegendEntry> tool_entry(const Overview& o) {
  if (o.tool_triangles.cols() == 0) return {};
  return {{o.tool.empty() ? fmt::format("tool, {} mm in diameter", three_digits(2.0 * o.radius_mm)) : o.tool,
           tool_metal, Mark::solid}};
}

// -------------------------------------------------------------------------------------------------- section

/// A section on the picture, and its visible part.
struct SectionView {
  Projection projection;
  Rect shown;
  bool near = false;  ///< the tool and its surroundings alone
  Vec2 at(const Vec3& p) const { return Vec2(projection(p).head<2>()); }
};

constexpr double tool_above = 50.0;  // [pixels] from the surface at rest

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

/// Lines in which the surface crosses the section's plane through `on`, on the picture.
Pieces cut(const Projection& projection, const Points& surface, const Triangles& triangles, const Vec3& on) {
  Pieces pieces;
  for (Index t = 0; t < triangles.cols(); ++t) {
    std::array<Vec2, 2> crossing;
    std::size_t found = 0;
    for (int e = 0; e < 3; ++e) {
      const Vec3 a = surface.col(triangles(e, t)), b = surface.col(triangles((e + 1) % 3, t));
      const double da = (a - on).dot(projection.camera.toward), db = (b - on).dot(projection.camera.toward);
      if ((da < 0.0) != (db < 0.0))
        crossing[found++ % 2] = projection(a + (b - a) * (da / (da - db))).head<2>();
    }
    if (found == 2) pieces.push_back(crossing);
  }
  return pieces;
}

void draw_pieces(Canvas& canvas, const Pieces& pieces, double thick, const Colour& colour) {
  for (const auto& [a, b] : pieces) canvas.line(a, b, thick, colour);
}

/// The tool's section; an arrow shows the motion of a bonded patch.
void draw_tool(Canvas& canvas, const Overview& o, const SectionView& view, const Vec3& centre) {
  const Points tool = tool_at_the_end(o);
  if (o.tool_triangles.cols() == 0 || !tool.allFinite()) return;
  const Pieces outline = cut(view.projection, tool, o.tool_triangles, centre);
  canvas.area(outline, tool_fill);
  draw_pieces(canvas, outline, 1.6, tool_metal);
  const Vec2 foot = view.at(centre);
  const double head = std::max(foot.y() - tool_above, view.shown.y);
  const Vec2 from(foot.x(), head + 6.0), to(foot.x(), head + 40.0);
  if (o.tool.empty()) {
    canvas.line(from, to - Vec2(0.0, 8.0), 2.4, tool_ink);
    canvas.polygon({to, to + Vec2(-5.0, -10.0), to + Vec2(5.0, -10.0)}, tool_ink);
  }
  if (depth_of(o) > 0.0)
    canvas.text({foot.x() + o.radius_mm * view.projection.scale + 10.0, head + 14.0},
                fmt::format("{} mm deep", three_digits(depth_of(o))), {.size = 14.0, .colour = tool_ink});
}

/// The whole outline, small, with a frame around the visible part.
void draw_where(Canvas& canvas, const Rect& room, const SectionView& view, const Overview& o,
                const Vec3& centre) {
  const Rect corner{room.x + room.w - 142.0, room.y + 30.0, 136.0, 104.0};
  draw_card(canvas, corner, 4.0);
  const Projection all =
      fitted(view.projection.camera, corner.inset(6.0, 6.0, 6.0, 6.0), {&o.surface_mm}, 0.0);
  canvas.clip(corner);
  draw_pieces(canvas, cut(all, o.surface_mm, o.surface_triangles, centre), 1.2, soft_ink);
  const double zoom = all.scale / view.projection.scale;
  const Vec2 half = 0.5 * zoom * Vec2(view.shown.w, view.shown.h), across(half.x(), -half.y());
  const Vec2 middle(all.centre.x() + all.scale * (view.projection.middle_mm.x() - all.middle_mm.x()),
                    all.centre.y() - all.scale * (view.projection.middle_mm.y() - all.middle_mm.y()));
  canvas.curve({middle - half, middle + across, middle + half, middle - across, middle - half}, 1.8,
               tool_ink);
  canvas.clip();
}

/// Lines in which walls cross the section.
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

/// The nodes and integration points of a slab of that thickness.
void draw_slab(Canvas& canvas, const Overview& o, const SectionView& view, const Vec3& centre,
               double thickness, double spacing) {
  const auto in_slab = [&](const Vec3& p) {
    return usable(p) && std::abs((p - centre).dot(view.projection.camera.toward)) <= thickness / 2.0;
  };
  const double step = spacing * view.projection.scale;  // approximate distance of nodes on the picture
  const double arm = std::clamp(0.16 * step, 1.5, 5.0), dot = std::clamp(0.20 * step, 1.2, 6.0);
  for (Index q = 0; q < o.points_mm.cols(); ++q) {
    if (!in_slab(o.points_mm.col(q))) continue;
    const Vec2 p = view.at(o.points_mm.col(q));
    canvas.line(p - Vec2(arm, 0.0), p + Vec2(arm, 0.0), 1.1, cross);
    canvas.line(p - Vec2(0.0, arm), p + Vec2(0.0, arm), 1.1, cross);
  }
  for (const bool special : {false, true})
    for (Index n = 0; n < o.nodes_mm.cols(); ++n) {
      const int set = set_of(o, n);
      if (special == (set == 0) || !in_slab(o.nodes_mm.col(n))) continue;
      canvas.disc(view.at(o.nodes_mm.col(n)), special ? 1.25 * dot : dot,
                  special ? colour_of(set) : node_dot);
    }
}

/// The spacing of the nodes that a section of the tool's surroundings shows.
double spacing_near(const Overview& o, const SectionView& view, const Vec3& centre) {
  const double reach = 0.5 * view.shown.w / view.projection.scale;
  std::vector<Index> near;
  for (Index n = 0; n < o.nodes_mm.cols(); ++n)
    if ((o.nodes_mm.col(n) - centre).norm() < reach) near.push_back(n);
  return node_spacing(o.nodes_mm(Eigen::all, near));
}

void draw_section(Canvas& canvas, const Rect& rect, const Overview& o, const BodyFrame& frame,
                  double spacing) {
  const Vec3 centre = usable(o.centre_mm) ? o.centre_mm : Vec3(Vec3::Zero());
  const Vec3 there = usable(o.axis_mm) ? o.axis_mm : centre;  // loads and steps have moved the tool
  const SectionView view = section_view(room_of(rect), o, camera(frame, 0.0, 0.0), there, spacing / 2.0);
  if (view.near) spacing = spacing_near(o, view, centre);
  const double thickness = 1.25 * spacing;
  const Rect room =
      draw_panel(canvas, rect, view.near ? "Section at the tool" : "Section through the tool's axis",
                 fmt::format("nodes at rest in a slab of {} mm", three_digits(thickness)));
  const bool has_surface = o.surface_triangles.cols() > 0;
  canvas.clip(view.shown);
  // The tool first, below everything that it presses upon.
  draw_tool(canvas, o, view, there);
  draw_walls(canvas, o.walls, view, there);
  draw_pieces(canvas, cut(view.projection, o.surface_mm, o.surface_triangles, centre), 1.2,
              mixed(soft_ink, card, 0.2F));
  draw_slab(canvas, o, view, centre, thickness, spacing);
  if (o.surface_displacement_mm.cols() == o.surface_mm.cols())
    draw_pieces(
        canvas,
        cut(view.projection, moved(o.surface_mm, o.surface_displacement_mm), o.surface_triangles, there), 1.8,
        bonded_patch);
  canvas.clip();
  if (view.near && has_surface) draw_where(canvas, room, view, o, centre);
  std::vector<LegendEntry> entries = {{"node", node_dot, Mark::dot},
                                      {"integration point", cross, Mark::cross},
                                      {"outline at rest", soft_ink, Mark::line},
                                      {o.moment, bonded_patch, Mark::line}};
  if (o.walls) entries.push_back({"wall", wall_ink, Mark::line});
  for (const LegendEntry& entry : tool_entry(o)) entries.push_back(entry);
  draw_corners(canvas, room, view.projection, entries);
}

// ----------------------------------------------------------------------------------------------------- body

/// Colours from 0 to `most` mm with a number at every step, at the right edge.
void draw_colour_bar(Canvas& canvas, const Rect& room, double most_mm) {
  const Rect bar{room.x + room.w - 76.0, room.y + 40.0, 14.0, room.h - 110.0};
  const int rows = static_cast<int>(bar.h * fine);
  for (int i = 0; i < rows; ++i) {
    const double y = bar.y + bar.h * (1.0 - (i + 1.0) / rows);
    canvas.rectangle({bar.x, y, bar.w, std::min(2.0 / fine, bar.y + bar.h - y)},
                     warm_colour((i + 0.5) / rows));
  }
  canvas.text({bar.x - 2.0, bar.y - 12.0}, "mm", small);
  const double step = round_below(most_mm / 3.9);
  for (double value = 0.0; value <= most_mm * (1.0 + 1e-9); value += step) {
    const double y = bar.y + bar.h * (1.0 - value / most_mm);
    canvas.line({bar.x + bar.w, y}, {bar.x + bar.w + 5.0, y}, 1.2, ink);
    canvas.text({bar.x + bar.w + 10.0, y + 5.0}, tick_text(value, step), small);
  }
}

/// Smaller displacements are rounding: invisible at the tool's size [mm].
double least_seen(const Overview& o) {
  return std::max(1e-9, 1e-5 * o.radius_mm);
}

/// The body at the end, not yet on the canvas. It has no text, which VTK sets in one thread only.
struct Deformed {
  bool has_surface = false, empty = false;
  double most_mm = 0.0;  ///< displacement
  Projection projection;
  DepthImage image;
};

Points normals_of(const Points& surface, const Triangles& triangles) {
  Points normal = Points::Zero(3, surface.cols());
  const auto corner = [&](Index c, Index t) { return surface.col(triangles(c, t)); };
  for (Index t = 0; t < triangles.cols(); ++t) {
    const Vec3 n = (corner(1, t) - corner(0, t)).cross(corner(2, t) - corner(0, t));
    if (!n.allFinite()) continue;
    for (int c = 0; c < 3; ++c) normal.col(triangles(c, t)) += n;
  }
  for (Index v = 0; v < normal.cols(); ++v) normal.col(v).normalize();
  return normal;
}

/// Draws the surface in the colours of `level` at the corners.
void draw_surface(DepthImage& image, const Points& surface, const Triangles& triangles,
                  const std::vector<double>& level) {
  const Points normal = normals_of(surface, triangles);
  for (const auto& t : triangles.colwise()) {
    const Index a = t[0], b = t[1], c = t[2];
    if (!usable(surface.col(a)) || !usable(surface.col(b)) || !usable(surface.col(c))) continue;
    const auto at = [&](Index n) { return level[static_cast<std::size_t>(n)]; };
    image.triangle(
        {surface.col(a), surface.col(b), surface.col(c)}, {normal.col(a), normal.col(b), normal.col(c)},
        [&](double u, double v, double w) { return warm_colour(u * at(a) + v * at(b) + w * at(c)); });
  }
}

void draw_flat_faces(DepthImage& image, const Points& tool, const Triangles& triangles) {
  if (!tool.allFinite()) return;
  for (const auto& t : triangles.colwise()) {
    const Vec3 a = tool.col(t[0]), b = tool.col(t[1]), c = tool.col(t[2]), n = (b - a).cross(c - a);
    image.triangle({a, b, c}, {n, n, n}, [](double, double, double) { return tool_metal; });
  }
}

Deformed deformed(const Rect& room, const Overview& o, const BodyFrame& frame, double spacing) {
  const Points nodes = moved(o.nodes_mm, o.displacement_mm);
  const Points surface = moved(o.surface_mm, o.surface_displacement_mm);
  const bool has_surface = o.surface_triangles.cols() > 0 && surface.cols() > 0;
  const Points& shown = has_surface ? o.surface_displacement_mm : o.displacement_mm;
  std::vector<double> level(static_cast<std::size_t>(std::max(nodes.cols(), surface.cols())), 0.0);
  double most = 0.0;
  for (Index n = 0; n < std::min<Index>(shown.cols(), static_cast<Index>(level.size())); ++n) {
    if (usable(shown.col(n))) level[static_cast<std::size_t>(n)] = shown.col(n).norm();
    most = std::max(most, level[static_cast<std::size_t>(n)]);
  }
  for (double& l : level) l = most > least_seen(o) ? l / most : 0.0;

  const Points tool = tool_at_the_end(o);
  const Projection projection = fitted(camera(frame, 42.0, 18.0), room.inset(20.0, 34.0, 100.0, 44.0),
                                       {&nodes, &surface, &tool}, spacing / 2.0);
  DepthImage image(projection, room);
  draw_flat_faces(image, tool, o.tool_triangles);
  if (has_surface) draw_surface(image, surface, o.surface_triangles, level);
  for (Index n = 0; n < nodes.cols(); ++n) {
    if (!usable(nodes.col(n))) continue;
    // Nodes are a little inside the skin. Those of the contact patch are lifted so that they are visible
    // through it, but not through an edge. A contacting tool hides them.
    if (is_bonded_patch(set_of(o, n)) && o.tool_triangles.cols() > 0) continue;
    if (is_bonded_patch(set_of(o, n)))
      image.ball(nodes.col(n), 0.27 * spacing, bonded_patch, 0.75 * spacing);
    else if (!has_surface)
      image.ball(nodes.col(n), 0.42 * spacing, warm_colour(level[static_cast<std::size_t>(n)]));
  }
  return {has_surface, !has_surface && nodes.cols() == 0, most, projection, std::move(image)};
}

void draw_body(Canvas& canvas, const Rect& room, const Overview& o, const Deformed& body, double spacing) {
  if (body.empty) say_in_the_middle(canvas, room, "no surface and no nodes");
  body.image.lay_on(canvas, 2.0 * spacing);
  if (body.most_mm > least_seen(o)) draw_colour_bar(canvas, room, body.most_mm);
  const std::vector<LegendEntry> tool = tool_entry(o);
  draw_corners(canvas, room, body.projection,
               tool.empty()
                   ? std::vector<LegendEntry>{{"nodes of the contact patch", bonded_patch, Mark::dot}}
                   : tool);
}

void draw_dimple(Canvas& canvas, const Rect& rect, const Overview& o, const Deformed& body, double spacing) {
  draw_body(canvas,
            draw_panel(canvas, rect, body.has_surface ? "Deformed surface" : "Deformed nodes",
                       body.most_mm > least_seen(o) ? fmt::format("coloured by displacement {}, up to {} mm",
                                                                  o.moment, three_digits(body.most_mm))
                                                    : "not displaced " + o.moment),
            o, body, spacing);
}

// ----------------------------------------------------------------------------------------------------- force

/// Series of the common part of two lists: force [N] times `per_N` over depth [mm] or time [s].
ChartSeries series_of(const std::vector<double>& along, const std::vector<double>& force_N, double per_N) {
  ChartSeries series;
  for (std::size_t i = 0; i < std::min(along.size(), force_N.size()); ++i) {
    series.x.push_back(along[i]);
    series.y.push_back(per_N * force_N[i]);
  }
  return series;
}

double largest_of(const std::vector<double>& values) {
  double largest = 0.0;
  for (const double v : values)
    if (std::isfinite(v) && std::abs(v) > std::abs(largest)) largest = v;
  return largest;
}

void draw_force(Canvas& canvas, const Rect& rect, const Overview& o) {
  const bool has_error_bounds =
                 !o.low_N.empty() && o.low_N.size() == o.half_N.size() && o.half_N.size() == o.force_N.size(),
             in_time = !o.time_s.empty();
  const Rect room = draw_panel(
      canvas, rect, in_time ? "Force over time" : "Force against indentation",
      fmt::format("{}; {}",
                  o.tool.empty() ? "reaction of the contact patch's nodes" : "contact force on the tool",
                  has_error_bounds ? "shaded: discretisation error" : "no error estimate"));
  const double largest = std::max({std::abs(largest_of(o.force_N)), std::abs(largest_of(o.compared_force_N)),
                                   std::abs(largest_of(o.lateral_N))});
  const Written written = force_written(largest);
  Chart chart{.x_label = in_time ? "time [s]" : "indentation [mm]",
              .y_label = fmt::format("force [{}]", written.unit)};
  ChartSeries force = series_of(in_time ? o.time_s : o.depth_mm, o.force_N, written.per_unit),
              compared = series_of(o.compared_depth_mm, o.compared_force_N, written.per_unit),
              lateral = series_of(o.time_s, o.lateral_N, written.per_unit);
  if (force.x.empty()) return say_in_the_middle(canvas, room, "no force recorded");
  force.markers = lateral.markers = compared.line = false;
  if (has_error_bounds)
    for (std::size_t i = 0; i < force.x.size(); ++i) {
      force.low.push_back(written.per_unit * o.low_N[i]);
      force.high.push_back(written.per_unit * (o.force_N[i] + o.half_N[i]));
    }
  force.end = end_of_curve(o);
  force.name = !lateral.x.empty() ? "along the approach direction" : !compared.x.empty() ? "this run" : "";
  lateral.name = "across it";
  compared.name = o.compared;
  lateral.colour = compared.colour = 2;
  chart.series.push_back(force);
  if (!compared.x.empty()) chart.series.push_back(compared);
  if (!lateral.x.empty()) chart.series.push_back(lateral);
  draw_plot(canvas, room.inset(6.0, 0.0, 0.0, 0.0), chart);
}

void check(const Triangles& triangles, const Points& points) {
  if (triangles.size() > 0 && (triangles.minCoeff() < 0 || triangles.maxCoeff() >= points.cols()))
    throw std::invalid_argument(fmt::format("triangle corners run from {} to {}, on {} points",
                                            triangles.minCoeff(), triangles.maxCoeff(), points.cols()));
}

void check(const Overview& overview) {
  check(overview.surface_triangles, overview.surface_mm);
  check(overview.tool_triangles, overview.tool_mm);
}

}  // namespace

std::string end_of_curve(const Overview& o) {
  if (o.force_N.empty()) return {};
  const double force_N = o.force_N.back();
  if (!o.time_s.empty()) {
    const double largest = largest_of(o.force_N);
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
  constexpr int width = 1600, height = 1200;
  constexpr double edge = picture_edge, between = 14.0, inner = width - 2.0 * edge - 8.0;
  Canvas canvas(width, height);
  std::vector<std::string> warnings;
  for (const std::string& text : overview.warnings) warnings.push_back("Warning: " + text);
  warnings = rows_of(warnings, inner - 20.0, warning_style, 6, 2);
  draw_title(canvas, overview.title, warnings);
  const double top = 66.0 + (warnings.empty() ? 0.0 : height_of_rows(warnings) + between);

  // Facts at the bottom get the height that they need, the panels the rest.
  const std::vector<std::string> facts = rows_of(overview.lines, inner, fact_style, 11, 4);
  const double strip = height_of_rows(facts);
  draw_facts(canvas, height - edge - strip, facts);

  const double w = (width - 2.0 * edge - between) / 2.0;
  const double h = (height - top - edge - strip - between) / 2.0;
  const double right = edge + w + between, low = top + h + between;
  const BodyFrame frame = frame_of(overview);
  const double spacing = node_spacing(overview.nodes_mm);
  const Rect at_the_end{edge, low, w, h};
  auto body = std::async(overview.two_threads ? std::launch::async : std::launch::deferred,
                         [&] { return deformed(room_of(at_the_end), overview, frame, spacing); });
  draw_nodes(canvas, {edge, top, w, h}, overview, frame, spacing);
  draw_section(canvas, {right, top, w, h}, overview, frame, spacing);
  draw_dimple(canvas, at_the_end, overview, body.get(), spacing);
  draw_force(canvas, {right, low, w, h}, overview);
  write_file(file, canvas.bytes());
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
  return canvas.bytes();
}

}  // namespace dimple
