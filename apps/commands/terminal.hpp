#pragma once

#include <cstddef>
#include <string>

namespace dimple {

/// Columns of the terminal behind a file descriptor: what COLUMNS says, else what the terminal says, else 80.
std::size_t terminal_width(int file_descriptor);

/// At most `width` characters a line; the rest of a longer one goes below its description, which begins at
/// `column` if the line is one of a list. CLI11 leaves lines as long as they are.
std::string wrapped(const std::string& text, std::size_t column, std::size_t width);

/// To stdout or stderr, with control characters of names that others have given as \x1b: only the ends of
/// lines and tabs are kept. No command prints otherwise.
void print(const std::string& text);
void print_error(const std::string& text);
/// The same for JSON, which stays JSON.
void print_json(const std::string& json);

}  // namespace dimple
