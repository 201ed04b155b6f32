#pragma once

#include <filesystem>

#include "io/vtk_files.hpp"

namespace dimple {

/// Whether that is the name of one, by its suffix.
bool is_surface_file(const std::string& name);

/// A surface that another program has drawn: STL (text or binary), OBJ or VTP, known by its suffix; polygons
/// in triangles, corners nearer to each other than a millionth of its size made one, and triangles that are
/// no more than a line then left out. Coordinates as they are in the file. Throws InputError: missing, of
/// another kind, damaged, without a triangle, a corner that is no finite number, or of more than two million
/// triangles.
SurfaceFile read_surface_mesh(const std::filesystem::path& file);

}  // namespace dimple
