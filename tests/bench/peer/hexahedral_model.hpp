#pragma once

#include "apps/studies/export_mesh.hpp"

namespace dimple {

/// The same with corners only, which must be the first `corner_count` nodes: hexahedra of 20 nodes become
/// those of 8.
ElementModel without_middles(const ElementModel& model, Index corner_count);

/// What `dimple export` makes of a scene, of hexahedra: 20 nodes each (C3D20R), or 8 (hex8), which FEBio
/// gives a pressure of their own.
ElementModel hexahedral_model(const Config& config, bool eight_nodes);

}  // namespace dimple
