#pragma once

#include <string>
#include <string_view>

namespace dimple {

/// Text of others for one line of a terminal or a message: control characters, U+0080 to U+009F included, and
/// bytes that are not UTF-8 are written like \x1b. Text longer than `most` bytes ends with "...".
std::string printable(std::string_view text, std::size_t most = std::string_view::npos);

/// Text of several lines, treated alike; ends of lines and tabs are kept.
std::string printable_lines(std::string_view text);

/// JSON for a terminal: control characters that JSON allows unescaped become \u007f.
std::string printable_json(std::string_view json);

/// A word for a shell: in single quotes, unless it is plain.
std::string shell_word(std::string_view text);

/// The text with the capitals of ASCII in lower case.
std::string lower(std::string_view text);

/// The text without blanks, tabs and ends of lines before and after it.
std::string_view trimmed(std::string_view text);

/// Bytes of the character that begins `text`, which is not empty; 0: it is not UTF-8.
std::size_t length_of_character(std::string_view text);

bool is_utf8(std::string_view text);

/// A TOML basic string on one line, in quotes, that reads back to `text`. Needs: UTF-8.
std::string toml_string(std::string_view text);

}  // namespace dimple
