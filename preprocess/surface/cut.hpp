#pragma once

#include <vector>

#include "preprocess/surface/body_surface.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

// Cuts through a body at rest. Lengths in mm, in the body's own frame. A cut is a gap bounded by both of its
// faces, so that all code for folds serves for cuts: sight, supports, cells, drawings.

/// A disc of triangles no longer than `step`.
TriangleMesh disc_sheet(const Vec3& centre, const Vec3& normal, double radius, double step);
/// Sheet that an edge sweeps along the segment x-y in the direction `into`, across the segment: from `above`
/// before it to `depth` behind it.
TriangleMesh swept_sheet(const Vec3& x, const Vec3& y, const Vec3& into, double above, double depth,
                         double step);

/// A part of a body that a cut has separated from the rest.
struct CutPiece {
  double volume_mm3;
  Vec3 centre;  ///< of its volume
};

struct CutBody {
  BodySurface surface;             ///< of the piece that is kept
  double removed_mm3 = 0.0;        ///< of the body in the gaps themselves
  double area_mm2 = 0.0;           ///< of one face of the cuts by open sheets
  std::vector<CutPiece> parted;    ///< not kept, largest first
  std::vector<BodySurface> taken;  ///< around the tissue that each sheet removes
};

/// The body without the tissue within half a `gap` of the sheets.
/// 1. Solid of each sheet: a closed sheet's region, or an open sheet thickened by half a gap on both sides.
///    An open sheet that ends in the tissue has a blunt end as wide as the gap.
/// 2. Body := body minus solid, by CGAL's corefinement (Boolean difference of closed surfaces).
/// 3. Vertices and triangles in canonical order; the cut must have removed volume.
/// 4. Of the pieces the one nearest to `keep` remains, with its hollows.
///
/// The mechanics of a gap narrower than the node spacing do not depend on its width. Throws ModelError: a
/// sheet misses the body, is too sharply bent for its gap, or nothing is left ("cut"); Stopped.
CutBody cut(const BodySurface& body, const std::vector<TriangleMesh>& sheets, double gap, const Vec3& keep);

/// Distance from x to the nearest place of the sheets; infinite without any.
double distance_to(const std::vector<TriangleMesh>& sheets, const Vec3& x);

}  // namespace dimple
