#pragma once

#include <string>

#include "io/label_image.hpp"

namespace dimple {

/// A body that the program makes, so that the demo and the tests need no download.
struct PhantomOptions {
  std::string shape = "brain";        ///< brain, block, cut-ellipsoid, cylinder
  Vec3 size_mm = {92.5, 62.5, 28.5};  ///< extents; along which axes, see make_phantom
  double spacing_mm = 1.0;            ///< voxel edge
  bool two_labels = false;            ///< the inside as a second label
};

/// The label image of a phantom: deterministic, axis-aligned (i, j, k along +L, +P, +S), two voxels of
/// background on all sides. A voxel belongs to the body if its centre does.
///
///   brain          two hemispheres with a fissure on top, flat base as in the mould of Horton et al. 2007
///                  (section 4: 92.5 x 62.5 x 28.5 mm, 89.9 g). size[0] is the length along P, size[1] the
///                  width along L, size[2] the height along S. Labels 1 left_hemisphere (x > 0),
///                  2 right_hemisphere; with two_labels also 3 deep_tissue, an ellipsoid inside both.
///   block          a box; label 1; with two_labels 1 lower_half, 2 upper_half
///   cut-ellipsoid  half-axes a = size[0]/2, b = size[1]/2, c = size[2]/1.7, cut flat at z = -0.7 c
///   cylinder       axis along z, diameter size[0] (size[1] is not used), height size[2]
///
/// Unless stated otherwise, size is along x, y, z, and two_labels makes 1 shell and 2 core, the core half as
/// large. The body is centred at x = y = 0; its base is at z = 0 (cut-ellipsoid: its centre at z = 0, its
/// base at z = -0.7 c), always on a face of the voxel lattice. The sides are too if the spacing divides the
/// size.
///
/// Throws UsageError: unknown shape, a size or spacing that is not positive, fewer than 8 voxels across, more
/// than 2^31 voxels.
LabelImage make_phantom(const PhantomOptions& options);

}  // namespace dimple
