#include "preprocess/surface/surface_cells.hpp"

#include <tbb/parallel_invoke.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "io/stop.hpp"
#include "preprocess/image/voxel_set.hpp"

namespace dimple {
namespace {

constexpr double cell_edges = 1.2;  // of a cell, in edges of the mean triangle
constexpr double most_cells = 4e6;
constexpr double doubt = 1e-10;    // of the body's size: smaller distances are not distinguished
constexpr double one_side = 1e-6;  // of the body's size: from a plane, far beyond rounding, even for slivers
constexpr int farthest_ring = 32;  // cells: clear_ is a lower bound beyond

// Changes 0 in some cells and the farthest ring in all others to each cell's ring around the nearest 0. One
// pass forward and one back, each using the neighbours it has visited.
void count_rings(std::vector<unsigned char>& ring, const Eigen::Array3i& n) {
  const auto length = static_cast<std::size_t>(n[0]);
  std::vector<unsigned char> least(length + 2, farthest_ring);  // of the rows passed, one more at either end
  const auto pass = [&](int step) {
    for (int kk = 0; kk < n[2]; ++kk) {
      stop_if_requested();
      const int k = step > 0 ? kk : n[2] - 1 - kk;
      for (int jj = 0; jj < n[1]; ++jj) {
        const int j = step > 0 ? jj : n[1] - 1 - jj;
        const auto row_at = [&](int b, int c) {
          return ring.data() + length * (static_cast<std::size_t>(b) +
                                         static_cast<std::size_t>(n[1]) * static_cast<std::size_t>(c));
        };
        std::fill(least.begin(), least.end(), static_cast<unsigned char>(farthest_ring));
        const auto look_at = [&](int b, int c) {
          if (b < 0 || b >= n[1] || c < 0 || c >= n[2]) return;
          const unsigned char* other = row_at(b, c);
          for (std::size_t i = 0; i < length; ++i) least[i + 1] = std::min(least[i + 1], other[i]);
        };
        look_at(j - step, k);
        for (const int b : {j - 1, j, j + 1}) look_at(b, k - step);
        unsigned char* row = row_at(j, k);
        for (std::size_t i = 0; i < length; ++i)
          row[i] = std::min(row[i],
                            static_cast<unsigned char>(std::min({least[i], least[i + 1], least[i + 2]}) + 1));
        for (std::size_t i = 1; i < length; ++i) {
          const std::size_t at = step > 0 ? i : length - 1 - i, before = step > 0 ? at - 1 : at + 1;
          row[at] = std::min(row[at], static_cast<unsigned char>(row[before] + 1));
        }
      }
    }
  };
  pass(1);
  pass(-1);
}

}  // namespace

// Closest point on a triangle: Ericson, Real-Time Collision Detection, 5.1.5.
double distance2_to_triangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return ap.squaredNorm();
  const Vec3 bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return bp.squaredNorm();
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return (ap - d1 / (d1 - d3) * ab).squaredNorm();
  const Vec3 cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return cp.squaredNorm();
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return (ap - d2 / (d2 - d6) * ac).squaredNorm();
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0)
    return (bp - (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b)).squaredNorm();
  const double all = va + vb + vc;
  return (ap - vb / all * ab - vc / all * ac).squaredNorm();
}

SurfaceCells::SurfaceCells(const Points& vertex, const Triangles& triangles) {
  tbb::parallel_invoke([&] { boxes_ = BoxTree(vertex, triangles); },
                       [&] { sort_into_cells(vertex, triangles); });
}

void SurfaceCells::sort_into_cells(const Points& vertex, const Triangles& triangles) {
  const Index count = triangles.cols();
  corner_.resize(static_cast<std::size_t>(count));
  normal_.resize(3, count);
  double area = 0.0;
  for (Index t = 0; t < count; ++t) {
    Corners& at = corner_[static_cast<std::size_t>(t)];
    at = {vertex.col(triangles(0, t)), vertex.col(triangles(1, t)), vertex.col(triangles(2, t))};
    const Vec3 n = (at.b - at.a).cross(at.c - at.a);
    area += 0.5 * n.norm();
    normal_.col(t) = n.norm() > 0.0 ? Vec3(n.normalized()) : Vec3(Vec3::Zero());
  }
  const Vec3 lower = vertex.rowwise().minCoeff(), upper = vertex.rowwise().maxCoeff();
  size_ = (upper - lower).norm();
  const double margin = 1e-6 * size_;
  const Vec3 extent = (upper - lower).array() + 2.0 * margin;
  edge_ = std::max(cell_edges * std::sqrt(2.0 * area / static_cast<double>(count)),
                   std::cbrt(extent.prod() / most_cells));
  origin_ = lower.array() - margin;
  n_ = (extent.array() / edge_).ceil().cast<int>().max(1);

  const auto cells =
      static_cast<std::size_t>(n_[0]) * static_cast<std::size_t>(n_[1]) * static_cast<std::size_t>(n_[2]);
  const auto each = [&](auto&& with) {
    for (Index t = 0; t < count; ++t) {
      if (t % 65536 == 0) stop_if_requested();
      const Corners& at = corner_[static_cast<std::size_t>(t)];
      const Cell first = cell_of(at.a.cwiseMin(at.b).cwiseMin(at.c).array() - margin).max(0),
                 last = cell_of(at.a.cwiseMax(at.b).cwiseMax(at.c).array() + margin).min(n_ - 1);
      for (int k = first[2]; k <= last[2]; ++k)
        for (int j = first[1]; j <= last[1]; ++j)
          for (int i = first[0]; i <= last[0]; ++i) with(number({i, j, k}), static_cast<int>(t));
    }
  };
  offset_.assign(cells + 1, 0);
  each([&](std::size_t c, int) { ++offset_[c + 1]; });
  for (std::size_t c = 0; c < cells; ++c) offset_[c + 1] += offset_[c];
  member_.resize(static_cast<std::size_t>(offset_[cells]));
  std::vector<int> next(offset_.begin(), offset_.end() - 1);
  each([&](std::size_t c, int t) { member_[static_cast<std::size_t>(next[c]++)] = t; });

  // Number of cells to the next one with a triangle, in the maximum norm.
  clear_.assign(cells, farthest_ring);
  for (std::size_t c = 0; c < cells; ++c)
    if (offset_[c + 1] > offset_[c]) clear_[c] = 0;
  count_rings(clear_, n_);
  side_.assign(cells, Side::mixed);
}

SurfaceCells::Cell SurfaceCells::cell_of(const Vec3& x) const {
  Cell cell;
  for (int d = 0; d < 3; ++d) {
    const double at = std::min(std::max((x[d] - origin_[d]) / edge_, -2.0), n_[d] + 1.0);
    const int below = static_cast<int>(at);
    cell[d] = below - (at < below ? 1 : 0);  // std::floor() is a call
  }
  return cell;
}

void SurfaceCells::mark_clear_cells(const std::function<bool(const Vec3&)>& is_inside) {
  VoxelSet clear{.first = {}, .size = {n_[0], n_[1], n_[2]}, .stretch = {}, .offset = {0}};
  std::vector<Cell> seed;  // of each stretch
  for (int k = 0; k < n_[2]; ++k)
    for (int j = 0; j < n_[1]; ++j) {
      const unsigned char* row = clear_.data() + number({0, j, k});
      for (int i = 0; i < n_[0]; ++i) {
        if (row[i] == 0) continue;
        const int begin = i;
        while (i < n_[0] && row[i] != 0) ++i;
        clear.stretch.push_back({begin, i});
        seed.push_back({begin, j, k});
      }
      clear.offset.push_back(clear.stretch.size());
    }
  const Pieces groups = face_connected(clear);
  std::vector<Side> side(groups.piece.size(), Side::mixed);
  for (std::size_t s = 0; s < seed.size(); ++s) {
    Side& here = side[static_cast<std::size_t>(groups.of_stretch[s])];
    if (here == Side::mixed) {
      stop_if_requested();
      const Vec3 centre = origin_ + edge_ * (seed[s].cast<double>() + 0.5).matrix();
      const std::optional<bool> answer = inside_by_lines(centre);
      here = (answer ? *answer : is_inside(centre)) ? Side::inside : Side::outside;
    }
    const auto first = side_.begin() + static_cast<std::ptrdiff_t>(number(seed[s]));
    std::fill(first, first + (clear.stretch[s].end - clear.stretch[s].begin), here);
  }
}

// Inside test for a cell without triangles: counts the crossings of the surface on a line out of the grid.
std::optional<bool> SurfaceCells::inside_by_lines(const Vec3& x) const {
  std::vector<Hit> hits;
  for (int d = 0; d < 3; ++d)
    for (const bool up : {true, false}) {
      const double end = origin_[d] + (up ? edge_ * (n_[d] + 1) : -edge_);
      if (line(x, d, std::min(x[d], end), std::max(x[d], end), hits)) return hits.size() % 2 == 1;
    }
  return std::nullopt;
}

std::optional<bool> SurfaceCells::contains(const Vec3& x) const {
  const Cell at = cell_of(x);
  if (!in_grid(at)) return false;
  if (side_[number(at)] != Side::mixed) return side_[number(at)] == Side::inside;
  // Along the axis on which a cell without triangles is nearest: counts the crossings of the surface.
  thread_local std::vector<Hit> hits;
  for (int away = 1; away < farthest_ring; ++away)
    for (int d = 0; d < 3; ++d)
      for (const int step : {-1, 1}) {
        Cell there = at;
        there[d] += step * away;
        const bool beyond = !in_grid(there);
        if (!beyond && side_[number(there)] == Side::mixed) continue;
        const double end = origin_[d] + edge_ * (there[d] + (step > 0 ? 0.0 : 1.0));
        const double from = std::min(x[d], end), to = std::max(x[d], end);
        const double slack = 2.0 * doubt * size_;
        if (!line(x, d, from - slack, to + slack, hits)) continue;  // past an edge: another axis may be clear
        bool inside = !beyond && side_[number(there)] == Side::inside;
        for (const Hit& hit : hits) {
          if (std::abs(hit.at - x[d]) <= doubt * size_) return std::nullopt;
          if (hit.at > from && hit.at < to) inside = !inside;
        }
        return inside;
      }
  return std::nullopt;
}

bool SurfaceCells::line(const Vec3& x, int axis, double from, double to, std::vector<Hit>& hits) const {
  hits.clear();
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  Vec3 begin = x, end = x;
  begin[axis] = from;
  end[axis] = to;
  Cell at = cell_of(begin);
  const int first = std::max(at[axis], 0), last = std::min(cell_of(end)[axis], n_[axis] - 1);
  at[axis] = 0;
  if (!in_grid(at)) return true;
  for (at[axis] = first; at[axis] <= last; ++at[axis]) {
    const std::size_t c = number(at);
    for (int m = offset_[c]; m < offset_[c + 1]; ++m) {
      const int t = member_[static_cast<std::size_t>(m)];
      const Corners& corner = corner_[static_cast<std::size_t>(t)];
      const Vec3* const p[3] = {&corner.a, &corner.b, &corner.c};
      // Twice the areas of the line's place with each edge; opposite corner k.
      std::array<double, 3> area;
      bool near = false;
      int positive = 0, negative = 0;
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3 &a = *p[(k + 1) % 3], &b = *p[(k + 2) % 3];
        const double du = b[u] - a[u], dv = b[v] - a[v];
        area[k] = du * (x[v] - a[v]) - dv * (x[u] - a[u]);
        if (std::abs(area[k]) <= doubt * size_ * (std::abs(du) + std::abs(dv)))
          near = true;
        else
          ++(area[k] > 0.0 ? positive : negative);
      }
      if (positive > 0 && negative > 0) continue;
      const double all = area[0] + area[1] + area[2];
      if (near || std::abs(all) < 1e-6 * edge_ * edge_) return false;
      const double place =
          (area[0] * (*p[0])[axis] + area[1] * (*p[1])[axis] + area[2] * (*p[2])[axis]) / all;
      if (place < from || place > to) continue;
      if (std::none_of(hits.begin(), hits.end(), [&](const Hit& hit) { return hit.triangle == t; }))
        hits.push_back({t, place});
    }
  }
  return true;
}

double SurfaceCells::nearest(const Vec3& x, std::vector<Index>& candidates) const {
  struct Visit {
    const SurfaceCells& surface;
    const Vec3& x;
    double least, slack;
    std::vector<std::pair<double, Index>>& found;
    double reach() const { return least + slack + doubt * least; }
    void triangle(int t) {
      const double distance = surface.distance_to(x, t);
      if (distance > reach()) return;
      least = std::min(least, distance);
      found.push_back({distance, t});
    }
  };
  // Queries are near each other: the last nearest triangle bounds the search.
  thread_local std::size_t last = 0;
  thread_local std::vector<std::pair<double, Index>> found;
  found.clear();
  Visit visit{*this, x, std::numeric_limits<double>::infinity(), doubt * size_, found};
  if (last < corner_.size()) visit.least = distance_to(x, static_cast<int>(last));
  boxes_.around(x, visit);
  candidates.clear();
  for (const auto& [distance, t] : found)
    if (distance <= visit.reach()) candidates.push_back(t);
  if (!candidates.empty()) last = static_cast<std::size_t>(candidates.front());
  return visit.least;
}

std::optional<bool> SurfaceCells::farther(const Vec3& x, double d) const {
  struct Visit {
    const SurfaceCells& surface;
    const Vec3& x;
    double limit, least = std::numeric_limits<double>::infinity();
    double reach() const { return least > limit ? limit : -1.0; }  // found: the search ends
    void triangle(int t) { least = std::min(least, surface.distance_to(x, t)); }
  };
  const double slack = doubt * size_;
  Visit visit{.surface = *this, .x = x, .limit = d + slack};
  boxes_.around(x, visit);
  if (visit.least > d + slack) return true;
  if (visit.least < d - slack) return false;
  // One within rounding of d was met: another may be clearly nearer.
  Visit nearer{.surface = *this, .x = x, .limit = d - slack};
  boxes_.around(x, nearer);
  return nearer.least < d - slack ? std::optional<bool>(false) : std::nullopt;
}

void SurfaceCells::pass(const Vec3& from, const Vec3& to, std::vector<Crossing>& crossings,
                        bool to_first_entry) const {
  crossings.clear();
  const Vec3 segment = to - from;
  const double length = segment.norm();
  if (!(length > 0.0)) return;
  const double least = 1e-6 * edge_ / length;  // of progress: more than rounding
  double t = 0.0;
  while (t <= 1.0) {
    const Vec3 x = from + t * segment;
    const Cell at = cell_of(x);
    // Rings of cells without a triangle around this one, and the exit of the segment from them.
    const bool known = in_grid(at);
    const int free = known ? std::max(static_cast<int>(clear_[number(at)]) - 1, 0) : 0;
    const Vec3 low = origin_ + edge_ * (at - free).cast<double>().matrix(),
               high = origin_ + edge_ * (at + free + 1).cast<double>().matrix();
    double next = 2.0;
    for (int d = 0; d < 3; ++d)
      if (segment[d] != 0.0)
        next = std::min(next, ((segment[d] > 0.0 ? high[d] : low[d]) - from[d]) / segment[d]);
    if (known) {
      const std::size_t c = number(at);
      for (int m = offset_[c]; m < offset_[c + 1]; ++m) {
        const int triangle = member_[static_cast<std::size_t>(m)];
        const Corners& corner = corner_[static_cast<std::size_t>(triangle)];
        // Most triangles have this part of the segment surely on one side of their plane. Another part may
        // cross it: in a cell that has the triangle too.
        const Vec3 normal = normal_.col(triangle);
        const double above = normal.dot(from - corner.a), rise = normal.dot(segment);
        const double here = above + t * rise, later = above + next * rise;
        if (here * later > 0.0 && std::min(std::abs(here), std::abs(later)) > one_side * size_) continue;
        // Moeller & Trumbore, J. Graphics Tools 2 (1997) 21; a little beyond the edges, so that none is
        // missed.
        const Vec3 ab = corner.b - corner.a, ac = corner.c - corner.a, p = segment.cross(ac);
        const double determinant = ab.dot(p);
        const double parallel = 1e-24 * length * length * ab.squaredNorm() * ac.squaredNorm();
        if (determinant * determinant < parallel) continue;
        const Vec3 s = (from - corner.a) / determinant;
        const double u = s.dot(p);
        if (u < -doubt || u > 1.0 + doubt) continue;
        const Vec3 q = s.cross(ab);
        const double v = segment.dot(q);
        if (v < -doubt || u + v > 1.0 + doubt) continue;
        const double place = ac.dot(q);
        if (place < 0.0 || place > 1.0) continue;
        if (std::none_of(crossings.begin(), crossings.end(),
                         [&](const Crossing& other) { return other.triangle == triangle; }))
          crossings.push_back({triangle, place, determinant < 0.0});
      }
    }
    if (next <= t && !known) break;  // away from the body
    if (to_first_entry && std::any_of(crossings.begin(), crossings.end(),
                                      [&](const Crossing& one) { return !one.leave && one.t <= next; }))
      break;
    t = std::max(next, t) + least;
  }
  std::sort(crossings.begin(), crossings.end(), [](const Crossing& a, const Crossing& b) {
    return std::pair(a.t, a.triangle) < std::pair(b.t, b.triangle);
  });
}

bool SurfaceCells::any_above(const Vec3& x, double d, double above) const {
  struct Visit {
    const SurfaceCells& surface;
    const Vec3& x;
    double d, above;
    bool found = false;
    double reach() const { return found ? -1.0 : d; }
    void triangle(int t) {
      if (found || surface.height(x, t) <= above) return;
      const Corners& at = surface.corner_[static_cast<std::size_t>(t)];
      found = distance2_to_triangle(x, at.a, at.b, at.c) < d * d;
    }
  };
  Visit visit{*this, x, d, above};
  boxes_.around(x, visit);
  return visit.found;
}

}  // namespace dimple
