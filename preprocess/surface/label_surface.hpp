#pragma once

#include <string>
#include <vector>

#include "io/label_image.hpp"
#include "preprocess/surface/body_surface.hpp"

namespace dimple {

/// A hollow inside the organ that is not connected with its surroundings.
struct Cavity {
  double volume_mm3;
  Vec3 centre_mm;  ///< mean of its voxels' positions, LPS
  bool filled;     ///< it is smaller than 0.2 % of the organ
};

/// Report on the voxels that were used, and those that were not.
struct SegmentReport {
  std::vector<int> labels;          ///< used
  double label_volume_mm3 = 0.0;    ///< of all voxels with these labels
  int pieces = 0;                   ///< face-connected; only the largest is kept
  double dropped_volume_mm3 = 0.0;  ///< of the others
  std::vector<Cavity> cavities;     ///< largest first
  double voxel_volume_mm3 = 0.0;    ///< of what is kept and filled: the surface encloses the same
  bool cut_by_border = false;       ///< the organ continues outside the image
  double step_mm = 0.0;             ///< of the lattice on which the surface is drawn
  double smoothing_mm = 0.0;        ///< standard deviation of the Gaussian along the coarsest voxel axis
  std::vector<std::string> warnings;
};

struct SurfaceOptions {
  double indenter_diameter_mm = 10.0;
  double step_mm = 0.0;    ///< of the lattice; 0: the default below
  double smoothing = 1.0;  ///< times the default Gaussian below
  double outward_mm =
      0.0;  ///< the body is drawn larger or smaller by this: its borders have the accuracy of the voxels
};

struct SegmentedBody {
  BodySurface surface;
  SegmentReport report;
};

/// Smooth surface of the voxels with the given labels (none: all foreground), without voxel steps.
/// 1. Largest face-connected piece; cavities smaller than 1/500 of it are filled. Its own frame: own_order().
/// 2. Lattice step h: the smallest voxel edge or, if larger, min(d/7, L/100), but at least L/250. d is the
///    tool's diameter, L the cube root of the organ's volume.
/// 3. Indicator (1 inside, 0 outside), smoothed by a discrete Gaussian, sigma = max(0.7 voxel, h/2) along
///    each axis (smooth_lattice.hpp).
/// 4. One body above the level, without small cavities. Level 1/2, or `0.5 erfc(outward / (sqrt(2) sigma))`.
/// 5. Contour at the level by flying edges (VTK); h grows if there are more than a million triangles.
/// 6. Vertices move to the surface between the voxels' faces: place_between_voxels().
///
/// The surface encloses the voxels' volume within 0.1 %, plus the volume that `outward_mm` adds. It depends
/// on the image and the tool's diameter, not on the nodes. Throws InputError (a label that is not there),
/// ModelError (too few voxels for a body, or one so thin that smoothing takes a third of it).
SegmentedBody make_body_surface(const LabelImage& image, const std::vector<int>& labels,
                                const SurfaceOptions& options = {});

/// Fraction of the surface's area, in [0, 1], that faces another part of it across less than `width_mm`: its
/// outward normal meets the surface again within that. 0 for a smooth organ, a third for one with folds.
/// Sampled at up to 2000 triangles: accurate to about one per cent.
double facing_fraction(const BodySurface& surface, double width_mm);

}  // namespace dimple
