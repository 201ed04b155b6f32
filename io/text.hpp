#pragma once

#include <string>
#include <string_view>

namespace dimple {

/// Text of others on one line of a terminal or a message: control characters, those of U+0080 to U+009F too,
/// and bytes that are not UTF-8 come out as \x1b. What is longer than `most` bytes ends with "...".
std::string printable(std::string_view text, std::size_t most = std::string_view::npos);

/// The same of several lines: their ends and tabs stay.
std::string printable_lines(std::string_view text);

/// JSON as it may go to a terminal: what it leaves as it is of control characters becomes \u007f.
std::string printable_json(std::string_view json);

/// As a shell reads it for one word: in single quotes, unless it is plain.
std::string shell_word(std::string_view text);

/// With small letters for the capitals of ASCII.
std::string lower(std::string_view text);

/// Without blanks, tabs and ends of lines before and after it.
std::string_view trimmed(std::string_view text);

/// Bytes of the character that begins `text`, which is not empty; 0: it is not UTF-8.
std::size_t length_of_character(std::string_view text);

bool is_utf8(std::string_view text);

/// A TOML basic string on one line, in quotes, that reads back to `text`. Needs: UTF-8.
std::string toml_string(std::string_view text);

}  // namespace dimple
