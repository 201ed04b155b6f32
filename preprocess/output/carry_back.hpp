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
/// where there is no u, x lies so far before the place of the surface next to it as it does now, along the
/// normal there; but not beyond half of the way to what the surface faces at rest, as in a cut that gapes. Of
/// an open sheet what lies farther from the body than its triangles are large is left out: no triangle of it
/// meets the body.
///
/// Throws ModelError ("cut"): x has two such X, as where a fold or a cut has closed and its walls have passed
/// through each other; the search settles nowhere, as in tissue that is turned inside out; no part of the
/// sheet lies in the body or near to it; Stopped.
TriangleMesh carried_back(const TriangleMesh& sheet, const Model& model, const Points& u);

}  // namespace dimple
