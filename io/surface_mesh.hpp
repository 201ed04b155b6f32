#pragma once

#include <filesystem>

#include "io/vtk_files.hpp"

namespace dimple {

/// Suffixes of surface files.
inline constexpr const char* surface_suffixes = ".stl, .obj and .vtp";

/// True for the name of a surface file, by its suffix.
bool is_surface_file(const std::string& name);

/// A surface from another program: STL (text or binary), OBJ or VTP, by its suffix. Polygons become
/// triangles, corners within a millionth of its size are merged, and degenerate triangles are left out.
/// Coordinates are those of the file, with x and y negated where it has SPACE=RAS: in the title of an STL, a
/// comment of an OBJ, the field data of a VTP. Throws InputError: missing, of another kind, damaged, without
/// a triangle, a corner that is no finite number, a duplicate triangle, or more than two million triangles.
SurfaceFile read_surface_mesh(const std::filesystem::path& file);

}  // namespace dimple
