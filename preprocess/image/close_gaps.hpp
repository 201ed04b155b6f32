#pragma once

#include <vector>

#include "io/label_image.hpp"

namespace dimple {

/// An image whose body has no narrow gaps, and the volume that was added.
struct ClosedImage {
  LabelImage image;
  double added_mm3 = 0.0;
  double body_mm3 = 0.0;  ///< of the largest piece before
};

/// Closes gaps narrower than `width_mm` in the body: its largest face-connected piece of the given labels
/// (none: all foreground), of which the surface is made. Morphological closing by a ball of half the width on
/// voxel centres, in millimetres for any shape of voxels. Along a voxel axis the width is exact to one voxel,
/// and no wider gap is closed. The piece is chosen before, so that stray pieces and separate neighbours are
/// not joined to it. Added voxels get the label of the nearest voxel of the body, the smallest among equals;
/// those with a chosen label keep it.
///
/// The result does not depend on how the image is stored or cropped. Angles of a sheared image are treated as
/// right ones. Throws ModelError: a width beyond the body's smallest extent ("close-too-wide"), a box beyond
/// the memory ("memory"); Stopped.
ClosedImage close_gaps(const LabelImage& image, const std::vector<int>& labels, double width_mm);

}  // namespace dimple
