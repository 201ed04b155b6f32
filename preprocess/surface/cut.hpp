#pragma once

#include <vector>

#include "preprocess/surface/body_surface.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

// Cuts through a body at rest. Lengths in mm, in the body's own frame. A cut is a gap: the body's surface
// goes round it on both banks, so that all that knows folds knows cuts: sight, supports, cells, drawings.

/// A disc of triangles no longer than `step`.
TriangleMesh disc_sheet(const Vec3& centre, const Vec3& normal, double radius, double step);
/// What an edge sweeps from `above` before the way from x to y to `depth` behind it, in the direction `into`,
/// which is across that way.
TriangleMesh swept_sheet(const Vec3& x, const Vec3& y, const Vec3& into, double above, double depth,
                         double step);

/// A part of a body that a cut has parted from the rest.
struct CutPiece {
  double volume_mm3;
  Vec3 centre;  ///< of its volume
};

struct CutBody {
  BodySurface surface;             ///< of the piece that is kept
  double removed_mm3 = 0.0;        ///< of the body in the gaps themselves
  double area_mm2 = 0.0;           ///< of one bank of the cuts by open sheets
  std::vector<CutPiece> parted;    ///< not kept, largest first
  std::vector<BodySurface> taken;  ///< around what each of the sheets takes out
};

/// The body without what lies within half a `gap` of the sheets; of its pieces the one nearest to `keep`.
/// A closed sheet is a region that is taken out whole. Where a sheet ends in the tissue the gap has a blunt
/// end as wide as itself. The mechanics of a gap narrower than the spacing of the nodes do not depend on its
/// width. Source: of the difference of two closed surfaces CGAL's corefinement. Throws ModelError: a sheet
/// misses the body, is too sharply bent for its gap, or nothing is left ("cut"); Stopped.
CutBody cut(const BodySurface& body, const std::vector<TriangleMesh>& sheets, double gap, const Vec3& keep);

/// From x to the nearest place of the sheets; infinite without any.
double distance_to(const std::vector<TriangleMesh>& sheets, const Vec3& x);

}  // namespace dimple
