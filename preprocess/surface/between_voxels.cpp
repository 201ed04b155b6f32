#include "preprocess/surface/between_voxels.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <limits>
#include <numeric>

#include "io/stop.hpp"
#include "preprocess/model.hpp"
#include "preprocess/surface/boundary_fit.hpp"

namespace dimple {
namespace {

constexpr int first_sweeps = 10;    // for even triangles; terraces go by the fit to the boundary faces
constexpr int further_sweeps = 40;  // where no fit determines the surface: edges, folds, noise
constexpr double at_edges = 0.2;    // of the reach: how far the surface moves out there to keep its volume

// The next corner in each triangle around a vertex: each edge is seen once from either side.
CompressedRows corners_after(const TriangleMesh& surface) {
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

// Of each vertex four numbers, the last of them 0: whole registers.
using Positions = Eigen::Matrix<double, 4, Eigen::Dynamic>;

// Vertices block by block, in each by how many neighbours they have: a loop that mostly ends after as many
// steps as the last one is foreseen.
constexpr Index vertices_at_once = 1024;
std::vector<int> in_order_of_neighbours(const CompressedRows& next) {
  std::vector<int> order(static_cast<std::size_t>(next.rows()));
  std::iota(order.begin(), order.end(), 0);
  for (Index first = 0; first < next.rows(); first += vertices_at_once)
    std::stable_sort(order.begin() + first, order.begin() + std::min(first + vertices_at_once, next.rows()),
                     [&](int a, int b) { return next.count(a) < next.count(b); });
  return order;
}

// The mean of a vertex's neighbours. As a call it takes half as long again.
[[gnu::always_inline]] inline Eigen::Vector4d mean_beside(const Positions& value, const CompressedRows& next,
                                                          Index v) {
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();
  for (int k = next.offset[v]; k < next.offset[v + 1]; ++k) sum += value.col(next.member[k]);
  return sum / static_cast<double>(next.count(v));
}

// Calls change(v) for all vertices, in that order within each block.
template <class Change>
void for_all_vertices(const std::vector<int>& order, const Change& change) {
  const auto count = static_cast<Index>(order.size());
  stop_if_asked();
  tbb::parallel_for(Index{0}, (count + vertices_at_once - 1) / vertices_at_once, [&](Index k) {
    for (Index i = vertices_at_once * k; i < std::min(vertices_at_once * (k + 1), count); ++i)
      change(order[static_cast<std::size_t>(i)]);
  });
}

// Sweeps over the vertices in `order`: half of each one's value stays, half is the mean of its neighbours,
// both as far as `share` lets it move. No value ends farther than `reach` from where it began.
void average_partly(Positions& value, const CompressedRows& next, const std::vector<int>& order,
                    const std::vector<double>& share, int sweeps, double reach) {
  const double surely = reach * reach * (1.0 - 1e-12);  // roots are dear
  const Positions start = value;
  Positions other = value;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    for_all_vertices(order, [&](Index v) {
      const double half = 0.5 * share[static_cast<std::size_t>(v)];
      const Eigen::Vector4d there = value.col(v) + half * (mean_beside(value, next, v) - value.col(v));
      other.col(v) = there;
      const Vec3 away = there.head<3>() - start.col(v).head<3>();
      if (away.squaredNorm() < surely) return;
      if (const double length = away.norm(); length > reach)
        other.col(v).head<3>() = start.col(v).head<3>() + reach / length * away;
    });
    value.swap(other);
  }
}

// Moves each vertex to the mean of its neighbours, over and over, but no farther than `reach` from where it
// began (Gibson, Constrained elastic surface nets, MICCAI 1998), and only as far as `share`, in [0, 1], lets
// it. Averaging also shrinks what is round; that part of the motion is smooth and is taken back.
void relax_partly(TriangleMesh& surface, const std::vector<double>& share, int sweeps, double reach) {
  constexpr double least_share = 1e-3;
  const CompressedRows next = corners_after(surface);
  Positions start = Positions::Zero(4, surface.vertex.cols());
  start.topRows<3>() = surface.vertex;
  std::vector<int> order = in_order_of_neighbours(next);
  std::erase_if(order, [&](int v) { return share[static_cast<std::size_t>(v)] < least_share; });
  Positions value = start;
  average_partly(value, next, order, share, sweeps, reach);
  surface.vertex = value.topRows<3>();
  value -= start;
  average_partly(value, next, order, share, sweeps, std::numeric_limits<double>::infinity());
  surface.vertex -= value.topRows<3>();
}

// Moves the surface along its normals until it encloses the given volume: first where the voxels leave it
// `open`, at edges that smoothing has rounded, by `reach` at most; then everywhere alike.
void keep_volume(TriangleMesh& surface, double volume_mm3, const std::vector<double>& open, double reach) {
  constexpr int passes = 3;  // of each kind
  std::vector<double> moved(open.size(), 0.0);
  for (int pass = 0; pass < 2 * passes; ++pass) {
    const bool everywhere = pass >= passes;
    const auto weight = [&](Index v) { return everywhere ? 1.0 : open[static_cast<std::size_t>(v)]; };
    Points normal = Points::Zero(3, surface.vertex.cols());
    double area = 0.0;
    for (Index t = 0; t < surface.triangles.cols(); ++t) {
      const Vec3 a = surface.vertex.col(surface.triangles(0, t));
      const Vec3 n = 0.5 * (surface.vertex.col(surface.triangles(1, t)) - a)
                               .cross(surface.vertex.col(surface.triangles(2, t)) - a);
      for (int c = 0; c < 3; ++c) {
        const Index v = surface.triangles(c, t);
        normal.col(v) += n;
        area += weight(v) * n.norm() / 3.0;
      }
    }
    if (!(area > 0.0)) continue;
    const double offset = (volume_mm3 - enclosed_volume(surface)) / area;
    for (Index v = 0; v < normal.cols(); ++v) {
      const double length = normal.col(v).norm();
      if (!(length > 0.0)) continue;
      double& so_far = moved[static_cast<std::size_t>(v)];
      const double by = everywhere ? offset : std::clamp(so_far + weight(v) * offset, -reach, reach) - so_far;
      so_far += by;
      surface.vertex.col(v) += by / length * normal.col(v);
    }
  }
}

}  // namespace

void place_between_voxels(TriangleMesh& surface, const VoxelSet& body, const Mat3& voxel_to_local,
                          const BetweenVoxels& how) {
  std::vector<double> open(static_cast<std::size_t>(surface.vertex.cols()), 1.0);
  relax_partly(surface, open, first_sweeps, how.reach_mm);
  const std::vector<double> determined =
      fit_to_boundary_faces(surface, body, voxel_to_local, how.step_mm, how.outward_mm);
  std::transform(determined.begin(), determined.end(), open.begin(), [](double d) { return 1.0 - d; });
  relax_partly(surface, open, further_sweeps, how.reach_mm);
  keep_volume(surface, how.volume_mm3, open, at_edges * how.reach_mm);
}

}  // namespace dimple
