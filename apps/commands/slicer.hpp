#pragma once

#include <filesystem>
#include <string>

namespace dimple {

// 3D Slicer runs a program that describes itself with --xml as a module (Slicer Execution Model): it makes a
// panel from the description, gives every value by its flag, and reads progress tags on stdout.

/// Hidden flag of the description, which Slicer always gives.
inline constexpr const char* slicer_flag = "--slicer";

/// Description of `dimple run`, from the option table.
std::string slicer_xml();

/// Writes the results that the panel shows after the run, as lines of name = value. Throws OutputError.
void write_return_parameters(const std::filesystem::path& file, const std::string& summary_json);

}  // namespace dimple
