#include "preprocess/output/reduce_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>

#include "preprocess/surface/surface_cells.hpp"

// No library does this: VTK's clustering has cubes of one size, and its decimations take ten times as long or
// end at 50,000 triangles of a brain.

namespace dimple {
namespace {

// Halvings of the cubes' edge at a distance from the patch's centre [radii].
int level_at(double radii) {
  return radii < 2.5 ? 2 : radii < 5.0 ? 1 : 0;
}

struct Cubes {
  std::vector<std::uint64_t> key;  // [V]
  std::vector<Index> order;        // [V] vertices by key, then by number
};

Cubes cubes_of(const Surface& surface, const ToolPlace& tool, double edge_mm) {
  const Index count = surface.vertex_mm.cols();
  const Vec3 low = surface.vertex_mm.rowwise().minCoeff();
  Cubes cubes{.key = std::vector<std::uint64_t>(static_cast<std::size_t>(count)),
              .order = std::vector<Index>(static_cast<std::size_t>(count))};
  for (Index v = 0; v < count; ++v) {
    const Vec3 p = surface.vertex_mm.col(v);
    const int level = level_at((p - 1e3 * tool.centre).norm() / (1e3 * tool.radius));
    const Vec3 cube = ((p - low) / (edge_mm / (1 << level))).array().floor();
    std::uint64_t key = static_cast<std::uint64_t>(level);
    for (const double c : cube) key = key << 20U | static_cast<std::uint64_t>(std::min(c, 1048575.0));
    cubes.key[static_cast<std::size_t>(v)] = key;
  }
  std::iota(cubes.order.begin(), cubes.order.end(), Index{0});
  std::sort(cubes.order.begin(), cubes.order.end(), [&](Index a, Index b) {
    const auto x = cubes.key[static_cast<std::size_t>(a)], y = cubes.key[static_cast<std::size_t>(b)];
    return x != y ? x < y : a < b;
  });
  return cubes;
}

// Largest distance of a vertex of the surface from the triangles at the vertex that replaces it.
double deviation(const Surface& surface, const ReducedSurface& from, const std::vector<Index>& of_vertex) {
  const auto count = static_cast<Index>(from.vertex.size());
  std::vector<std::vector<Index>> around(from.vertex.size());
  for (Index t = 0; t < from.triangles.cols(); ++t)
    for (const Index v : from.triangles.col(t)) around[static_cast<std::size_t>(v)].push_back(t);
  const auto corner = [&](Index t, int k) {
    return Vec3(surface.vertex_mm.col(from.vertex[static_cast<std::size_t>(from.triangles(k, t))]));
  };
  std::vector<double> farthest2(from.vertex.size(), 0.0);
  for (Index v = 0; v < surface.vertex_mm.cols() && count > 0; ++v) {
    const auto own = static_cast<std::size_t>(of_vertex[static_cast<std::size_t>(v)]);
    const Vec3 x = surface.vertex_mm.col(v);
    double nearest2 = (x - surface.vertex_mm.col(from.vertex[own])).squaredNorm();
    for (const Index t : around[own])
      nearest2 = std::min(nearest2, distance2_to_triangle(x, corner(t, 0), corner(t, 1), corner(t, 2)));
    farthest2[own] = std::max(farthest2[own], nearest2);
  }
  return std::sqrt(*std::max_element(farthest2.begin(), farthest2.end()));
}

// `of_vertex` [V]: the vertex that replaces each.
ReducedSurface reduced(const Surface& surface, const ToolPlace& tool, double edge_mm,
                       std::vector<Index>& of_vertex) {
  const Cubes cubes = cubes_of(surface, tool, edge_mm);
  const std::size_t count = cubes.order.size();
  ReducedSurface result;
  of_vertex.resize(count);
  for (std::size_t first = 0, last = 0; first < count; first = last) {
    Vec3 mean = Vec3::Zero();
    const std::uint64_t key = cubes.key[static_cast<std::size_t>(cubes.order[first])];
    for (; last < count && cubes.key[static_cast<std::size_t>(cubes.order[last])] == key; ++last)
      mean += surface.vertex_mm.col(cubes.order[last]);
    mean /= static_cast<double>(last - first);
    Index nearest = cubes.order[first];
    for (std::size_t k = first; k < last; ++k) {
      const Index v = cubes.order[k];
      of_vertex[static_cast<std::size_t>(v)] = static_cast<Index>(result.vertex.size());
      if ((surface.vertex_mm.col(v) - mean).squaredNorm() <
          (surface.vertex_mm.col(nearest) - mean).squaredNorm())
        nearest = v;
    }
    result.vertex.push_back(nearest);
  }

  std::vector<std::array<Index, 3>> kept;
  for (const auto& corner : surface.triangles.colwise()) {
    std::array<Index, 3> t{};
    for (int c = 0; c < 3; ++c)
      t[static_cast<std::size_t>(c)] = of_vertex[static_cast<std::size_t>(corner[c])];
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) continue;
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    kept.push_back(t);
  }
  std::sort(kept.begin(), kept.end());
  kept.erase(std::unique(kept.begin(), kept.end()), kept.end());
  result.triangles.resize(3, static_cast<Index>(kept.size()));
  for (std::size_t t = 0; t < kept.size(); ++t)
    result.triangles.col(static_cast<Index>(t)) << kept[t][0], kept[t][1], kept[t][2];
  return result;
}

}  // namespace

ReducedSurface reduced_surface(const Surface& surface, const ToolPlace& tool, Index most_triangles) {
  const Index count = surface.triangles.cols();
  if (count <= most_triangles) {
    ReducedSurface all{.vertex = std::vector<Index>(static_cast<std::size_t>(surface.vertex_mm.cols())),
                       .triangles = surface.triangles};
    std::iota(all.vertex.begin(), all.vertex.end(), Index{0});
    return all;
  }
  double area = 0.0;
  for (const auto& t : surface.triangles.colwise()) {
    const Vec3 a = surface.vertex_mm.col(t[0]), b = surface.vertex_mm.col(t[1]),
               c = surface.vertex_mm.col(t[2]);
    area += 0.5 * (b - a).cross(c - a).norm();
  }
  // A cube that the surface crosses gives about two triangles. The edge grows until they are few enough, at
  // the latest with one cube for all.
  double edge = std::sqrt(2.0 * area / static_cast<double>(most_triangles));
  std::vector<Index> of_vertex;
  ReducedSurface result = reduced(surface, tool, edge, of_vertex);
  while (result.triangles.cols() > most_triangles)
    result = reduced(surface, tool,
                     edge *= 1.02 * std::sqrt(static_cast<double>(result.triangles.cols()) /
                                              static_cast<double>(most_triangles)),
                     of_vertex);
  result.within_mm = deviation(surface, result, of_vertex);
  return result;
}

}  // namespace dimple
