#include <fmt/format.h>
#include <itkConnectedComponentImageFilter.h>
#include <itkDiscreteGaussianImageFilter.h>
#include <itkImage.h>
#include <itkImageRegionConstIterator.h>
#include <itkLinearInterpolateImageFunction.h>
#include <itkRelabelComponentImageFilter.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkFlyingEdges3D.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "io/error.hpp"
#include "preprocess/body_surface.hpp"
#include "preprocess/model.hpp"

namespace dimple {
namespace {

using Mask = itk::Image<std::uint8_t, 3>;
using Pieces = itk::Image<std::uint32_t, 3>;
using Indicator = itk::Image<float, 3>;

constexpr Index padding = 4;  // voxels: more than the Gaussian reaches
constexpr double smoothing_voxels = 0.7;
constexpr int relaxation_sweeps = 120;  // enough for the terraces of a slope of one in ten
constexpr double leash = 0.5;  // lattice steps: the voxels do not say more about where the surface is

// The part of the image that holds the chosen labels, with a border of background.
struct Crop {
  std::array<Index, 3> first{}, size{};  // first voxel of the crop may lie outside the image (negative)
  Mask::Pointer mask;
  bool touches_border = false;
};

template <class Image>
typename Image::Pointer make_image(const std::array<Index, 3>& size) {
  auto image = Image::New();
  typename Image::SizeType s;
  for (unsigned d = 0; d < 3; ++d) s[d] = static_cast<itk::SizeValueType>(size[d]);
  image->SetRegions(typename Image::RegionType(s));
  image->Allocate(true);
  return image;
}

bool is_chosen(int value, const std::vector<int>& labels) {
  return labels.empty() ? value != 0 : std::find(labels.begin(), labels.end(), value) != labels.end();
}

Crop crop_to_labels(const LabelImage& image, const std::vector<int>& labels) {
  std::array<Index, 3> lower = image.size, upper = {-1, -1, -1};
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j)
      for (Index i = 0; i < image.size[0]; ++i)
        if (is_chosen(image.at(i, j, k), labels)) {
          const std::array<Index, 3> v = {i, j, k};
          for (std::size_t d = 0; d < 3; ++d) {
            lower[d] = std::min(lower[d], v[d]);
            upper[d] = std::max(upper[d], v[d]);
          }
        }
  Crop crop;
  if (upper[0] < 0) {
    std::string wanted;
    for (const int l : labels) wanted += (wanted.empty() ? "" : ", ") + std::to_string(l);
    throw InputError({.fact = fmt::format("no voxel has label {}", wanted.empty() ? "other than 0" : wanted),
                      .where = "choice of labels",
                      .why = "the image does not hold it",
                      .remedy = "see `dimple info IMAGE` for what it holds and choose with --label"});
  }
  for (std::size_t d = 0; d < 3; ++d) {
    crop.first[d] = lower[d] - padding;
    crop.size[d] = upper[d] - lower[d] + 1 + 2 * padding;
  }
  crop.mask = make_image<Mask>(crop.size);
  std::uint8_t* out = crop.mask->GetBufferPointer();
  for (Index k = lower[2]; k <= upper[2]; ++k)
    for (Index j = lower[1]; j <= upper[1]; ++j)
      for (Index i = lower[0]; i <= upper[0]; ++i)
        if (is_chosen(image.at(i, j, k), labels)) {
          out[(i - crop.first[0]) +
              crop.size[0] * ((j - crop.first[1]) + crop.size[1] * (k - crop.first[2]))] = 1;
          crop.touches_border = crop.touches_border || i == 0 || j == 0 || k == 0 || i == image.size[0] - 1 ||
                                j == image.size[1] - 1 || k == image.size[2] - 1;
        }
  return crop;
}

struct Components {
  Pieces::Pointer image;
  std::vector<std::uint64_t> voxels;  // [piece - 1], largest first
};

Components face_connected(Mask* mask) {
  auto connect = itk::ConnectedComponentImageFilter<Mask, Pieces>::New();
  connect->SetInput(mask);
  connect->FullyConnectedOff();
  auto sort = itk::RelabelComponentImageFilter<Pieces, Pieces>::New();
  sort->SetInput(connect->GetOutput());
  sort->Update();
  Components result;
  result.image = sort->GetOutput();
  for (const auto size : sort->GetSizeOfObjectsInPixels()) result.voxels.push_back(size);
  return result;
}

// Keeps the largest piece and fills holes in it that are smaller than `smallest_cavity_voxels`.
void keep_largest_piece(Crop& crop, double voxel_volume, double smallest_cavity_mm3, SegmentReport& report) {
  const Index n = crop.size[0] * crop.size[1] * crop.size[2];
  std::uint8_t* mask = crop.mask->GetBufferPointer();

  const Components pieces = face_connected(crop.mask);
  report.pieces = static_cast<int>(pieces.voxels.size());
  const auto all = std::accumulate(pieces.voxels.begin(), pieces.voxels.end(), std::uint64_t{0});
  report.label_volume_mm3 = voxel_volume * static_cast<double>(all);
  report.dropped_volume_mm3 = voxel_volume * static_cast<double>(all - pieces.voxels.front());
  const std::uint32_t* piece = pieces.image->GetBufferPointer();
  for (Index v = 0; v < n; ++v) mask[v] = piece[v] == 1 ? 1 : 0;

  auto outside = make_image<Mask>(crop.size);
  std::uint8_t* empty = outside->GetBufferPointer();
  for (Index v = 0; v < n; ++v) empty[v] = mask[v] ? 0 : 1;
  const Components holes = face_connected(outside);
  const std::uint32_t* hole = holes.image->GetBufferPointer();
  const std::uint32_t surroundings = hole[0];  // the padding
  std::uint64_t kept = pieces.voxels.front();
  for (std::uint32_t h = 1; h <= holes.voxels.size(); ++h) {
    const double volume = voxel_volume * static_cast<double>(holes.voxels[h - 1]);
    if (h == surroundings || volume >= smallest_cavity_mm3) continue;
    ++report.cavities_filled;
    report.filled_volume_mm3 += volume;
    kept += holes.voxels[h - 1];
    for (Index v = 0; v < n; ++v)
      if (hole[v] == h) mask[v] = 1;
  }
  report.voxel_volume_mm3 = voxel_volume * static_cast<double>(kept);
  if (kept < 64)
    throw ModelError({.fact = fmt::format("the largest piece has {} voxels; a body needs at least 64", kept),
                      .where = "choice of labels",
                      .why = "the label is a speck, or the image is too coarse for it",
                      .remedy = "choose another --label, or give a finer image"});
}

// The image's own rigid frame, and voxel -> that frame.
struct Frame {
  Eigen::Isometry3d to_world = Eigen::Isometry3d::Identity();
  Mat3 voxel_to_local;  // diagonal, but for sheared images
};

Frame frame_of(const LabelImage& image) {
  Frame frame;
  const Mat3 A = image.to_world.linear();
  const Eigen::JacobiSVD<Mat3> svd(A * image.spacing().cwiseInverse().asDiagonal(),
                                   Eigen::ComputeFullU | Eigen::ComputeFullV);
  frame.to_world.linear() = svd.matrixU() * svd.matrixV().transpose();
  frame.to_world.translation() = image.to_world.translation();
  Mat3 L = frame.to_world.linear().transpose() * A;
  const Mat3 off_diagonal = L - Mat3(L.diagonal().asDiagonal());
  if (off_diagonal.cwiseAbs().maxCoeff() < 1e-6 * image.spacing().minCoeff())
    L = Mat3(Vec3(L.diagonal()).asDiagonal());
  // Headers in other formats hold the same numbers with other last digits; the body must not depend on those.
  frame.voxel_to_local = (L.array() * 1e9).round() / 1e9;
  return frame;
}

Indicator::Pointer smooth(const Crop& crop, const Vec3& sigma_voxels) {
  auto indicator = make_image<Indicator>(crop.size);
  const Index n = crop.size[0] * crop.size[1] * crop.size[2];
  for (Index v = 0; v < n; ++v) indicator->GetBufferPointer()[v] = crop.mask->GetBufferPointer()[v];
  auto gaussian = itk::DiscreteGaussianImageFilter<Indicator, Indicator>::New();
  gaussian->SetInput(indicator);
  gaussian->SetUseImageSpacing(false);
  itk::FixedArray<double, 3> variance;
  for (unsigned d = 0; d < 3; ++d) variance[d] = sigma_voxels[d] * sigma_voxels[d];
  gaussian->SetVariance(variance);
  gaussian->SetMaximumError(1e-4);
  gaussian->SetMaximumKernelWidth(64);
  gaussian->Update();
  return gaussian->GetOutput();
}

// Samples the smoothed indicator on a cubic lattice in the local frame: isotropic, whatever the voxels are.
vtkNew<vtkImageData> sample(const Indicator* smoothed, const Crop& crop, const Mat3& voxel_to_local,
                            double step) {
  Vec3 lower = Vec3::Constant(1e300), upper = Vec3::Constant(-1e300);
  for (int corner = 0; corner < 8; ++corner) {
    Vec3 v;
    for (int d = 0; d < 3; ++d)
      v[d] = static_cast<double>(crop.first[static_cast<std::size_t>(d)] +
                                 ((corner >> d) & 1 ? crop.size[static_cast<std::size_t>(d)] - 1 : 0));
    const Vec3 x = voxel_to_local * v;
    lower = lower.cwiseMin(x);
    upper = upper.cwiseMax(x);
  }
  vtkNew<vtkImageData> lattice;
  std::array<int, 3> n;
  for (int d = 0; d < 3; ++d)
    n[static_cast<std::size_t>(d)] = static_cast<int>(std::floor((upper[d] - lower[d]) / step + 1e-9)) + 1;
  lattice->SetDimensions(n.data());
  lattice->SetOrigin(lower.x(), lower.y(), lower.z());
  lattice->SetSpacing(step, step, step);
  lattice->AllocateScalars(VTK_FLOAT, 1);

  auto linear = itk::LinearInterpolateImageFunction<Indicator, double>::New();
  linear->SetInputImage(smoothed);
  const Mat3 local_to_voxel = voxel_to_local.inverse();
  auto* const values = static_cast<float*>(lattice->GetScalarPointer());
  tbb::parallel_for(0, n[2], [&](int k) {
    float* out = values + static_cast<std::ptrdiff_t>(k) * n[1] * n[0];
    for (int j = 0; j < n[1]; ++j)
      for (int i = 0; i < n[0]; ++i) {
        const Vec3 v = local_to_voxel * (lower + step * Vec3(i, j, k));
        itk::ContinuousIndex<double, 3> at;
        bool inside = true;
        for (unsigned d = 0; d < 3; ++d) {
          at[d] = v[d] - static_cast<double>(crop.first[d]);
          const double last = static_cast<double>(crop.size[d] - 1);
          inside = inside && at[d] > -1e-6 && at[d] < last + 1e-6;
          at[d] = std::clamp(at[d], 0.0, last);
        }
        *out++ = inside ? static_cast<float>(linear->EvaluateAtContinuousIndex(at)) : 0.0f;
      }
  });
  return lattice;
}

struct TriangleSoup {
  Points vertex;
  Triangles triangles;
};

double enclosed_volume(const TriangleSoup& s) {
  if (s.triangles.cols() == 0) return 0.0;
  const Vec3 o = s.vertex.col(0);
  double volume = 0.0;
  for (Index t = 0; t < s.triangles.cols(); ++t)
    volume += (s.vertex.col(s.triangles(0, t)) - o)
                  .dot((s.vertex.col(s.triangles(1, t)) - o).cross(s.vertex.col(s.triangles(2, t)) - o)) /
              6.0;
  return volume;
}

// The closed surface that encloses the largest volume, with its cavities; specks that smoothing cut off go.
TriangleSoup largest_shell(const TriangleSoup& all, double smallest_cavity_mm3) {
  std::vector<Index> parent(static_cast<std::size_t>(all.vertex.cols()));
  std::iota(parent.begin(), parent.end(), Index{0});
  const auto root = [&](Index v) {
    while (parent[static_cast<std::size_t>(v)] != v)
      v = parent[static_cast<std::size_t>(v)] =
          parent[static_cast<std::size_t>(parent[static_cast<std::size_t>(v)])];
    return v;
  };
  for (Index t = 0; t < all.triangles.cols(); ++t)
    for (int c = 1; c < 3; ++c)
      parent[static_cast<std::size_t>(root(all.triangles(c, t)))] = root(all.triangles(0, t));

  std::map<Index, double> volume;
  for (Index t = 0; t < all.triangles.cols(); ++t)
    volume[root(all.triangles(0, t))] +=
        all.vertex.col(all.triangles(0, t))
            .dot(all.vertex.col(all.triangles(1, t)).cross(all.vertex.col(all.triangles(2, t)))) /
        6.0;
  const auto largest = std::max_element(volume.begin(), volume.end(),
                                        [](const auto& a, const auto& b) { return a.second < b.second; });
  TriangleSoup result;
  std::vector<Index> number(parent.size(), -1);
  std::vector<Index> kept_vertex, kept_triangle;
  for (Index t = 0; t < all.triangles.cols(); ++t) {
    const Index r = root(all.triangles(0, t));
    if (r != largest->first && volume[r] > -smallest_cavity_mm3) continue;
    kept_triangle.push_back(t);
    for (int c = 0; c < 3; ++c) {
      Index& v = number[static_cast<std::size_t>(all.triangles(c, t))];
      if (v < 0) {
        v = static_cast<Index>(kept_vertex.size());
        kept_vertex.push_back(all.triangles(c, t));
      }
    }
  }
  result.vertex.resize(3, static_cast<Index>(kept_vertex.size()));
  for (std::size_t v = 0; v < kept_vertex.size(); ++v)
    result.vertex.col(static_cast<Index>(v)) = all.vertex.col(kept_vertex[v]);
  result.triangles.resize(3, static_cast<Index>(kept_triangle.size()));
  for (std::size_t t = 0; t < kept_triangle.size(); ++t)
    for (int c = 0; c < 3; ++c)
      result.triangles(c, static_cast<Index>(t)) =
          number[static_cast<std::size_t>(all.triangles(c, kept_triangle[t]))];
  return result;
}

TriangleSoup iso_surface(vtkImageData* lattice, double level, double smallest_cavity_mm3) {
  vtkNew<vtkFlyingEdges3D> contour;
  contour->SetInputData(lattice);
  contour->SetValue(0, level);
  contour->ComputeNormalsOff();
  contour->ComputeScalarsOff();
  contour->Update();
  vtkPolyData* poly = contour->GetOutput();

  TriangleSoup all;
  all.vertex.resize(3, poly->GetNumberOfPoints());
  for (Index v = 0; v < all.vertex.cols(); ++v) poly->GetPoint(v, all.vertex.col(v).data());
  all.triangles.resize(3, poly->GetNumberOfPolys());
  Index t = 0;
  vtkIdType count = 0;
  const vtkIdType* corner = nullptr;
  for (poly->GetPolys()->InitTraversal(); poly->GetPolys()->GetNextCell(count, corner); ++t)
    for (int c = 0; c < 3; ++c) all.triangles(c, t) = corner[c];
  if (all.triangles.cols() == 0) return all;
  if (enclosed_volume(all) < 0.0) all.triangles.row(1).swap(all.triangles.row(2));
  return largest_shell(all, smallest_cavity_mm3);
}

// The next corner in each triangle around a vertex: each edge is seen once from either side.
CompressedRows next_corners(const TriangleSoup& surface) {
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

// One sweep of averaging: half of each vertex' value stays, half comes from its neighbours; then `then` has a
// look at it.
template <class Then>
Points averaged(const Points& value, const CompressedRows& next, const Then& then) {
  Points result(3, value.cols());
  tbb::parallel_for(tbb::blocked_range<Index>(0, value.cols(), 1024), [&](const auto& range) {
    for (Index v = range.begin(); v < range.end(); ++v) {
      Vec3 sum = Vec3::Zero();
      for (int k = next.offset[v]; k < next.offset[v + 1]; ++k) sum += value.col(next.member[k]);
      result.col(v) = then(v, Vec3(0.5 * (value.col(v) + sum / static_cast<double>(next.count(v)))));
    }
  });
  return result;
}

// Moves each vertex to the middle of its neighbours, over and over, on a leash around where it began:
// terraces of the voxels go, and the surface stays between the voxel centres that it separates (Gibson,
// Constrained elastic surface nets, MICCAI 1998). Averaging also shrinks what is round; that part of the
// motion is smooth, where the terraces' is not, and is taken back.
void relax(TriangleSoup& surface, double reach) {
  const Points start = surface.vertex;
  const CompressedRows next = next_corners(surface);
  for (int sweep = 0; sweep < relaxation_sweeps; ++sweep)
    surface.vertex = averaged(surface.vertex, next, [&](Index v, const Vec3& there) -> Vec3 {
      const Vec3 away = there - start.col(v);
      const double length = away.norm();
      return length > reach ? Vec3(start.col(v) + reach / length * away) : there;
    });
  Points shrinkage = surface.vertex - start;
  for (int sweep = 0; sweep < relaxation_sweeps; ++sweep)
    shrinkage = averaged(shrinkage, next, [](Index, const Vec3& there) { return there; });
  surface.vertex -= shrinkage;
}

// Moves the surface along its normals, everywhere alike, until it encloses the given volume.
void match_volume(TriangleSoup& surface, double volume_mm3) {
  for (int pass = 0; pass < 4; ++pass) {
    Points normal = Points::Zero(3, surface.vertex.cols());
    double area = 0.0;
    for (Index t = 0; t < surface.triangles.cols(); ++t) {
      const Vec3 a = surface.vertex.col(surface.triangles(0, t));
      const Vec3 n = 0.5 * (surface.vertex.col(surface.triangles(1, t)) - a)
                               .cross(surface.vertex.col(surface.triangles(2, t)) - a);
      area += n.norm();
      for (int c = 0; c < 3; ++c) normal.col(surface.triangles(c, t)) += n;
    }
    const double offset = (volume_mm3 - enclosed_volume(surface)) / area;
    for (Index v = 0; v < normal.cols(); ++v)
      if (const double length = normal.col(v).norm(); length > 0.0)
        surface.vertex.col(v) += offset / length * normal.col(v);
  }
}

}  // namespace

SegmentedBody make_body_surface(const LabelImage& image, const std::vector<int>& labels,
                                double node_spacing_mm) {
  SegmentReport report;
  report.labels = labels;
  const double smallest_cavity = std::pow(2.0 * node_spacing_mm, 3);
  Crop crop = crop_to_labels(image, labels);
  report.cut_by_border = crop.touches_border;
  keep_largest_piece(crop, image.voxel_volume(), smallest_cavity, report);

  const Frame frame = frame_of(image);
  const Vec3 spacing = frame.voxel_to_local.colwise().norm();
  const double step = std::max(spacing.minCoeff(), 0.25 * node_spacing_mm);
  const Vec3 sigma = (0.5 * step * spacing.cwiseInverse()).cwiseMax(smoothing_voxels);
  report.smoothing_mm = sigma.cwiseProduct(spacing).maxCoeff();
  const Indicator::Pointer smoothed = smooth(crop, sigma);
  TriangleSoup surface =
      iso_surface(sample(smoothed, crop, frame.voxel_to_local, step), 0.5, smallest_cavity);
  if (surface.triangles.cols() == 0)
    throw ModelError(
        {.fact = "the smoothed organ vanishes",
         .where = "body surface",
         .why = fmt::format("it is nowhere thicker than {:.2f} mm, the smoothing", report.smoothing_mm),
         .remedy = "choose another --label, ask for more --nodes, or give a finer image"});
  relax(surface, leash * step);
  match_volume(surface, report.voxel_volume_mm3);

  const double error = enclosed_volume(surface) / report.voxel_volume_mm3 - 1.0;
  if (std::abs(error) > 1e-3)
    report.warnings.push_back(
        fmt::format("the smooth surface encloses {:.2f} % {} than the voxels: parts of the organ are "
                    "thinner than two voxels, or than half a node spacing",
                    100.0 * std::abs(error), error > 0.0 ? "more" : "less"));
  if (report.cut_by_border)
    report.warnings.push_back(
        "the organ touches the border of the image: it is cut off there, and the cut face is "
        "taken as its surface");
  return {BodySurface(std::move(surface.vertex), std::move(surface.triangles), frame.to_world),
          std::move(report)};
}

double largest_piece_volume(const LabelImage& image, const std::vector<int>& labels) {
  Crop crop = crop_to_labels(image, labels);
  return image.voxel_volume() * static_cast<double>(face_connected(crop.mask).voxels.front());
}

}  // namespace dimple
