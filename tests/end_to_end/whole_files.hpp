#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace dimple {

/// All files below `folder`, relative to it, sorted.
std::vector<std::string> files_in(const std::filesystem::path& folder);

/// Every file below `folder` is whole: it reads as what its suffix says, and lists only frames that are
/// there. Leftovers of a killed run (names that start with a dot) may be anything; `without_leftovers`: there
/// are none.
void expect_whole_files(const std::filesystem::path& folder, bool without_leftovers);

/// Two runs have left the same: the same files, bit for bit but for pictures and the wall times in
/// summary.json.
void expect_same_results(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace dimple
