#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace dimple {

/// Writes `content` beside `file`, flushes it to disk and renames it, so that the final name never holds half
/// a file. Throws OutputError with the system's reason (disk full, read-only, no such folder).
void write_file(const std::filesystem::path& file, std::string_view content);

/// The whole file. Throws InputError with the system's reason.
std::string read_file(const std::filesystem::path& file);

/// SHA-256 of the file's bytes, 64 hexadecimal digits. Throws InputError.
std::string sha256_of_file(const std::filesystem::path& file);

}  // namespace dimple
