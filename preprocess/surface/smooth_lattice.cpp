#include "preprocess/surface/smooth_lattice.hpp"

#include <tbb/parallel_for.h>
#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>

#include <algorithm>
#include <cmath>

#include "io/stop.hpp"

namespace dimple {
namespace {

constexpr double left_out = 1e-4;  // of the Gaussian's weight, beyond its last coefficient
constexpr Index border = 4;        // voxels around the body; more where the lattice is coarser

// Coefficients 0, 1, ... of the Gaussian of a discrete line, exp(-t) I_n(t) (Lindeberg, Scale-space for
// discrete signals, IEEE PAMI 1990), by downward recurrence, which is stable.
std::vector<double> discrete_gaussian(double variance) {
  const auto highest = static_cast<std::size_t>(std::ceil(20.0 + 8.0 * std::sqrt(variance)));
  std::vector<double> g(highest + 2, 0.0);
  g[highest] = 1e-300;
  for (std::size_t n = highest; n > 0; --n) {
    g[n - 1] = 2.0 * static_cast<double>(n) / variance * g[n] + g[n + 1];
    if (g[n - 1] > 1e200)
      for (double& value : g) value *= 1e-200;
  }
  double all = g[0];
  for (std::size_t n = 1; n < g.size(); ++n) all += 2.0 * g[n];
  double sum = g[0];
  std::size_t count = 1;
  for (; sum < (1.0 - left_out) * all; ++count) sum += 2.0 * g[count];
  g.resize(count);
  for (double& value : g) value /= sum;
  return g;
}

// Weights of the voxels along one axis of the box at each lattice point.
struct AxisWeights {
  double origin = 0.0;      // of the lattice, in voxels of the box
  std::vector<int> first;   // [l] voxel of the first weight
  std::vector<int> offset;  // [l + 1] into weight
  std::vector<float> weight;
  int points() const { return static_cast<int>(first.size()); }
  int past(int l) const { return first[index(l)] + offset[index(l) + 1] - offset[index(l)]; }
  static std::size_t index(int l) { return static_cast<std::size_t>(l); }
};

AxisWeights weights_along(Index voxels, double sigma, double step) {
  const std::vector<double> g = discrete_gaussian(sigma * sigma);
  const auto reach = static_cast<int>(g.size()) - 1;
  AxisWeights axis;
  const Index around = std::max(border, static_cast<Index>(std::ceil(3.0 * step)));
  axis.origin = static_cast<double>(1 - around);  // voxel 0 of the box and its last one are empty
  const double last = static_cast<double>(voxels - 2 + around);
  const int count = static_cast<int>(std::ceil((last - axis.origin) / step - 1e-9)) + 1;
  axis.offset.push_back(0);
  for (int l = 0; l < count; ++l) {
    const double x = axis.origin + step * l;
    const int left = static_cast<int>(std::floor(x));
    const double fraction = x - left;
    const int begin = std::clamp(left - reach, 0, static_cast<int>(voxels));
    const int end = std::clamp(left + 2 + reach, begin, static_cast<int>(voxels));
    const auto at = [&](int n) {
      return std::abs(n) <= reach ? g[static_cast<std::size_t>(std::abs(n))] : 0.0;
    };
    for (int i = begin; i < end; ++i)
      axis.weight.push_back(
          static_cast<float>((1.0 - fraction) * at(i - left) + fraction * at(i - left - 1)));
    axis.first.push_back(begin);
    axis.offset.push_back(static_cast<int>(axis.weight.size()));
  }
  return axis;
}

// Sums of weights up to a voxel, so that a stretch of any length costs two of them.
class RowSmoother {
 public:
  RowSmoother(const AxisWeights& axis, Index voxels) : axis_(axis) {
    for (int l = 0; l < axis.points(); ++l) {
      double sum = 0.0;
      sum_.push_back(0.0f);
      for (int w = axis.offset[AxisWeights::index(l)]; w < axis.offset[AxisWeights::index(l) + 1]; ++w)
        sum_.push_back(static_cast<float>(sum += axis.weight[AxisWeights::index(w)]));
    }
    int reached = 0, left = 0;
    for (int i = 0; i <= static_cast<int>(voxels); ++i) {
      while (reached < axis.points() && axis.past(reached) <= i) ++reached;
      while (left < axis.points() && axis.first[AxisWeights::index(left)] < i) ++left;
      first_after_.push_back(reached);
      first_not_before_.push_back(left);
    }
  }
  void operator()(std::span<const VoxelSet::Stretch> row, float* value) const {
    for (const auto& [begin, end] : row)
      for (int l = first_after_[AxisWeights::index(begin)]; l < first_not_before_[AxisWeights::index(end)];
           ++l)
        value[l] += up_to(l, end) - up_to(l, begin);
  }

 private:
  float up_to(int l, int voxel) const {
    const int first = axis_.first[AxisWeights::index(l)];
    return sum_[AxisWeights::index(axis_.offset[AxisWeights::index(l)] + l +
                                   std::clamp(voxel, first, axis_.past(l)) - first)];
  }
  const AxisWeights& axis_;
  std::vector<float> sum_;  // of lattice point l from offset[l] + l on
  std::vector<int> first_after_,
      first_not_before_;  // [voxel] lattice points that a stretch from or to it meets
};

void add(float* to, const float* from, float weight, std::size_t count) {
  for (std::size_t i = 0; i < count; ++i) to[i] += weight * from[i];
}

}  // namespace

Lattice smoothed(const VoxelSet& set, const Vec3& sigma, const Vec3& step) {
  std::array<AxisWeights, 3> axis;
  Lattice lattice;
  lattice.step = step;
  for (std::size_t d = 0; d < 3; ++d) {
    const auto e = static_cast<Index>(d);
    axis[d] = weights_along(set.size[d], sigma[e], step[e]);
    lattice.n[d] = axis[d].points();
    lattice.origin[e] = static_cast<double>(set.first[d]) + axis[d].origin;
  }
  const auto n0 = static_cast<std::size_t>(lattice.n[0]), n1 = static_cast<std::size_t>(lattice.n[1]);
  lattice.value.assign(n0 * n1 * static_cast<std::size_t>(lattice.n[2]), 0.0f);
  const RowSmoother along_row(axis[0], set.size[0]);

  // Some planes of voxels at a time, in order: each lattice value is always summed alike.
  constexpr Index planes_at_once = 16;
  std::vector<std::vector<float>> plane(planes_at_once);
  for (Index begin = 0; begin < set.size[2]; begin += planes_at_once) {
    stop_if_requested();
    const Index end = std::min(begin + planes_at_once, set.size[2]);
    tbb::parallel_for(begin, end, [&](Index k) {
      std::vector<float>& sum = plane[static_cast<std::size_t>(k - begin)];
      sum.assign(n0 * n1, 0.0f);
      std::vector<float> row(n0);
      int first = 0;  // earlier lattice rows are out of reach
      for (Index j = 0; j < set.size[1]; ++j) {
        if (set.row(j, k).empty()) continue;
        std::fill(row.begin(), row.end(), 0.0f);
        along_row(set.row(j, k), row.data());
        while (first < axis[1].points() && axis[1].past(first) <= j) ++first;
        for (int l = first; l < axis[1].points(); ++l) {
          const auto at = AxisWeights::index(l);
          if (axis[1].first[at] > j) break;
          const auto w =
              static_cast<std::size_t>(axis[1].offset[at] + static_cast<int>(j) - axis[1].first[at]);
          add(sum.data() + at * n0, row.data(), axis[1].weight[w], n0);
        }
      }
    });
    tbb::parallel_for(0, axis[2].points(), [&](int l) {
      const auto at = AxisWeights::index(l);
      const Index from = std::max<Index>(begin, axis[2].first[at]),
                  to = std::min<Index>(end, axis[2].past(l));
      for (Index k = from; k < to; ++k) {
        const auto w = static_cast<std::size_t>(axis[2].offset[at] + static_cast<int>(k) - axis[2].first[at]);
        add(lattice.value.data() + at * n0 * n1, plane[static_cast<std::size_t>(k - begin)].data(),
            axis[2].weight[w], n0 * n1);
      }
    });
  }
  return lattice;
}

TriangleMesh contour(const Lattice& lattice, double level) {
  vtkNew<vtkImageData> grid;
  grid->SetDimensions(lattice.n.data());
  vtkNew<vtkFloatArray> values;
  values->SetArray(const_cast<float*>(lattice.value.data()), static_cast<vtkIdType>(lattice.value.size()), 1);
  grid->GetPointData()->SetScalars(values);
  vtkNew<vtkFlyingEdges3D> edges;
  edges->SetInputData(grid);
  edges->SetValue(0, level);
  edges->ComputeNormalsOff();
  edges->ComputeScalarsOff();
  edges->Update();
  vtkPolyData* poly = edges->GetOutput();

  TriangleMesh mesh;
  mesh.vertex.resize(3, poly->GetNumberOfPoints());
  for (Index v = 0; v < mesh.vertex.cols(); ++v) poly->GetPoint(v, mesh.vertex.col(v).data());
  mesh.triangles.resize(3, poly->GetNumberOfPolys());
  Index t = 0;
  vtkIdType count = 0;
  const vtkIdType* corner = nullptr;
  for (poly->GetPolys()->InitTraversal(); poly->GetPolys()->GetNextCell(count, corner); ++t)
    for (int c = 0; c < 3; ++c) mesh.triangles(c, t) = corner[c];
  if (enclosed_volume(mesh) < 0.0) mesh.triangles.row(1).swap(mesh.triangles.row(2));
  return mesh;
}

}  // namespace dimple
