#pragma once

#include <filesystem>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Whether a name is that of a markups file of 3D Slicer: .fcsv, .mrk.json or .json.
bool is_markups_file(const std::filesystem::path& file);

/// Its places in LPS mm, in whichever space the file has them. Throws InputError: it cannot be read, holds no
/// place, or does not say its space.
std::vector<Vec3> read_markups(const std::filesystem::path& file);

}  // namespace dimple
