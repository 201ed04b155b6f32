#pragma once

#include <tbb/parallel_for.h>

#include <algorithm>
#include <numeric>
#include <vector>

#include "io/stop.hpp"
#include "preprocess/model.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

/// The next corner in each triangle around a vertex: each edge occurs once from either side.
inline CompressedRows next_corners(const TriangleMesh& surface) {
  CompressedRows result;
  result.offset = Eigen::VectorXi::Zero(surface.vertex.cols() + 1);
  result.member.resize(surface.triangles.size());
  for (Index t = 0; t < surface.triangles.cols(); ++t)
    for (int c = 0; c < 3; ++c) ++result.offset[surface.triangles(c, t) + 1];
  for (Index v = 0; v < surface.vertex.cols(); ++v) result.offset[v + 1] += result.offset[v];
  Eigen::VectorXi at = result.offset.head(surface.vertex.cols());
  for (Index t = 0; t < surface.triangles.cols(); ++t)
    for (int c = 0; c < 3; ++c)
      result.member[at[surface.triangles(c, t)]++] = static_cast<int>(surface.triangles((c + 1) % 3, t));
  return result;
}

/// Four numbers of each vertex, the last of them 0: whole registers.
using Quads = Eigen::Matrix<double, 4, Eigen::Dynamic>;

inline Quads quads_of(const Points& vertex) {
  Quads result = Quads::Zero(4, vertex.cols());
  result.topRows<3>() = vertex;
  return result;
}

/// Vertices in blocks of this size, each sorted by the number of neighbours: a loop that mostly ends after as
/// many steps as the last one is predicted well.
inline constexpr Index block_of_vertices = 1024;
inline std::vector<int> by_neighbours(const CompressedRows& next) {
  std::vector<int> order(static_cast<std::size_t>(next.rows()));
  std::iota(order.begin(), order.end(), 0);
  for (Index first = 0; first < next.rows(); first += block_of_vertices)
    std::stable_sort(order.begin() + first, order.begin() + std::min(first + block_of_vertices, next.rows()),
                     [&](int a, int b) { return next.count(a) < next.count(b); });
  return order;
}

/// The mean of a vertex's neighbours. Inlined, since a call takes half as long again.
[[gnu::always_inline]] inline Eigen::Vector4d mean_around(const Quads& value, const CompressedRows& next,
                                                          Index v) {
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();
  for (int k = next.offset[v]; k < next.offset[v + 1]; ++k) sum += value.col(next.member[k]);
  return sum / static_cast<double>(next.count(v));
}

/// Calls change(v) for all vertices of `order`, in that order within each block. Can be stopped.
template <class Change>
void for_each_vertex(const std::vector<int>& order, const Change& change) {
  const auto count = static_cast<Index>(order.size());
  stop_if_requested();
  tbb::parallel_for(Index{0}, (count + block_of_vertices - 1) / block_of_vertices, [&](Index k) {
    for (Index i = block_of_vertices * k; i < std::min(block_of_vertices * (k + 1), count); ++i)
      change(order[static_cast<std::size_t>(i)]);
  });
}

/// Sweeps over the vertices of `order`: each sweep replaces all values at once by next_value(value, v), at
/// most `reach` from their start.
template <class NextValue>
void sweep_on_leash(Quads& value, const std::vector<int>& order, int sweeps, double reach,
                    const NextValue& next_value) {
  const double surely = reach * reach * (1.0 - 1e-12);  // roots are costly
  const Quads start = value;
  Quads other = value;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    for_each_vertex(order, [&](Index v) {
      const Eigen::Vector4d there = next_value(value, v);
      other.col(v) = there;
      const Vec3 away = there.head<3>() - start.col(v).head<3>();
      if (away.squaredNorm() < surely) return;
      if (const double length = away.norm(); length > reach)
        other.col(v).head<3>() = start.col(v).head<3>() + reach / length * away;
    });
    value.swap(other);
  }
}

/// The vector areas of the triangles, summed at their vertices and over all.
struct AreaNormals {
  Points normal;                ///< [3xV] of the triangles around a vertex, whole
  Eigen::VectorXd vertex_area;  ///< [V] a third of the triangles around it
  double area = 0.0;
};
inline AreaNormals area_normals(const TriangleMesh& surface) {
  AreaNormals sums{Points::Zero(3, surface.vertex.cols()), Eigen::VectorXd::Zero(surface.vertex.cols())};
  for (Index t = 0; t < surface.triangles.cols(); ++t) {
    const Vec3 a = surface.vertex.col(surface.triangles(0, t));
    const Vec3 n = 0.5 * (surface.vertex.col(surface.triangles(1, t)) - a)
                             .cross(surface.vertex.col(surface.triangles(2, t)) - a);
    const double area = n.norm();
    sums.area += area;
    for (int c = 0; c < 3; ++c) {
      sums.normal.col(surface.triangles(c, t)) += n;
      sums.vertex_area[surface.triangles(c, t)] += area / 3.0;
    }
  }
  return sums;
}

}  // namespace dimple
