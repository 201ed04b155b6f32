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

/// What was taken from the image, and what was not.
struct SegmentReport {
  std::vector<int> labels;          ///< taken
  double label_volume_mm3 = 0.0;    ///< of all voxels with these labels
  int pieces = 0;                   ///< face-connected; only the largest is kept
  double dropped_volume_mm3 = 0.0;  ///< of the others
  std::vector<Cavity> cavities;     ///< largest first
  double voxel_volume_mm3 = 0.0;    ///< of what is kept and filled: the surface encloses the same
  bool cut_by_border = false;       ///< the organ goes on outside the image
  double step_mm = 0.0;             ///< of the lattice on which the surface is drawn
  double smoothing_mm = 0.0;        ///< standard deviation of the Gaussian along the coarsest voxel axis
  std::vector<std::string> warnings;
};

struct SurfaceOptions {
  double indenter_diameter_mm = 10.0;
  double step_mm = 0.0;    ///< of the lattice; 0: as said below
  double smoothing = 1.0;  ///< times the Gaussian said below
  double outward_mm =
      0.0;  ///< the body is drawn larger by this, or smaller: its borders are as uncertain as the voxels
};

struct SegmentedBody {
  BodySurface surface;
  SegmentReport report;
};

/// A smooth surface around the voxels with the given labels (none: all foreground), not the voxel staircase.
///
/// The indicator (1 inside, 0 outside) is smoothed by a Gaussian of 0.7 voxel or half a lattice step,
/// whichever is more, and contoured half-way on a lattice. Its step is the smallest voxel edge or, if that is
/// more, the smaller of a seventh of the tool's diameter and 1/100 of the organ, but at least 1/250 of
/// the organ, whose measure is the cube root of its volume. The vertices then move to where the voxels' faces
/// place the surface (place_between_voxels()). It encloses the voxels' volume within 0.1 %; with
/// `outward_mm`, what that adds to them. It comes from the image and the tool alone,
/// whatever the cloud. Cavities smaller than 1/500 of the organ are filled. Throws InputError (a label that
/// is not there), ModelError (too few voxels for a body, or one so thin that smoothing takes a third of it).
SegmentedBody make_body_surface(const LabelImage& image, const std::vector<int>& labels,
                                const SurfaceOptions& options = {});

/// Share of the surface's area, in [0, 1], that faces another part of it across less than `width_mm`: its
/// outward normal meets the surface again within that. A smooth organ has none, one with folds a third. Asked
/// of at most 2000 triangles, spread over all: known to about one per cent.
double facing_share(const BodySurface& surface, double width_mm);

}  // namespace dimple
