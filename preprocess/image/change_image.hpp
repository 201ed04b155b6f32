#pragma once

#include "io/label_image.hpp"

namespace dimple {

/// The image in voxels twice as long along each axis. Of eight voxels, the new one has the most frequent
/// foreground label, or background if that is more than half. Ties alternate as on a chessboard, so that
/// nothing grows or shrinks. Parts of the last voxels outside of the image count as background.
LabelImage in_double_voxels(const LabelImage& image);

/// The image without tissue farther than `radius_mm` from the line `place_mm` + t `direction` (LPS).
LabelImage without_far_tissue(const LabelImage& image, const Vec3& place_mm, const Vec3& direction,
                              double radius_mm);

/// Extent of the given labels (none: all) along a direction: the largest x . direction of their voxels'
/// centres [mm].
double reach_of(const LabelImage& image, const std::vector<int>& labels, const Vec3& direction);

}  // namespace dimple
