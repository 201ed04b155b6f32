#include "preprocess/surface/closed_mesh.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>
#include <tuple>
#include <vector>

#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

constexpr int most_passes = 32;  // each pass halves all crowded edges except neighbours

// An edge of a triangle, from its corner to the next one.
struct Side {
  Index low, high;  // ends
  Index triangle;
  int corner;
  bool ascends;  // runs from low to high
};

// Sides by their ends and then by triangle, first binned by the lower end: sorting all together is slow.
std::vector<Side> sides_of(const TriangleMesh& mesh) {
  std::vector<std::size_t> offset(static_cast<std::size_t>(mesh.vertex.cols()) + 1, 0);
  const auto each = [&](const auto& with) {
    for (Index t = 0; t < mesh.triangles.cols(); ++t)
      for (int c = 0; c < 3; ++c) {
        const Index a = mesh.triangles(c, t), b = mesh.triangles((c + 1) % 3, t);
        with(Side{std::min(a, b), std::max(a, b), t, c, a < b});
      }
  };
  each([&](const Side& side) { ++offset[static_cast<std::size_t>(side.low) + 1]; });
  for (std::size_t v = 1; v < offset.size(); ++v) offset[v] += offset[v - 1];
  std::vector<Side> sides(static_cast<std::size_t>(mesh.triangles.size()));
  std::vector<std::size_t> at(offset.begin(), offset.end() - 1);
  each([&](const Side& side) { sides[at[static_cast<std::size_t>(side.low)]++] = side; });
  for (std::size_t v = 0; v + 1 < offset.size(); ++v)
    std::sort(sides.begin() + static_cast<std::ptrdiff_t>(offset[v]),
              sides.begin() + static_cast<std::ptrdiff_t>(offset[v + 1]), [](const Side& x, const Side& y) {
                return std::tie(x.high, x.triangle) < std::tie(y.high, y.triangle);
              });
  return sides;
}

Vec3 area_of(const TriangleMesh& mesh, Index t) {
  const Vec3 a = mesh.vertex.col(mesh.triangles(0, t));
  return (mesh.vertex.col(mesh.triangles(1, t)) - a).cross(mesh.vertex.col(mesh.triangles(2, t)) - a);
}

// Pairs of triangles at each edge: where more than two meet, those most nearly in one plane.
struct Pairs {
  std::vector<std::pair<Side, Side>> pair;
  std::vector<std::size_t> crowded;  // pairs at an edge with further triangles
};

Pairs pairs_of(const TriangleMesh& mesh) {
  const std::vector<Side> side = sides_of(mesh);
  Pairs result;
  result.pair.reserve(side.size() / 2);
  std::vector<Side> up, down;
  for (auto begin = side.begin(), end = begin; begin != side.end(); begin = end) {
    up.clear(), down.clear();
    for (; end != side.end() && end->low == begin->low && end->high == begin->high; ++end)
      (end->ascends ? up : down).push_back(*end);
    if (up.size() != down.size())
      throw ModelError(
          {.fact = fmt::format("the surface of {} triangles is not closed", mesh.triangles.cols()),
           .where = "body surface",
           .why = fmt::format("{} triangles meet at one of its edges", up.size() + down.size()),
           .remedy = "please report this error with the image"});
    const bool is_crowded = up.size() > 1;
    for (const Side& one : up) {
      auto best = down.begin();
      if (is_crowded) {
        const Vec3 normal = area_of(mesh, one.triangle).normalized();
        double nearest = -2.0;
        for (auto other = down.begin(); other != down.end(); ++other)
          if (const double cosine = normal.dot(area_of(mesh, other->triangle).normalized());
              cosine > nearest) {
            nearest = cosine;
            best = other;
          }
        result.crowded.push_back(result.pair.size());
      }
      result.pair.emplace_back(one, *best);
      down.erase(best);
    }
  }
  return result;
}

// Gives each fan of triangles around a vertex a vertex of its own.
void separate_fans(TriangleMesh& mesh, const Pairs& pairs) {
  std::vector<Index> parent(static_cast<std::size_t>(mesh.triangles.size()));  // of corners 3 t + c
  std::iota(parent.begin(), parent.end(), Index{0});
  const auto root = [&](Index c) {
    const auto up = [&](Index r) -> Index& { return parent[static_cast<std::size_t>(r)]; };
    while (up(c) != c) c = up(c) = up(up(c));
    return c;
  };
  const auto join = [&](Index a, Index b) {
    const Index x = root(a), y = root(b);
    parent[static_cast<std::size_t>(std::max(x, y))] = std::min(x, y);
  };
  for (const auto& [one, other] : pairs.pair) {  // the other runs in the opposite direction
    join(3 * one.triangle + one.corner, 3 * other.triangle + (other.corner + 1) % 3);
    join(3 * one.triangle + (one.corner + 1) % 3, 3 * other.triangle + other.corner);
  }
  std::vector<Index> first_fan(static_cast<std::size_t>(mesh.vertex.cols()), -1), copied;
  std::vector<Index> number(parent.size(), -1);  // of each fan's vertex
  for (Index t = 0; t < mesh.triangles.cols(); ++t)
    for (int c = 0; c < 3; ++c) {
      const Index fan = root(3 * t + c), v = mesh.triangles(c, t);
      Index& here = number[static_cast<std::size_t>(fan)];
      if (here < 0) {
        Index& taken = first_fan[static_cast<std::size_t>(v)];
        here = taken < 0 ? v : mesh.vertex.cols() + static_cast<Index>(copied.size());
        if (taken >= 0) copied.push_back(v);
        taken = fan;
      }
    }
  if (copied.empty()) return;
  for (Index t = 0; t < mesh.triangles.cols(); ++t)
    for (int c = 0; c < 3; ++c) mesh.triangles(c, t) = number[static_cast<std::size_t>(root(3 * t + c))];
  const Index before = mesh.vertex.cols();
  mesh.vertex.conservativeResize(3, before + static_cast<Index>(copied.size()));
  for (std::size_t v = 0; v < copied.size(); ++v)
    mesh.vertex.col(before + static_cast<Index>(v)) = mesh.vertex.col(copied[v]);
}

// Halves crowded edges, with one copy of the middle for each pair of triangles; false if there was none.
bool halve_crowded_edges(TriangleMesh& mesh) {
  const Pairs pairs = pairs_of(mesh);
  std::vector<Vec3> vertex;
  std::vector<Eigen::Matrix<Index, 3, 1>> triangle;
  std::vector<bool> visited(static_cast<std::size_t>(mesh.triangles.cols()), false);
  for (const std::size_t p : pairs.crowded) {
    const auto& [one, other] = pairs.pair[p];
    if (visited[static_cast<std::size_t>(one.triangle)] || visited[static_cast<std::size_t>(other.triangle)])
      continue;  // in the next pass
    const Index middle = mesh.vertex.cols() + static_cast<Index>(vertex.size());
    vertex.push_back(0.5 * (mesh.vertex.col(one.low) + mesh.vertex.col(one.high)));
    for (const Side& side : {one, other}) {
      visited[static_cast<std::size_t>(side.triangle)] = true;
      Eigen::Matrix<Index, 3, 1> half = mesh.triangles.col(side.triangle);
      half[side.corner] = middle;
      triangle.push_back(half);
      mesh.triangles((side.corner + 1) % 3, side.triangle) = middle;
    }
  }
  const Index vertices = mesh.vertex.cols(), triangles = mesh.triangles.cols();
  mesh.vertex.conservativeResize(3, vertices + static_cast<Index>(vertex.size()));
  for (std::size_t v = 0; v < vertex.size(); ++v)
    mesh.vertex.col(vertices + static_cast<Index>(v)) = vertex[v];
  mesh.triangles.conservativeResize(3, triangles + static_cast<Index>(triangle.size()));
  for (std::size_t t = 0; t < triangle.size(); ++t)
    mesh.triangles.col(triangles + static_cast<Index>(t)) = triangle[t];
  return !pairs.crowded.empty();
}

}  // namespace

double enclosed_volume(const TriangleMesh& mesh) {
  if (mesh.triangles.cols() == 0) return 0.0;
  const Vec3 o = mesh.vertex.col(0);
  double volume = 0.0;
  for (Index t = 0; t < mesh.triangles.cols(); ++t)
    volume += (mesh.vertex.col(mesh.triangles(0, t)) - o)
                  .dot((mesh.vertex.col(mesh.triangles(1, t)) - o)
                           .cross(mesh.vertex.col(mesh.triangles(2, t)) - o)) /
              6.0;
  return volume;
}

bool is_closed(const Triangles& triangles, Index vertices) {
  // Around each vertex, sorted by it: a triangle's other two corners, in its order.
  struct Opposite {
    Index next, last;
  };
  std::vector<std::size_t> offset(static_cast<std::size_t>(vertices) + 1, 0);
  for (const Index v : triangles.reshaped()) {
    if (v < 0 || v >= vertices) return false;
    ++offset[static_cast<std::size_t>(v) + 1];
  }
  for (std::size_t v = 1; v < offset.size(); ++v) offset[v] += offset[v - 1];
  std::vector<std::size_t> at(offset.begin(), offset.end() - 1);
  std::vector<Opposite> opposite(static_cast<std::size_t>(triangles.size()));
  for (const auto& t : triangles.colwise()) {
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) return false;
    for (int c = 0; c < 3; ++c)
      opposite[at[static_cast<std::size_t>(t[c])]++] = {t[(c + 1) % 3], t[(c + 2) % 3]};
  }
  // One fan: the walk over triangles returns to its start after all of them, and not before.
  for (std::size_t v = 0; v + 1 < offset.size(); ++v) {
    const auto begin = opposite.begin() + static_cast<std::ptrdiff_t>(offset[v]),
               end = opposite.begin() + static_cast<std::ptrdiff_t>(offset[v + 1]);
    if (begin == end) continue;
    auto here = begin;
    for (auto left = end - begin; left > 0; --left) {
      const Index corner = here->last;
      here = std::find_if(begin, end, [&](const Opposite& other) { return other.next == corner; });
      if (here == end || (here == begin) != (left == 1)) return false;
    }
  }
  return true;
}

void separate_coincident_sheets(TriangleMesh& mesh) {
  if (is_closed(mesh.triangles, mesh.vertex.cols())) return;  // true for most, and the faster test
  for (int pass = 0; pass < most_passes; ++pass) {
    stop_if_requested();
    const Pairs pairs = pairs_of(mesh);
    separate_fans(mesh, pairs);
    if (pairs.crowded.empty() || !halve_crowded_edges(mesh)) return;
  }
}

}  // namespace dimple
