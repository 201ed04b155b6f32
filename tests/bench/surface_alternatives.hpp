#pragma once

#include "io/label_image.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

/// The surface of all foreground voxels by the level set of Whitaker (2000), for comparison: ITK's
/// AntiAliasBinaryImageFilter, contoured at 0 by flying edges. LPS coordinates [mm]. Iterations end at the
/// root mean square change `rms_change`.
///
/// Source: Whitaker, Reducing aliasing artifacts in iso-surfaces of binary volumes, VolVis 2000. The level
/// set
///         moves by its mean curvature and keeps its sign at each voxel centre. It moves in units of voxels,
///         whatever the spacing.
/// Needs:  three voxels of background on all sides.
TriangleMesh antialiased_surface(const LabelImage& image, double rms_change);

/// The surface of all foreground voxels as a constrained net, for comparison: the contour of the labels,
/// `iterations` steps along the Laplacian of its discrete curvature vector, each vertex held within half a
/// voxel of where it began. LPS coordinates [mm].
///
/// Source: Gibson, Constrained elastic surface nets, MICCAI 1998, who smooths positions; here curvature is
///         smoothed, so that a sphere does not shrink.
/// Needs:  one voxel of background on all sides.
TriangleMesh constrained_net(const LabelImage& image, int iterations);

/// The surface of all foreground voxels by means over neighbours, for comparison: the contour of the smoothed
/// labels, 120 sweeps in which each vertex moves half-way to the mean of its neighbours, but no farther than
/// half a voxel; the smooth part of that motion, which shrinks, is taken back; at last it is moved evenly to
/// the volume of the voxels. LPS coordinates [mm].
///
/// Source: Gibson, Constrained elastic surface nets, MICCAI 1998.
TriangleMesh averaged_net(const LabelImage& image);

}  // namespace dimple
