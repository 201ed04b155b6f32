#pragma once

#include "io/vtk_files.hpp"
#include "preprocess/model.hpp"
#include "solver/terms/rigid_contact.hpp"

namespace dimple {

/// Tool as a closed cylinder at rest, three radii long. Its foot has the shape of the skin under it, since
/// the bonded nodes move as one. Positions in LPS mm.
SurfaceFile tool_body(const Discretisation& model);
/// Contacting tool at first contact; a punch is drawn three radii long.
SurfaceFile tool_body(const RigidBody& indenter);

/// ParaView script that shows the results of its own folder: the text of view.py, the same for every run.
extern const char* const view_script;
inline constexpr const char* view_file = "view.py";

}  // namespace dimple
