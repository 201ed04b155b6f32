#pragma once

#include "io/vtk_files.hpp"
#include "preprocess/model.hpp"
#include "solver/terms/touching_tool.hpp"

namespace dimple {

/// The tool as a closed cylinder at rest, three radii long. Its foot has the shape of the skin under it,
/// since the circle's nodes move as they lie. Positions in LPS mm.
SurfaceFile tool_body(const Discretisation& model);
/// A tool that touches, where it first touches; a punch is drawn three radii long.
SurfaceFile tool_body(const Touch& touch);

/// A script for ParaView that shows the results in its own folder: the text of view.py, the same for every
/// run.
extern const char* const view_script;
inline constexpr const char* view_file = "view.py";

}  // namespace dimple
