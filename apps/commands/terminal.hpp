#pragma once

#include <cstddef>
#include <string>

namespace dimple {

/// Columns of the terminal of a file descriptor: COLUMNS, else the terminal's own value, else 80.
std::size_t terminal_width(int file_descriptor);

/// Text with at most `width` characters per line, which CLI11 does not ensure. In a list, continued lines
/// begin at `column`, below the description.
std::string wrapped(const std::string& text, std::size_t column, std::size_t width);

/// Prints to stdout or stderr. Control characters, which names of others may hold, appear as \x1b; only
/// newlines and tabs are kept. No command prints in another manner.
void print(const std::string& text);
void print_error(const std::string& text);
/// Prints JSON, with control characters as escapes of JSON.
void print_json(const std::string& json);

}  // namespace dimple
