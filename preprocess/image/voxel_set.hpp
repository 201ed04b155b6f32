#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "io/label_image.hpp"

namespace dimple {

/// Some voxels of a box, as stretches along i. Those of a row ascend and are separate.
struct VoxelSet {
  struct Stretch {
    std::int32_t begin, end;  ///< voxels [begin, end)
  };
  std::array<Index, 3> first{};  ///< where the box begins in the image; may be outside of it
  std::array<Index, 3> size{};
  std::vector<Stretch> stretch;     ///< of all rows, j fastest
  std::vector<std::size_t> offset;  ///< [size[1]*size[2] + 1] where in `stretch` each row begins

  std::span<const Stretch> row(Index j, Index k) const {
    const std::size_t* at = offset.data() + (j + size[1] * k);
    return {stretch.data() + at[0], stretch.data() + at[1]};
  }
};

/// Voxels of the image with one of the labels (none: all foreground), in their box and one voxel around it.
/// Empty if there is none.
VoxelSet voxels_with(const LabelImage& image, const std::vector<int>& labels);

/// The voxels in a box that fits them with one voxel around it.
VoxelSet cropped(const VoxelSet& set);

/// The other voxels of the box.
VoxelSet complement(const VoxelSet& set);

/// Axes in another order and direction: new axis d is the old axis[d], backwards where reversed[d]. Never a
/// mirror image.
struct AxisOrder {
  std::array<int, 3> axis = {0, 1, 2};
  std::array<bool, 3> reversed{};
  bool operator==(const AxisOrder&) const = default;
};

/// Order of the axes from the voxels themselves, independent of the scanner's. k: along the axis of largest
/// skewness, towards the thinner tail (the top of a dome), else the axis on which they are thinnest. j: along
/// the longer one of the others, likewise. If no order is better than another (a block), it remains.
/// `spacing` [mm] of the axes.
AxisOrder own_order(const VoxelSet& set, const Vec3& spacing);

/// The voxels in that order; `first` counts from the corner of an image of this size that is the first voxel
/// then.
VoxelSet reordered(const VoxelSet& set, const AxisOrder& order, const std::array<Index, 3>& image_size);

/// Face-connected pieces, in the order of their first voxels.
struct Pieces {
  struct Piece {
    std::int64_t voxels = 0;
    Vec3 centre = Vec3::Zero();  ///< mean of its voxels' places in the box
  };
  std::vector<Piece> piece;
  std::vector<std::int32_t> of_stretch;  ///< [stretches]
};
Pieces face_connected(const VoxelSet& set);

/// Number of the piece with the most voxels; among equals, the first.
std::size_t largest(const Pieces& pieces);

/// Only the pieces with kept[piece].
VoxelSet selection(const VoxelSet& set, const Pieces& pieces, const std::vector<bool>& kept);

}  // namespace dimple
