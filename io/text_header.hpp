#pragma once

// The headers of NRRD and MetaImage as text: ITK keeps neither the unit of an NRRD nor the start of the
// voxels, and must not receive headers that crash it. Used by label_itk.cpp only.

#include <charconv>
#include <cstdlib>
#include <filesystem>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "io/label_formats.hpp"
#include "io/label_names.hpp"

namespace dimple {

/// The lines `key<separator>value` that both formats start with.
struct TextHeader {
  KeyValues value;
  std::vector<std::string> line;  ///< all of them, without blanks around
  std::size_t bytes = 0;          ///< length of the header
  bool complete = false;

  bool has(const std::string& key) const { return value.contains(key); }
  std::string at(const std::string& key) const {
    const auto found = value.find(key);
    return found == value.end() ? std::string() : found->second;
  }
};

/// Part of a file that is searched for the end of its header [bytes].
constexpr std::uintmax_t longest_header = 1 << 22;

/// Ends at an empty line (NRRD) or after the line with `last_key` (MetaImage).
TextHeader read_text_header(const std::filesystem::path& file, char separator, std::string_view last_key);

/// Length of a file [bytes]; 0 if it is not available.
std::uintmax_t length_of(const std::filesystem::path& file);

/// The whole text as one number.
template <class T>
std::optional<T> number_in(std::string_view text) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (end != text.data() + text.size()) return std::nullopt;
  if constexpr (std::is_floating_point_v<T>)  // 1e-310 is a small number, not a large one
    if (error == std::errc::result_out_of_range) return std::strtod(std::string(text).c_str(), nullptr);
  if (error != std::errc()) return std::nullopt;
  return value;
}

bool is_true(const std::string& word);

/// The first of several names of one thing.
std::string either(const TextHeader& header, std::initializer_list<const char*> keys);

InputError unreadable(const std::filesystem::path& file, const std::string& format, std::string_view why);

/// Throw InputError for headers that ITK's reader would misread, wait for, crash on or reject with a wrong
/// reason. `warnings` receives what the header leaves open.
void check_nrrd_header(const TextHeader& header, const std::filesystem::path& file);
void check_metaimage_header(const TextHeader& header, const std::filesystem::path& file,
                            std::vector<std::string>& warnings);

}  // namespace dimple
