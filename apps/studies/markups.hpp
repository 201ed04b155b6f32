#pragma once

#include <filesystem>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// True if a name is that of a markups file of 3D Slicer: .fcsv, .mrk.json or .json.
bool is_markups_file(const std::filesystem::path& file);

/// Points of the file in LPS mm, converted from the space of the file. Throws InputError: it cannot be read,
/// has no point, or does not state its space.
std::vector<Vec3> read_markups(const std::filesystem::path& file);

}  // namespace dimple
