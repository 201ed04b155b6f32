#include "preprocess/surface/between_voxels.hpp"

#include <algorithm>
#include <limits>

#include "preprocess/surface/boundary_fit.hpp"
#include "preprocess/surface/mesh_sweeps.hpp"

namespace dimple {
namespace {

constexpr int first_sweeps = 10;    // for even triangles; the fit to the boundary faces removes terraces
constexpr int further_sweeps = 40;  // where no fit determines the surface: edges, folds, noise
constexpr double at_edges = 0.2;    // of the reach: farthest outward motion there to keep the volume

// Moves each vertex repeatedly to the mean of its neighbours, scaled by `fraction`, in [0, 1], and at most
// `reach` from its start. Source: Gibson, Constrained elastic surface nets, MICCAI 1998. Averaging also
// shrinks round shapes; that smooth part of the motion is subtracted.
void relax_partly(TriangleMesh& surface, const CompressedRows& next, std::vector<int> order,
                  const std::vector<double>& fraction, int sweeps, double reach) {
  constexpr double least_fraction = 1e-3;
  std::erase_if(order, [&](int v) { return fraction[static_cast<std::size_t>(v)] < least_fraction; });
  const auto partly = [&](const Quads& value, Index v) -> Eigen::Vector4d {
    const double half = 0.5 * fraction[static_cast<std::size_t>(v)];
    return value.col(v) + half * (mean_around(value, next, v) - value.col(v));
  };
  const Quads start = quads_of(surface.vertex);
  Quads value = start;
  sweep_on_leash(value, order, sweeps, reach, partly);
  surface.vertex = value.topRows<3>();
  value -= start;
  sweep_on_leash(value, order, sweeps, std::numeric_limits<double>::infinity(), partly);
  surface.vertex -= value.topRows<3>();
}

// Moves the surface along its normals until it encloses the given volume. First by at most `reach` where the
// voxels leave it `open`, at edges that smoothing has rounded; then everywhere alike.
void keep_volume(TriangleMesh& surface, double volume_mm3, const std::vector<double>& open, double reach) {
  constexpr int passes = 3;  // of each kind
  std::vector<double> moved(open.size(), 0.0);
  for (int pass = 0; pass < 2 * passes; ++pass) {
    const bool everywhere = pass >= passes;
    const auto weight = [&](Index v) { return everywhere ? 1.0 : open[static_cast<std::size_t>(v)]; };
    const AreaNormals sums = area_normals(surface);
    double area = 0.0;
    for (Index v = 0; v < sums.vertex_area.size(); ++v) area += weight(v) * sums.vertex_area[v];
    if (!(area > 0.0)) continue;
    const double offset = (volume_mm3 - enclosed_volume(surface)) / area;
    for (Index v = 0; v < sums.normal.cols(); ++v) {
      const double length = sums.normal.col(v).norm();
      if (!(length > 0.0)) continue;
      double& so_far = moved[static_cast<std::size_t>(v)];
      const double by = everywhere ? offset : std::clamp(so_far + weight(v) * offset, -reach, reach) - so_far;
      so_far += by;
      surface.vertex.col(v) += by / length * sums.normal.col(v);
    }
  }
}

}  // namespace

void place_between_voxels(TriangleMesh& surface, const VoxelSet& body, const Mat3& voxel_to_local,
                          const BetweenVoxels& how) {
  std::vector<double> open(static_cast<std::size_t>(surface.vertex.cols()), 1.0);
  const CompressedRows next = next_corners(surface);
  const std::vector<int> order = by_neighbours(next);
  relax_partly(surface, next, order, open, first_sweeps, how.reach_mm);
  const std::vector<double> determined =
      fit_to_boundary_faces(surface, body, voxel_to_local, how.step_mm, how.outward_mm);
  std::transform(determined.begin(), determined.end(), open.begin(), [](double d) { return 1.0 - d; });
  relax_partly(surface, next, order, open, further_sweeps, how.reach_mm);
  keep_volume(surface, how.volume_mm3, open, at_edges * how.reach_mm);
}

}  // namespace dimple
