#pragma once

#include "preprocess/model.hpp"
#include "preprocess/surface/body_surface.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

/// The model's surface [mm, LPS] where displacements u [3xN] m of its nodes have brought it.
BodySurface deformed_surface(const Model& model, const Points& u);

/// A blade's sheet [mm, LPS] as it lies in the deformed body, carried back to where its places were at rest.
///
/// In the body a place x goes to X with X + u(X) = x, u the moving-least-squares field, by Newton's method
/// from the nodes that have come nearest to x, until X + u(X) lies within a micrometre of x. Outside of it,
/// farther than a quarter of the nodes' spacing, where there is no u, the way back continues from the sheet's
/// places in the body, harmonically over the sheet; if it has none there, as that of the surface next to x.
/// Of an open sheet what lies farther from the body than its triangles are large is left out: no triangle of
/// it meets the body.
///
/// Throws ModelError ("cut"): x has two such X, as where a fold or a cut has closed and its walls have passed
/// through each other; the search settles nowhere, as in tissue that is turned inside out; no part of the
/// sheet lies in the body or near to it; Stopped.
TriangleMesh carried_back(const TriangleMesh& sheet, const Model& model, const Points& u);

/// Where a straight stroke on the deformed body lies at rest: an edge goes from x to y [mm, LPS] on its
/// surface, straight into the tissue there, `depth` [mm] below the way between the two; in triangles of
/// `step` [mm].
///
/// As carried_back() of what it sweeps, without the deformed surface, which a live cut has no time for: the
/// way into the body is the mean of the rest surface's normals along the stroke, turned by the deformation
/// gradient there, and outside of the tissue the way back continues from that inside alone. `rest`: the
/// model's surface. Throws ModelError ("cut"): no way into the body, or none back to where it was.
TriangleMesh stroke_at_rest(const Vec3& x, const Vec3& y, double depth, double step, const Model& model,
                            const Points& u, const BodySurface& rest);

}  // namespace dimple
