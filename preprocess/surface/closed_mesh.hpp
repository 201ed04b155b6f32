#pragma once

#include "io/types.hpp"

namespace dimple {

/// Triangles with common vertices, by number.
struct TriangleMesh {
  Points vertex;  ///< [3xV]
  Triangles triangles;
};

/// Signed volume: positive if the triangles face outward.
double enclosed_volume(const TriangleMesh& mesh);

/// Does each edge have two triangles in opposite directions, and each vertex one fan of triangles or none?
bool is_closed(const Triangles& triangles, Index vertices);

/// Makes a closed surface a manifold where it meets itself at an edge or a corner: its sheets get vertices of
/// their own there, at the same places. Every edge then has two triangles and every vertex one fan. The
/// volume does not change. Throws ModelError if the surface has a border.
void separate_coincident_sheets(TriangleMesh& mesh);

}  // namespace dimple
