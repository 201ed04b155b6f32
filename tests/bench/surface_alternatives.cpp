#include "tests/bench/surface_alternatives.hpp"

#include <itkAntiAliasBinaryImageFilter.h>
#include <itkImage.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "preprocess/image/voxel_set.hpp"
#include "preprocess/surface/mesh_sweeps.hpp"
#include "preprocess/surface/smooth_lattice.hpp"
#include "tests/helpers/image.hpp"

namespace dimple {
namespace {

using Level = itk::Image<float, 3>;

Level::Pointer level_of(const LabelImage& image, const std::vector<std::int32_t>& label) {
  const auto level = Level::New();
  Level::SizeType size;
  for (unsigned d = 0; d < 3; ++d) size[d] = static_cast<itk::SizeValueType>(image.size[d]);
  level->SetRegions(Level::RegionType(size));
  level->Allocate();
  std::transform(label.begin(), label.end(), level->GetBufferPointer(),
                 [](std::int32_t l) { return l != 0 ? 1.0f : 0.0f; });
  return level;
}

// Voxel coordinates. `value`: of the voxels, i fastest, positive inside.
TriangleMesh contour_at_zero(std::vector<float> value, const LabelImage& image) {
  Lattice lattice{.origin = Vec3::Zero(), .step = Vec3::Ones(), .value = std::move(value)};
  for (std::size_t d = 0; d < 3; ++d) lattice.n[d] = static_cast<int>(image.size[d]);
  return contour(lattice, 0.0);
}

// Neighbours of each vertex.
std::vector<std::vector<Index>> neighbours_of(const TriangleMesh& mesh) {
  std::vector<std::vector<Index>> result(static_cast<std::size_t>(mesh.vertex.cols()));
  for (const auto& t : mesh.triangles.colwise())
    for (int c = 0; c < 3; ++c) result[static_cast<std::size_t>(t[c])].push_back(t[(c + 1) % 3]);
  return result;
}

// Each column less the mean of its neighbours.
Points less_mean(const Points& value, const std::vector<std::vector<Index>>& neighbours) {
  Points result = value;
  for (Index v = 0; v < value.cols(); ++v) {
    const auto& around = neighbours[static_cast<std::size_t>(v)];
    Vec3 sum = Vec3::Zero();
    for (const Index n : around) sum += value.col(n);
    result.col(v) -= sum / static_cast<double>(around.size());
  }
  return result;
}

}  // namespace

TriangleMesh constrained_net(const LabelImage& image, int iterations) {
  constexpr double step = 0.25, half_voxel = 0.5;
  const std::vector<std::int32_t> label = every_voxel(image);
  std::vector<float> value(label.size());
  std::transform(label.begin(), label.end(), value.begin(),
                 [](std::int32_t l) { return l != 0 ? 1.0f : -1.0f; });
  TriangleMesh mesh = contour_at_zero(std::move(value), image);
  const auto neighbours = neighbours_of(mesh);
  const Points start = mesh.vertex;
  for (int k = 0; k < iterations; ++k) {
    mesh.vertex -= step * less_mean(less_mean(mesh.vertex, neighbours), neighbours);
    mesh.vertex = mesh.vertex.cwiseMax((start.array() - half_voxel).matrix())
                      .cwiseMin((start.array() + half_voxel).matrix());
  }
  mesh.vertex = image.to_world * mesh.vertex;
  return mesh;
}

namespace {

// Half of each value and half of the mean over its neighbours, over and over.
void average(Quads& value, const CompressedRows& next, int sweeps, double reach) {
  sweep_on_leash(value, by_neighbours(next), sweeps, reach,
                 [&](const Quads& now, Index v) -> Eigen::Vector4d {
                   return 0.5 * (now.col(v) + mean_around(now, next, v));
                 });
}

void match_volume(TriangleMesh& surface, double volume) {
  for (int pass = 0; pass < 4; ++pass) {
    const AreaNormals sums = area_normals(surface);
    const double offset = (volume - enclosed_volume(surface)) / sums.area;
    surface.vertex += offset * sums.normal.colwise().normalized();
  }
}

}  // namespace

TriangleMesh averaged_net(const LabelImage& image) {
  constexpr int sweeps = 120;
  constexpr double leash = 0.5, smoothing = 0.7;
  const Vec3 spacing = image.spacing();
  const double step = spacing.minCoeff();
  const VoxelSet body = voxels_with(image, {});
  const Vec3 sigma = (0.5 * step * spacing.cwiseInverse()).cwiseMax(smoothing);
  const Lattice lattice = smoothed(body, sigma, step * spacing.cwiseInverse());
  TriangleMesh mesh = contour(lattice, 0.5);
  separate_touching_sheets(mesh);
  mesh.vertex = step * mesh.vertex;
  const CompressedRows next = next_corners(mesh);
  const Quads start = quads_of(mesh.vertex);
  Quads value = start;
  average(value, next, sweeps, leash * step);
  mesh.vertex = value.topRows<3>();
  value -= start;
  average(value, next, sweeps, std::numeric_limits<double>::infinity());
  mesh.vertex -= value.topRows<3>();
  double voxels = 0.0;
  for (const auto& [begin, end] : body.stretch) voxels += end - begin;
  match_volume(mesh, image.voxel_volume() * voxels);
  const Vec3 inverse = spacing.cwiseInverse();
  mesh.vertex = (inverse.asDiagonal() * mesh.vertex).colwise() + lattice.origin;
  mesh.vertex = image.to_world * mesh.vertex;
  return mesh;
}

TriangleMesh antialiased_surface(const LabelImage& image, double rms_change) {
  const std::vector<std::int32_t> label = every_voxel(image);
  const auto filter = itk::AntiAliasBinaryImageFilter<Level, Level>::New();
  filter->SetInput(level_of(image, label));
  filter->SetMaximumRMSError(rms_change);
  filter->Update();
  float* value = filter->GetOutput()->GetBufferPointer();
  // The filter leaves many values at 0; there the contour would have triangles without area.
  constexpr float off_zero = 1e-3f;
  for (std::size_t i = 0; i < label.size(); ++i)
    value[i] = label[i] != 0 ? std::max(value[i], off_zero) : std::min(value[i], -off_zero);
  TriangleMesh mesh = contour_at_zero(std::vector<float>(value, value + label.size()), image);
  mesh.vertex = image.to_world * mesh.vertex;
  return mesh;
}

}  // namespace dimple
