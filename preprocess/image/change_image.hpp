#pragma once

#include "io/label_image.hpp"

namespace dimple {

/// The image in voxels twice as long along each axis. Of eight voxels the new one takes the label that most
/// of the foreground has, or background if that is more than half. Where two are as many they take turns, as
/// on a chessboard, so that nothing grows or shrinks. What of the last ones lies outside of the image counts
/// as background.
LabelImage in_double_voxels(const LabelImage& image);

/// The image without what is farther than `radius_mm` from the line through `place_mm` along `direction`;
/// both LPS.
LabelImage without_far_tissue(const LabelImage& image, const Vec3& place_mm, const Vec3& direction,
                              double radius_mm);

/// How far the given labels (none: all) reach along a direction: the largest x . direction of their voxels'
/// centres [mm].
double reach_of(const LabelImage& image, const std::vector<int>& labels, const Vec3& direction);

}  // namespace dimple
