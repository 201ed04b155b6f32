#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace dimple {

/// All files below `folder`, relative to it, sorted.
std::vector<std::string> files_in(const std::filesystem::path& folder);

/// Expects that every file below `folder` is complete: it reads as its suffix says, and lists only existing
/// frames. Leftovers of a killed run (names that start with a dot) may be anything; with `without_leftovers`
/// there must be none.
void expect_whole_files(const std::filesystem::path& folder, bool without_leftovers);

/// Expects that two runs have left the same files, bit for bit except for pictures and the wall times in
/// summary.json.
void expect_same_results(const std::filesystem::path& a, const std::filesystem::path& b);

}  // namespace dimple
