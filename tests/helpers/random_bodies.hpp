#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string>

#include "preprocess/scene/boundary_conditions.hpp"
#include "tests/helpers/draw.hpp"
#include "tests/helpers/image.hpp"

namespace dimple {

/// A lump of three ellipsoids on a flat cut, as a label image, with a bonded patch somewhere on its top.
/// Nothing was tuned to these bodies.
struct RandomBody {
  LabelImage image;
  BoundaryOptions boundary;
  std::string name;  ///< extent in mm
  double nu = 0.499;
};

inline RandomBody random_body(int number) {
  Draw draw{std::mt19937_64(static_cast<std::uint64_t>(number))};
  const double diameter = draw.between(6.0, 20.0), voxel = diameter * draw.between(0.08, 0.2);
  std::array<Vec3, 3> centre, half;
  Vec3 low = Vec3::Constant(1e9), high = -low;
  for (std::size_t k = 0; k < 3; ++k) {
    half[k] = diameter * Vec3(draw.between(1.1, 2.2), draw.between(1.0, 1.8), draw.between(0.9, 1.8));
    centre[k] = diameter * Vec3(draw.between(-0.9, 0.9), draw.between(-0.7, 0.7), draw.between(0.2, 0.8));
    low = low.cwiseMin(centre[k] - half[k]);
    high = high.cwiseMax(centre[k] + half[k]);
  }
  low.z() = 0.0;
  const Vec3 cells = ((high - low) / voxel).array().ceil() + 4.0;
  const auto inside = [&](Index i, Index j, Index k) {
    const Vec3 x = low + voxel * Vec3(static_cast<double>(i) - 1.5, static_cast<double>(j) - 1.5,
                                      static_cast<double>(k) - 1.5);
    if (x.z() < 0.0) return false;
    for (std::size_t e = 0; e < 3; ++e)
      if ((x - centre[e]).cwiseQuotient(half[e]).squaredNorm() < 1.0) return true;
    return false;
  };
  RandomBody body{.image = image_of({static_cast<Index>(cells.x()), static_cast<Index>(cells.y()),
                                     static_cast<Index>(cells.z())},
                                    Vec3::Constant(voxel), inside),
                  .boundary = {},
                  .name = fmt::format("{:.0f}x{:.0f}x{:.0f}", high.x() - low.x(), high.y() - low.y(),
                                      high.z() - low.z())};
  const Vec3 under = centre[draw.of(std::array<std::size_t, 3>{0, 1, 2})] - low +
                     Vec3::Constant(1.5 * voxel) +
                     diameter * Vec3(draw.between(-0.5, 0.5), draw.between(-0.5, 0.5), 0.0);
  body.boundary = {.base = "inferior",
                   .indent_at = fmt::format("{:.2f},{:.2f},top", under.x(), under.y()),
                   .indenter_diameter_mm = diameter};
  body.nu = draw.of(std::array{0.45, 0.49, 0.499});
  return body;
}

}  // namespace dimple
