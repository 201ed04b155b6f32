#pragma once

#include <filesystem>
#include <string>

namespace dimple {

// 3D Slicer runs a program that describes itself by --xml as a module of its own (the Slicer Execution
// Model): it makes a panel of the description, gives every value by its flag, and reads tags of progress on
// stdout.

/// In the description a hidden one, which is always given.
inline constexpr const char* slicer_flag = "--slicer";

/// `dimple run`, made from the option table.
std::string slicer_xml();

/// What the panel shows after the run, as lines of name = value. Throws OutputError.
void write_return_parameters(const std::filesystem::path& file, const std::string& summary_json);

}  // namespace dimple
