#pragma once

#include "io/label_image.hpp"

namespace dimple {

/// An image of voxels of `spacing` mm, of which each has label(i, j, k); true and false are 1 and 0.
template <class Label>
LabelImage image_of(std::array<Index, 3> size, const Vec3& spacing, const Label& label) {
  LabelImage image;
  image.size = size;
  image.to_world = Eigen::Affine3d(Eigen::Scaling(spacing));
  std::vector<std::int32_t> row(static_cast<std::size_t>(size[0]));
  for (Index k = 0; k < size[2]; ++k)
    for (Index j = 0; j < size[1]; ++j) {
      for (Index i = 0; i < size[0]; ++i) row[static_cast<std::size_t>(i)] = label(i, j, k);
      append_row(image, row);
    }
  return image;
}

}  // namespace dimple
