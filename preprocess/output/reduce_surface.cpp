#include "preprocess/output/reduce_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numeric>

// No library does it: VTK's clustering has cubes of one size, and its decimations take ten times as long or
// end at 50,000 triangles of a brain.

namespace dimple {
namespace {

// Halvings of the cubes' edge at a distance from the circle's centre [radii].
int level_at(double radii) {
  return radii < 2.5 ? 2 : radii < 5.0 ? 1 : 0;
}

struct Cubes {
  std::vector<std::uint64_t> key;  // [V]
  std::vector<Index> order;        // [V] vertices by key, then by number
};

Cubes cubes_of(const Surface& surface, const Indenter& tool, double edge_mm) {
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

ReducedSurface reduced(const Surface& surface, const Indenter& tool, double edge_mm) {
  const Cubes cubes = cubes_of(surface, tool, edge_mm);
  const std::size_t count = cubes.order.size();
  ReducedSurface result;
  std::vector<Index> of_vertex(count);
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

ReducedSurface reduced_surface(const Surface& surface, const Indenter& tool, Index most_triangles) {
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
  ReducedSurface result = reduced(surface, tool, edge);
  while (result.triangles.cols() > most_triangles)
    result = reduced(surface, tool,
                     edge *= 1.02 * std::sqrt(static_cast<double>(result.triangles.cols()) /
                                              static_cast<double>(most_triangles)));
  return result;
}

}  // namespace dimple
