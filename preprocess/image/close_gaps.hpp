#pragma once

#include <vector>

#include "io/label_image.hpp"

namespace dimple {

/// An image whose body has no narrow gaps, and what that took.
struct ClosedImage {
  LabelImage image;
  double added_mm3 = 0.0;
  double body_mm3 = 0.0;  ///< of the largest piece before
};

/// Closes gaps narrower than `width_mm` in the body: its largest face-connected piece of the given labels
/// (none: all foreground), which the surface is drawn around. Morphological closing by a ball of half the
/// width on voxel centres, in millimetres whatever the voxels' shape; along a voxel axis the width is met to
/// within one voxel, and no wider gap is closed. The piece is chosen before: a stray piece, or a neighbour
/// that the segmentation holds apart, is not welded on by it. Added voxels take the label of the nearest
/// voxel of the body, of several as near the smallest, whatever stood there.
///
/// The same body gives the same, however its image is stored and however much of it is empty. Angles of a
/// sheared image are taken for right ones. Throws ModelError: a width beyond the body's smallest extent
/// ("close-too-wide"), a box beyond the memory ("memory"); Stopped.
ClosedImage close_gaps(const LabelImage& image, const std::vector<int>& labels, double width_mm);

}  // namespace dimple
