#include "tests/bench/peer/hexahedra.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

using Vec2 = Eigen::Vector2d;

// An edge by the numbers of its ends, the lesser first.
using Edge = std::pair<Index, Index>;
Edge edge(Index a, Index b) {
  return {std::min(a, b), std::max(a, b)};
}

constexpr double core = 0.5;  // half an edge of the square inside the circle / radius
// Nothing changes as fast along the rim as across it: cells there may be this much longer.
constexpr double along_rim = 8.0;

// Refused above it: a mesh for a check, not for a machine's memory.
constexpr double most_cells = 3e6;

void refuse_too_many(double cells, double spacing_mm) {
  if (!(cells <= most_cells))
    throw ModelError({.fact = fmt::format("the mesh would have over {:.0f} hexahedra", most_cells),
                      .where = "hexahedral mesh",
                      .why = fmt::format("cells of {:.3g} mm are small for this body", spacing_mm),
                      .remedy = "give a larger cloud.spacing_mm, fewer cloud.nodes or a coarser cloud.rim",
                      .code = "too-large"});
}

// 0 = p[0] < ... < p[n] = length, steps growing as min(far, near + slope p).
std::vector<double> graded(double length, double near, double slope, double far) {
  // The integral of dp / step(p), which becomes the number of steps.
  const double bend = std::min(length, slope > 0.0 ? (far - near) / slope : 0.0);
  const auto steps_to = [&](double p) {
    const double q = std::min(p, bend);
    return (slope > 0.0 ? std::log1p(slope * q / near) / slope : 0.0) + (p - q) / far;
  };
  const double all = steps_to(length);
  refuse_too_many(all, far);
  const int n = std::max(1, static_cast<int>(std::lround(all)));
  std::vector<double> place(static_cast<std::size_t>(n) + 1, length);
  for (int k = 0; k < n; ++k) {
    const double wanted = all * k / n, at_bend = steps_to(bend);
    place[static_cast<std::size_t>(k)] = wanted < at_bend || bend >= length
                                             ? near * std::expm1(slope * wanted) / slope
                                             : bend + far * (wanted - at_bend);
  }
  return place;
}

// Eight-node quadrilaterals across the push, about the circle's axis.
struct Plane {
  std::vector<Vec2> corner;
  std::vector<std::array<Index, 4>> quads;  // counter-clockwise
  std::map<Edge, Vec2> middle;
};

struct Outline {
  Vec2 lower, upper;
};

// Corner j of 4n around: side j / n of the square, t from -1 to 1 along it.
struct Around {
  double radius;
  Outline outline;
  int n;  // cells along a side

  std::pair<int, double> side_of(double j) const {
    return {static_cast<int>(j / n) % 4, -1.0 + 2.0 * (j / n - std::floor(j / n))};
  }
  Vec2 on_core(double j) const {
    const auto [side, t] = side_of(j);
    const Vec2 x = core * radius * Vec2(1.0, t);
    switch (side) {
      case 0:
        return x;
      case 1:
        return {-x.y(), x.x()};
      case 2:
        return -x;
      default:
        return {x.y(), -x.x()};
    }
  }
  Vec2 on_circle(double j) const {
    const auto [side, t] = side_of(j);
    const double angle = 0.25 * std::numbers::pi * (t + 2.0 * side);
    return radius * Vec2(std::cos(angle), std::sin(angle));
  }
  Vec2 on_outline(double j) const {
    const auto [side, t] = side_of(j);
    const auto [low, up] = outline;
    const double s = 0.5 * (1.0 + t);
    switch (side) {
      case 0:
        return {up.x(), low.y() + s * (up.y() - low.y())};
      case 1:
        return {up.x() + s * (low.x() - up.x()), up.y()};
      case 2:
        return {low.x(), up.y() + s * (low.y() - up.y())};
      default:
        return {low.x() + s * (up.x() - low.x()), low.y()};
    }
  }
  // By the ring's share of the way: 0 the square, 1 the circle, 2 the outline.
  Vec2 on_ring(double share, double j) const {
    return share <= 1.0 ? (1.0 - share) * on_core(j) + share * on_circle(j)
                        : (2.0 - share) * on_circle(j) + (share - 1.0) * on_outline(j);
  }
};

// Their shares of the way, from the square's border to the outline.
std::vector<double> ring_shares(double radius, const Outline& outline, double near, double slope,
                                double far) {
  std::vector<double> rings;
  const double inner = (1.0 - 0.5 * core * (1.0 + std::numbers::sqrt2)) * radius;
  const std::vector<double> inside = graded(inner, near, slope, far);
  for (auto p = inside.rbegin(); p != inside.rend(); ++p) rings.push_back(1.0 - *p / inner);
  const double outer =
      0.25 * (outline.upper.sum() - outline.lower.sum()) - radius;  // in the mean of the four sides
  const std::vector<double> outside = graded(outer, near, slope, far);
  for (std::size_t k = 1; k < outside.size(); ++k) rings.push_back(1.0 + outside[k] / outer);
  return rings;
}

Plane make_plane(double radius, const Outline& outline, double near, double slope, double far) {
  const double circumference = 2.0 * std::numbers::pi * radius;
  const double sides = circumference / (4.0 * along_rim * near);
  refuse_too_many(sides * sides, far);
  const int n = std::max(2, static_cast<int>(std::lround(sides)));
  const Around lines{radius, outline, n};
  const std::vector<double> rings = ring_shares(radius, outline, near, slope, far);

  Plane plane;
  const int around = 4 * n;
  refuse_too_many(static_cast<double>(rings.size()) * around, far);
  for (const double share : rings)
    for (int j = 0; j < around; ++j) plane.corner.push_back(lines.on_ring(share, j));
  const auto ring_corner = [&](std::size_t ring, int j) {
    return static_cast<Index>(ring) * around + (j + around) % around;
  };
  for (std::size_t ring = 0; ring + 1 < rings.size(); ++ring)
    for (int j = 0; j < around; ++j)
      plane.quads.push_back({ring_corner(ring, j), ring_corner(ring + 1, j), ring_corner(ring + 1, j + 1),
                             ring_corner(ring, j + 1)});
  // The square: its border is the innermost ring, from its corner at (-1, -1) on: j = 3n, 0 at (1, -1).
  const auto square_corner = [&](int i, int k) {
    if (i == n) return ring_corner(0, k);
    if (k == n) return ring_corner(0, 2 * n - i);
    if (i == 0) return ring_corner(0, 3 * n - k);
    if (k == 0) return ring_corner(0, 3 * n + i);
    return static_cast<Index>(rings.size()) * around + (k - 1) * (n - 1) + (i - 1);
  };
  for (int k = 1; k < n; ++k)
    for (int i = 1; i < n; ++i)
      plane.corner.push_back(core * radius * Vec2(2.0 * i / n - 1.0, 2.0 * k / n - 1.0));
  for (int k = 0; k < n; ++k)
    for (int i = 0; i < n; ++i)
      plane.quads.push_back({square_corner(i, k), square_corner(i + 1, k), square_corner(i + 1, k + 1),
                             square_corner(i, k + 1)});
  for (const auto& q : plane.quads)
    for (std::size_t s = 0; s < 4; ++s) {
      const Index a = q[s], b = q[(s + 1) % 4];
      plane.middle[edge(a, b)] =
          0.5 * (plane.corner[static_cast<std::size_t>(a)] + plane.corner[static_cast<std::size_t>(b)]);
    }
  // Along rings the middles lie on the ring, which is round.
  for (std::size_t ring = 0; ring < rings.size(); ++ring)
    for (int j = 0; j < around; ++j)
      plane.middle[edge(ring_corner(ring, j), ring_corner(ring, j + 1))] =
          lines.on_ring(rings[ring], j + 0.5);
  return plane;
}

// Where a column along the push begins and ends, from the plane through the circle's centre [mm].
struct Ends {
  double top, bottom;
};

struct Frame {
  Vec3 centre, e1, e2, push;
  double depth;  // of the body below the circle's centre
  Vec3 operator()(const Vec2& u, double along) const {
    return centre + u.x() * e1 + u.y() * e2 + along * push;
  }
};

Frame frame_of(const BodySurface& body, const Boundary& boundary) {
  Frame f;
  f.centre = boundary.centre;
  f.push = boundary.push;
  // An image axis as far as possible: the sides of a block stay even.
  Index least = 0;
  f.push.cwiseAbs().minCoeff(&least);
  f.e1 = (Vec3::Unit(least) - f.push[least] * f.push).normalized();
  f.e2 = (-f.push).cross(f.e1);
  f.depth = (f.push.transpose() * (body.vertex().colwise() - f.centre)).maxCoeff();
  return f;
}

// The top may fall, and the bottom rise, by less than half of the depth: columns keep some length.
Ends ends_of_column(const BodySurface& body, const Frame& frame, Vec2 u) {
  const double start = -2.0 * (body.upper() - body.lower()).norm();
  // Lines beside the body or along its sides take the ends of those a little further in.
  for (int pull = 0; pull < 60; ++pull, u *= 0.98) {
    const std::vector<double> cut = body.crossings(frame(u, start), frame.push);
    if (cut.empty()) continue;
    return {std::min(cut.front() + start, 0.45 * frame.depth),
            std::max(cut.back() + start, 0.55 * frame.depth)};
  }
  return {0.0, frame.depth};
}

// Columns of cells along the push: quadrilaterals of the plane times layers.
struct Columns {
  Frame frame;
  Plane plane;
  std::vector<double> level;  // of the layers' ends, as depths from the circle's centre
  std::vector<Ends> ends;     // at each corner of the plane
  double radius;              // of the circle

  std::size_t layers() const { return level.size() - 1; }
  double along(const Ends& e, double depth) const { return e.top + depth / frame.depth * (e.bottom - e.top); }
  Vec3 corner(Index c, std::size_t k) const {
    return frame(plane.corner[static_cast<std::size_t>(c)],
                 along(ends[static_cast<std::size_t>(c)], level[k]));
  }
  bool in_circle(std::size_t q) const {
    return std::all_of(plane.quads[q].begin(), plane.quads[q].end(), [&](Index c) {
      return plane.corner[static_cast<std::size_t>(c)].norm() <= radius * (1.0 + 1e-6);
    });
  }
};

Columns columns_of(const BodySurface& body, const Boundary& boundary, const GradingOptions& grading,
                   double spacing_mm) {
  const Frame frame = frame_of(body, boundary);
  const Points from = body.vertex().colwise() - frame.centre;
  const Eigen::RowVectorXd u1 = frame.e1.transpose() * from, u2 = frame.e2.transpose() * from;
  const double least = 1.3 * boundary.radius;
  const Outline outline{{std::min(u1.minCoeff(), -least), std::min(u2.minCoeff(), -least)},
                        {std::max(u1.maxCoeff(), least), std::max(u2.maxCoeff(), least)}};
  const double near = grading.rim * spacing_mm;
  const double slope = (1.0 - grading.rim) * spacing_mm / (grading.reach * boundary.radius);
  Columns columns{.frame = frame,
                  .plane = make_plane(boundary.radius, outline, near, slope, spacing_mm),
                  .level = graded(frame.depth, near, slope, spacing_mm),
                  .ends = {},
                  .radius = boundary.radius};
  refuse_too_many(static_cast<double>(columns.plane.quads.size()) * static_cast<double>(columns.level.size()),
                  spacing_mm);
  for (const Vec2& u : columns.plane.corner) {
    stop_if_asked();
    columns.ends.push_back(ends_of_column(body, frame, u));
  }
  return columns;
}

// [quads x layers] Cells whose middle lies inside.
std::vector<char> cells_inside(const Columns& columns, const BodySurface& body) {
  const std::size_t layers = columns.layers();
  std::vector<char> inside(columns.plane.quads.size() * layers, 0);
  for (std::size_t q = 0; q < columns.plane.quads.size(); ++q)
    for (std::size_t k = 0; k < layers; ++k) {
      stop_if_asked();
      Vec3 middle = Vec3::Zero();
      for (const Index c : columns.plane.quads[q])
        middle += 0.125 * (columns.corner(c, k) + columns.corner(c, k + 1));
      inside[q * layers + k] = body.contains(middle);
    }
  return inside;
}

// Those of them that hang together with the circle.
std::vector<char> cells_at_circle(const Columns& columns, const std::vector<char>& inside) {
  const auto& quads = columns.plane.quads;
  const std::size_t layers = columns.layers();
  std::map<Edge, std::vector<std::size_t>> beside;
  for (std::size_t q = 0; q < quads.size(); ++q)
    for (std::size_t s = 0; s < 4; ++s) beside[edge(quads[q][s], quads[q][(s + 1) % 4])].push_back(q);
  std::vector<char> kept(inside.size(), 0);
  std::vector<std::size_t> front;
  const auto reach = [&](std::size_t cell) {
    if (!inside[cell] || kept[cell]) return;
    kept[cell] = 1;
    front.push_back(cell);
  };
  for (std::size_t q = 0; q < quads.size(); ++q)
    if (columns.in_circle(q)) reach(q * layers);
  while (!front.empty()) {
    stop_if_asked();
    const std::size_t q = front.back() / layers, k = front.back() % layers;
    front.pop_back();
    if (k > 0) reach(q * layers + k - 1);
    if (k + 1 < layers) reach(q * layers + k + 1);
    for (std::size_t s = 0; s < 4; ++s)
      for (const std::size_t other : beside[edge(quads[q][s], quads[q][(s + 1) % 4])])
        reach(other * layers + k);
  }
  return kept;
}

// Nodes: a corner or an edge of the plane, and a level in half layers: {level, corner, the edge's other
// corner or itself}.
using Key = std::array<Index, 3>;

struct Cell {
  std::size_t quad, layer;
  std::array<Key, 20> node;
};

std::vector<Cell> kept_cells(const Columns& columns, const std::vector<char>& kept) {
  const auto key = [](std::size_t half_level, Index a, Index b) {
    return Key{static_cast<Index>(half_level), std::min(a, b), std::max(a, b)};
  };
  std::vector<Cell> cells;
  for (std::size_t q = 0; q < columns.plane.quads.size(); ++q)
    for (std::size_t k = 0; k < columns.layers(); ++k) {
      if (!kept[q * columns.layers() + k]) continue;
      stop_if_asked();
      Cell& cell = cells.emplace_back(Cell{q, k, {}});
      for (std::size_t s = 0; s < 4; ++s) {
        const Index a = columns.plane.quads[q][s], b = columns.plane.quads[q][(s + 1) % 4];
        cell.node[s] = key(2 * k + 2, a, a);
        cell.node[4 + s] = key(2 * k, a, a);
        cell.node[8 + s] = key(2 * k + 2, a, b);
        cell.node[12 + s] = key(2 * k, a, b);
        cell.node[16 + s] = key(2 * k + 1, a, a);
      }
    }
  return cells;
}

// Corners first, then the middles of edges.
HexahedralMesh mesh_of(const Columns& columns, const std::vector<Cell>& cells) {
  HexahedralMesh mesh;
  std::map<Key, Index> number;
  Index next = 0;
  for (const bool corners : {true, false}) {
    for (const Cell& cell : cells)
      for (std::size_t v = corners ? 0 : 8; v < (corners ? 8u : 20u); ++v)
        number.try_emplace(cell.node[v], -1);
    for (auto& [where, node] : number)
      if (node < 0) node = next++;
    if (corners) mesh.corner_count = next;
  }
  mesh.X.resize(3, next);
  const std::vector<double>& level = columns.level;
  for (const auto& [where, node] : number) {
    const auto [half, a, b] = where;
    const Ends &ea = columns.ends[static_cast<std::size_t>(a)],
               &eb = columns.ends[static_cast<std::size_t>(b)];
    const Vec2 u =
        a == b ? columns.plane.corner[static_cast<std::size_t>(a)] : columns.plane.middle.at({a, b});
    const auto above = static_cast<std::size_t>(half / 2);
    const double depth = half % 2 == 0 ? level[above] : 0.5 * (level[above] + level[above + 1]);
    mesh.X.col(node) =
        columns.frame(u, columns.along({0.5 * (ea.top + eb.top), 0.5 * (ea.bottom + eb.bottom)}, depth));
  }
  mesh.hexahedra.resize(20, static_cast<Index>(cells.size()));
  for (std::size_t e = 0; e < cells.size(); ++e)
    for (std::size_t v = 0; v < 20; ++v)
      mesh.hexahedra(static_cast<Index>(v), static_cast<Index>(e)) = number.at(cells[e].node[v]);
  return mesh;
}

// Two places a direction are exact for the volume. Curved rims must not turn a cell inside out.
double volume_of(const HexahedralMesh& mesh) {
  double volume = 0.0;
  for (Index e = 0; e < mesh.hexahedra.cols(); ++e) {
    stop_if_asked();
    Eigen::Matrix<double, 3, 20> x;
    for (Index v = 0; v < 20; ++v) x.col(v) = mesh.X.col(mesh.hexahedra(v, e));
    for (int place = 0; place < 8; ++place) {
      const Vec3 corner(place & 1 ? 1.0 : -1.0, place & 2 ? 1.0 : -1.0, place & 4 ? 1.0 : -1.0);
      volume += jacobian(x, corner / std::numbers::sqrt3);
      if (jacobian(x, corner) <= 0.0)
        throw ModelError({.fact = "a hexahedron is turned inside out",
                          .where = "hexahedral mesh",
                          .why = "the body's surface is too steep for its columns of cells",
                          .remedy = "use another cloud.spacing_mm or other cloud.nodes"});
    }
  }
  return volume;
}

// Faces of one cell only are the boundary; corners, then middles, outward.
void find_base_and_circle(const HexahedralMesh& mesh, const Columns& columns, const std::vector<Cell>& cells,
                          const Boundary& boundary, std::set<Index>& base, std::set<Index>& circle) {
  static constexpr std::array<std::array<Index, 8>, 6> faces = {{{0, 3, 2, 1, 11, 10, 9, 8},
                                                                 {4, 5, 6, 7, 12, 13, 14, 15},
                                                                 {0, 1, 5, 4, 8, 17, 12, 16},
                                                                 {1, 2, 6, 5, 9, 18, 13, 17},
                                                                 {2, 3, 7, 6, 10, 19, 14, 18},
                                                                 {3, 0, 4, 7, 11, 16, 15, 19}}};
  std::map<std::array<Index, 4>, int> times;
  const auto name = [&](Index e, const std::array<Index, 8>& f) {
    std::array<Index, 4> corners{};
    for (std::size_t v = 0; v < 4; ++v) corners[v] = mesh.hexahedra(f[v], e);
    std::sort(corners.begin(), corners.end());
    return corners;
  };
  for (Index e = 0; e < mesh.hexahedra.cols(); ++e)
    for (const auto& f : faces) ++times[name(e, f)];
  for (Index e = 0; e < mesh.hexahedra.cols(); ++e)
    for (std::size_t side = 0; side < 6; ++side) {
      stop_if_asked();
      const auto& f = faces[side];
      if (times.at(name(e, f)) != 1) continue;
      const auto x = [&](std::size_t v) -> Vec3 { return mesh.X.col(mesh.hexahedra(f[v], e)); };
      const Vec3 normal = (x(2) - x(0)).cross(x(3) - x(1)).normalized();
      const Cell& cell = cells[static_cast<std::size_t>(e)];
      const bool pressed = side == 1 && cell.layer == 0 && columns.in_circle(cell.quad);
      bool held = !boundary.flat_base || normal.dot(boundary.down) > 0.9;
      for (std::size_t v = 0; v < 4; ++v) held = held && on_base(boundary, x(v), normal);
      for (const Index v : f) {
        if (pressed) circle.insert(mesh.hexahedra(v, e));
        if (held) base.insert(mesh.hexahedra(v, e));
      }
    }
}

}  // namespace

HexahedralMesh make_hexahedra(const BodySurface& body, const Boundary& boundary,
                              const GradingOptions& grading, double spacing_mm) {
  rim_of_circle(body, boundary, 48);  // refuses a circle that hangs over the edge
  const Columns columns = columns_of(body, boundary, grading, spacing_mm);
  const std::vector<Cell> cells = kept_cells(columns, cells_at_circle(columns, cells_inside(columns, body)));
  if (cells.size() < 20)
    throw ModelError({.fact = fmt::format("the mesh has {} hexahedra", cells.size()),
                      .where = "hexahedral mesh",
                      .why = fmt::format("cells of {:.3g} mm are too large for this body", spacing_mm),
                      .remedy = "give a smaller cloud.spacing_mm or more cloud.nodes"});
  HexahedralMesh mesh = mesh_of(columns, cells);
  mesh.volume_mm3 = volume_of(mesh);
  std::set<Index> base, circle;
  find_base_and_circle(mesh, columns, cells, boundary, base, circle);
  const bool both = std::any_of(base.begin(), base.end(), [&](Index v) { return circle.count(v) > 0; });
  if (base.empty() || circle.empty() || both)
    throw ModelError({.fact = both ? std::string("the tool's circle lies on the fixed base")
                                   : fmt::format("no face of the mesh lies {}",
                                                 base.empty() ? "on the base" : "in the circle"),
                      .where = "hexahedral mesh",
                      .why = fmt::format("cells of {:.3g} mm are too large for it", spacing_mm),
                      .remedy = "give a smaller cloud.spacing_mm or more cloud.nodes"});
  mesh.base.assign(base.begin(), base.end());
  mesh.circle.assign(circle.begin(), circle.end());
  return mesh;
}

double hexahedra_spacing_for_count(const BodySurface& body, const Boundary& boundary,
                                   const GradingOptions& grading, Index count) {
  // The count falls with the spacing in jumps, by a ring or a layer each: the nearest of all that are met.
  double coarse = frame_of(body, boundary).depth, fine = 0.5 * coarse, best = coarse;
  double nearest = std::numeric_limits<double>::infinity();
  std::exception_ptr last;
  const auto nodes = [&](double spacing) -> double {
    try {
      return static_cast<double>(make_hexahedra(body, boundary, grading, spacing).X.cols());
    } catch (const ModelError&) {
      last = std::current_exception();
      return 1.0;  // too coarse
    }
  };
  // What is refused however fine it is has another reason than coarseness.
  const double finest = 0.2 * std::cbrt(body.volume() / static_cast<double>(count));
  for (; nodes(fine) < static_cast<double>(count); fine *= 0.7) {
    if (fine < finest && last) std::rethrow_exception(last);
    if (fine < finest) break;
    coarse = fine;
  }
  for (int step = 0; step < 9; ++step) {
    const double middle = std::sqrt(fine * coarse);
    const double ratio = nodes(middle) / static_cast<double>(count);
    if (std::abs(std::log(ratio)) < nearest) {
      nearest = std::abs(std::log(ratio));
      best = middle;
    }
    (ratio > 1.0 ? fine : coarse) = middle;
  }
  return best;
}

double jacobian(const Eigen::Matrix<double, 3, 20>& x, const Vec3& xi) {
  static constexpr int sign[20][3] = {{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1}, {-1, -1, 1},
                                      {1, -1, 1},   {1, 1, 1},   {-1, 1, 1}, {0, -1, -1}, {1, 0, -1},
                                      {0, 1, -1},   {-1, 0, -1}, {0, -1, 1}, {1, 0, 1},   {0, 1, 1},
                                      {-1, 0, 1},   {-1, -1, 0}, {1, -1, 0}, {1, 1, 0},   {-1, 1, 0}};
  Eigen::Matrix3d J = Eigen::Matrix3d::Zero();
  for (int v = 0; v < 20; ++v) {
    const Vec3 s(sign[v][0], sign[v][1], sign[v][2]);
    const Vec3 f = Vec3::Ones() + s.cwiseProduct(xi);
    Vec3 gradient;
    for (int d = 0; d < 3; ++d) {
      const int p = (d + 1) % 3, q = (d + 2) % 3;
      if (v < 8)  // f f f (s . xi - 2) / 8
        gradient[d] = s[d] * f[p] * f[q] * (s.dot(xi) - 2.0 + f[d]) / 8.0;
      else if (sign[v][d] == 0)  // (1 - xi_d^2) f f / 4
        gradient[d] = -2.0 * xi[d] * f[p] * f[q] / 4.0;
      else {
        const int other = sign[v][p] == 0 ? q : p, flat = sign[v][p] == 0 ? p : q;
        gradient[d] = s[d] * f[other] * (1.0 - xi[flat] * xi[flat]) / 4.0;
      }
    }
    J += x.col(v) * gradient.transpose();
  }
  return J.determinant();
}

}  // namespace dimple
