#pragma once

#include "preprocess/model.hpp"
#include "preprocess/surface/body_surface.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {

/// The model's surface [mm, LPS] displaced by u [3xN] m of its nodes.
BodySurface deformed_surface(const Model& model, const Points& u);

/// A blade's sheet [mm, LPS] in the deformed body, mapped back to the body at rest.
/// 1. For each vertex x: X + u(X) = x, u the MLS field, by Newton's method from the nodes now nearest to x,
///    to a micrometre.
/// 2. Solutions outside the body at rest count up to a quarter of a spacing from it.
/// 3. Vertices without a solution: displacements continue harmonically over the sheet. If no vertex has one:
///    those of the surface next to x.
/// 4. Triangles of an open sheet that are farther from the body than they are large are left out.
///
/// Throws ModelError ("cut"): x has two such X, since the walls of a closed fold or cut have crossed; no
/// search converges, as in inverted tissue; no part of the sheet is in the body or near it; Stopped.
TriangleMesh carried_back(const TriangleMesh& sheet, const Model& model, const Points& u);

/// Sheet of a straight stroke on the deformed body, mapped back to rest. An edge moves from x to y [mm, LPS]
/// on the surface and cuts straight into the tissue to `depth` [mm] below the segment x-y; in triangles of
/// `step` [mm]. Like carried_back() of the swept sheet, but without the deformed surface, which takes too
/// long for a live cut. The direction into the body is the mean of the rest surface's normals along the
/// stroke, rotated by the deformation gradient. Outside the tissue the mapping continues from that inside
/// only. `reference`: the model's surface. Throws ModelError ("cut"): no direction into the body, or no place
/// at rest.
TriangleMesh reference_stroke(const Vec3& x, const Vec3& y, double depth, double step, const Model& model,
                              const Points& u, const BodySurface& reference);

}  // namespace dimple
