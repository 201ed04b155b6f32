#pragma once

#include <filesystem>

#include "io/vtk_files.hpp"

namespace dimple {

/// What surfaces are read from.
inline constexpr const char* surface_suffixes = ".stl, .obj and .vtp";

/// Whether that is the name of one, by its suffix.
bool is_surface_file(const std::string& name);

/// A surface that another program has drawn: STL (text or binary), OBJ or VTP, known by its suffix; polygons
/// in triangles, corners nearer to each other than a millionth of its size made one, and triangles that are
/// no more than a line then left out. Coordinates as they are in the file, but x and y negated where it says
/// SPACE=RAS: in the title of an STL, a comment of an OBJ, the field data of a VTP. Throws InputError:
/// missing, of another kind, damaged, without a triangle, a corner that is no finite number, a triangle that
/// is there twice, or of more than two million triangles.
SurfaceFile read_surface_mesh(const std::filesystem::path& file);

}  // namespace dimple
