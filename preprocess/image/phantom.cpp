#include "preprocess/image/phantom.hpp"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <limits>

#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

/// A body: the label at a point [mm], 0 outside.
struct Shape {
  Vec3 extent;                     ///< along x, y, z
  double base = 0.0;               ///< z of the flat underside
  bool centred_on_a_face = false;  ///< x = 0 is a face between voxels, not a centre
  std::function<int(const Vec3&)> label;
  std::map<int, std::string> names;
};

double squared(double x) {
  return x * x;
}

/// A dome over an ellipse, cut lengthwise by a fissure:
///
///   rho^2   = u^2 + (y/b)^2,   u = max(0, |x| - x0) / (a - x0)
///   height  = c (1 - rho^m)^(1/m) (1 - depth exp(-(x/w)^2))
///
/// a, b: half width and half length; c: height. The crests of the hemispheres are at |x| <= x0, so that the
/// fissure does not lower the highest point. m = 2 would be half an ellipsoid with a strip of width 2 x0
/// inserted. The exponent gives 88 cm^3 at 1 mm for the mould's size: between half an ellipsoid of that box
/// (86.3) and the 89.9 g of the paper. The fissure is 9 mm deep at the crest and 3.3 mm wide at half its
/// depth.
Shape brain(const Vec3& size, bool two_labels) {
  constexpr double crest = 0.16, fissure_width = 0.064, fissure_depth = 9.0 / 28.5, m = 1.9;
  const double a = size[1] / 2.0, b = size[0] / 2.0, c = size[2];
  const double x0 = crest * a, w = fissure_width * a;
  const auto label = [=](const Vec3& p) {
    const double u = std::max(0.0, std::abs(p.x()) - x0) / (a - x0);
    const double rho = std::hypot(u, p.y() / b);
    if (rho >= 1.0 || p.z() < 0.0) return 0;
    const double dome = c * std::pow(1.0 - std::pow(rho, m), 1.0 / m);
    if (p.z() >= dome * (1.0 - fissure_depth * std::exp(-squared(p.x() / w)))) return 0;
    // The core's top, at 0.65 c, stays below the fissure's floor at 0.68 c.
    if (two_labels &&
        squared(p.x() / (0.5 * a)) + squared(p.y() / (0.5 * b)) + squared((p.z() / c - 0.4) / 0.25) < 1.0)
      return 3;
    return p.x() > 0.0 ? 1 : 2;
  };
  Shape shape{
      {size[1], size[0], size[2]}, 0.0, true, label, {{1, "left_hemisphere"}, {2, "right_hemisphere"}}};
  if (two_labels) shape.names[3] = "deep_tissue";
  return shape;
}

Shape block(const Vec3& size, bool two_labels) {
  const auto label = [=](const Vec3& p) {
    for (int axis = 0; axis < 2; ++axis)
      if (p[axis] < -size[axis] / 2.0 || p[axis] >= size[axis] / 2.0) return 0;  // half open
    if (p.z() < 0.0 || p.z() >= size[2]) return 0;
    return two_labels && p.z() >= size[2] / 2.0 ? 2 : 1;
  };
  Shape shape{size, 0.0, false, label, {{1, "block"}}};
  if (two_labels) shape.names = {{1, "lower_half"}, {2, "upper_half"}};
  return shape;
}

Shape cut_ellipsoid(const Vec3& size, bool two_labels) {
  const Vec3 half(size[0] / 2.0, size[1] / 2.0, size[2] / 1.7);
  const auto label = [=](const Vec3& p) {
    const double r2 = p.cwiseQuotient(half).squaredNorm();
    if (r2 > 1.0 || p.z() < -0.7 * half.z()) return 0;
    return two_labels && r2 < 0.25 ? 2 : 1;
  };
  Shape shape{size, -0.7 * half.z(), false, label, {{1, "cut_ellipsoid"}}};
  if (two_labels) shape.names = {{1, "shell"}, {2, "core"}};
  return shape;
}

Shape cylinder(const Vec3& size, bool two_labels) {
  const double radius = size[0] / 2.0, height = size[2];
  const auto label = [=](const Vec3& p) {
    const double r = std::hypot(p.x(), p.y());
    if (r > radius || p.z() < 0.0 || p.z() >= height) return 0;
    return two_labels && r < radius / 2.0 && std::abs(p.z() - height / 2.0) < height / 4.0 ? 2 : 1;
  };
  Shape shape{{size[0], size[0], size[2]}, 0.0, false, label, {{1, "cylinder"}}};
  if (two_labels) shape.names = {{1, "shell"}, {2, "core"}};
  return shape;
}

UsageError refused(std::string fact, std::string why, std::string remedy) {
  return UsageError({.fact = std::move(fact),
                     .where = "making a phantom",
                     .why = std::move(why),
                     .remedy = std::move(remedy)});
}

Shape shape_of(const PhantomOptions& options) {
  if (options.shape == "brain") return brain(options.size_mm, options.two_labels);
  if (options.shape == "block") return block(options.size_mm, options.two_labels);
  if (options.shape == "cut-ellipsoid") return cut_ellipsoid(options.size_mm, options.two_labels);
  if (options.shape == "cylinder") return cylinder(options.size_mm, options.two_labels);
  throw refused(fmt::format("'{}' is no shape of a phantom", options.shape),
                "known are brain, block, cut-ellipsoid and cylinder", "choose one of them with --shape");
}

// Describes the size; a block has whole voxels.
void say_size(LabelImage& image, const PhantomOptions& options) {
  const double h = options.spacing_mm;
  const VoxelBox box = foreground_box(image);
  Vec3 size;
  for (std::size_t axis = 0; axis < 3; ++axis)
    size[static_cast<Index>(axis)] = static_cast<double>(box.high[axis] - box.low[axis] + 1) * h;
  if ((size - options.size_mm).cwiseAbs().maxCoeff() > 1e-6 * h)
    image.warnings.push_back(fmt::format(
        "the block is {:g} x {:g} x {:g} mm: whole voxels of {:g} mm, not {:g} x {:g} x {:g} mm", size[0],
        size[1], size[2], h, options.size_mm[0], options.size_mm[1], options.size_mm[2]));
}

}  // namespace

LabelImage make_phantom(const PhantomOptions& options) {
  const double h = options.spacing_mm;
  const Vec3& size = options.size_mm;
  if (!std::isfinite(h) || h <= 0.0)
    throw refused(fmt::format("the voxel spacing is {} mm", h), "it must be positive",
                  "give the voxel edge in millimetres with --spacing");
  if (!size.allFinite() || size.minCoeff() <= 0.0)
    throw refused(fmt::format("the size is {} x {} x {} mm", size[0], size[1], size[2]),
                  "every extent must be positive", "give three extents in millimetres with --size");
  const Shape shape = shape_of(options);
  if (shape.extent.minCoeff() / h < 8.0)
    throw refused(
        fmt::format("the body is {:.3g} voxels across", shape.extent.minCoeff() / h),
        fmt::format("it measures {:.4g} mm there and a voxel {:.4g} mm; below 8 voxels its shape is lost",
                    shape.extent.minCoeff(), h),
        fmt::format("choose --spacing {:.3g} or less, or a larger --size", shape.extent.minCoeff() / 8.0));

  // Along x and y the lattice is symmetric about 0: an even number of voxels puts a face there, an odd number
  // a centre. A surplus layer remains background. Along z a face is on the base.
  constexpr Index border = 2;
  constexpr double slack = 1e-9;  // 30 / 0.1 voxels are 300, not 301
  const Vec3 across = shape.extent / h;
  if ((across.array() + (2.0 * border + 2.0)).prod() > std::numeric_limits<std::int32_t>::max())
    throw refused(fmt::format("the image would have {:.0f} voxels", across.prod()),
                  "at most 2,147,483,647 are made", "choose a larger --spacing");
  LabelImage image;
  Vec3 origin;
  for (Index axis = 0; axis < 3; ++axis) {
    auto n = static_cast<Index>(std::ceil(across[axis] - slack));
    if (axis < 2 && shape.centred_on_a_face && axis == 0) n += n % 2;
    image.size[static_cast<std::size_t>(axis)] = n + 2 * border;
    const double first_face = axis < 2 ? -static_cast<double>(n) / 2.0 * h : shape.base;
    origin[axis] = first_face + (0.5 - static_cast<double>(border)) * h;
  }
  image.to_world = Eigen::Translation3d(origin) * Eigen::Scaling(h);
  image.names = shape.names;
  image.format = "phantom";
  image.orientation = "LPS";
  image.stored_size = image.size;
  image.stored_spacing = Vec3::Constant(h);

  std::vector<std::int32_t> row(static_cast<std::size_t>(image.size[0]));
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j) {
      stop_if_requested();
      for (Index i = 0; i < image.size[0]; ++i)
        row[static_cast<std::size_t>(i)] = shape.label(
            origin + h * Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)));
      append_row(image, row);
    }
  if (options.shape == "block") say_size(image, options);
  return image;
}

}  // namespace dimple
