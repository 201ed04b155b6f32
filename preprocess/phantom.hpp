#pragma once

#include <string>

#include "io/label_image.hpp"

namespace dimple {

/// A body that the project can make itself, so that the demo and the tests need no download.
struct PhantomOptions {
  std::string shape = "brain";            ///< brain, block, cut-ellipsoid, cylinder
  Vec3 size_mm = {92.5, 62.5, 28.5};      ///< extent along L-R.. see make_phantom
  double spacing_mm = 1.0;                ///< voxel edge
  bool two_labels = false;                ///< the inside as a second label
};

/// The label image of a phantom: deterministic, axis-aligned, background border on all sides.
///
///   brain          two hemispheres with a fissure, flat base as in the mould of Horton et al. 2007 (section 4:
///                  92.5 x 62.5 x 28.5 mm, 89.9 g); labels 1 left_hemisphere, 2 right_hemisphere
///                  (with two_labels: also 3 deep tissue inside both)
///   block          a box; label 1
///   cut-ellipsoid  half-axes a = size[0]/2, b = size[1]/2, c = size[2]/1.7, cut flat at z = -0.7 c
///   cylinder       axis along z, diameter size[0], height size[2]
///
/// Throws UsageError: unknown shape, a size or spacing that is not positive, fewer than 8 voxels across.
LabelImage make_phantom(const PhantomOptions& options);

}  // namespace dimple
