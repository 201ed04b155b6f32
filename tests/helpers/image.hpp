#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "io/label_image.hpp"

namespace dimple {

/// Indices of a voxel as coordinates.
inline Vec3 place_of(Index i, Index j, Index k) {
  return {static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)};
}

/// Image of voxels of `spacing` mm with labels label(i, j, k); true and false are 1 and 0.
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

/// Replaces all voxels: image.size[0]*size[1]*size[2] labels, i fastest.
inline void set_voxels(LabelImage& image, std::span<const std::int32_t> label) {
  image.run.clear();
  image.row_offset.clear();
  const auto length = static_cast<std::size_t>(image.size[0]);
  for (std::size_t first = 0; first < label.size(); first += length)
    append_row(image, label.subspan(first, length));
}

/// The label of every voxel, i fastest.
inline std::vector<std::int32_t> every_voxel(const LabelImage& image) {
  std::vector<std::int32_t> label(static_cast<std::size_t>(image.size[0] * image.size[1] * image.size[2]), 0);
  std::int32_t* row = label.data();
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j, row += image.size[0])
      for (const Run& r : image.row(j, k)) std::fill(row + r.begin, row + r.end, r.label);
  return label;
}

}  // namespace dimple
