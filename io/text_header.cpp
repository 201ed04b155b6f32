#include "io/text_header.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <iterator>
#include <set>
#include <span>
#include <sstream>

#include "io/text.hpp"

namespace dimple {

namespace fs = std::filesystem;

namespace {

std::vector<std::string> words_in(const std::string& text) {
  std::istringstream words(text);
  return {std::istream_iterator<std::string>(words), {}};
}

bool are_finite(const std::vector<std::string>& words) {
  return std::all_of(words.begin(), words.end(), [](const std::string& word) {
    const auto value = number_in<double>(std::string_view(word).substr(word.starts_with('+') ? 1 : 0));
    return value && std::isfinite(*value);
  });
}

/// Vector in the form of an NRRD direction: (1,0,0).
std::optional<Vec3> vector_of_three(const std::string& word) {
  if (word.size() < 3 || word.front() != '(' || word.back() != ')') return std::nullopt;
  std::string numbers = word.substr(1, word.size() - 2);
  if (std::count(numbers.begin(), numbers.end(), ',') != 2) return std::nullopt;
  std::replace(numbers.begin(), numbers.end(), ',', ' ');
  const std::vector<std::string> words = words_in(numbers);
  if (words.size() != 3 || !are_finite(words)) return std::nullopt;
  Vec3 v;
  for (std::size_t r = 0; r < 3; ++r)
    v[static_cast<Index>(r)] =
        *number_in<double>(std::string_view(words[r]).substr(words[r].starts_with('+') ? 1 : 0));
  return v;
}

/// ITK reads one axis of numbers per voxel besides three axes of space; its refusal of others is unclear.
void check_axes(const TextHeader& header, int dimension, const fs::path& file) {
  static const std::set<std::string> independent = {"domain", "space", "time", "none", "???"};
  const auto kinds = words_in(header.at("kinds"));
  const auto numbers = std::count_if(
      kinds.begin(), kinds.end(), [](const std::string& kind) { return !independent.contains(lower(kind)); });
  if (dimension - numbers > 3)
    throw InputError({.fact = fmt::format("the image has {} axes (sizes: {})", dimension,
                                          printable(header.at("sizes"), most_repeated)),
                      .where = image_place(file),
                      .why =
                          "an organ is segmented in one three-dimensional image; a further axis is of time "
                          "or of images",
                      .remedy = "save one time frame or one channel as an image of its own"});
}

// NrrdIO copies a line that it cannot understand into 257 bytes, however long it is. Directions of full
// precision are longer than is safe; of them it understands what is checked here.
void check_long_lines(const TextHeader& header, std::optional<int> dimension, const fs::path& file) {
  constexpr std::size_t longest = 160;
  static const std::set<std::string> spaces = {"right-anterior-superior",
                                               "ras",
                                               "left-anterior-superior",
                                               "las",
                                               "left-posterior-superior",
                                               "lps",
                                               "scanner-xyz",
                                               "3d-right-handed",
                                               "3d-left-handed"};
  bool in_space = false;
  for (const std::string& line : header.line) {
    const auto field = line.find(": "), key = line.find(":=");
    if (line.starts_with('#') || (key != std::string::npos && key < field)) continue;
    const std::string name = lower(line.substr(0, std::min({field, line.size(), std::size_t{40}})));
    const std::string value(field == std::string::npos ? "" : trimmed(line.substr(field + 1)));
    in_space = in_space || (name == "space" && spaces.contains(lower(value))) ||
               (name == "space dimension" && value == "3");
    if (line.size() <= longest || name == "content" || name == "data file" || name == "datafile") continue;
    if (name != "space directions" && name != "measurement frame")
      throw unreadable(file, "NRRD", fmt::format("the line of {} is {} letters long", name, line.size()));
    const std::vector<std::string> vectors = words_in(value);
    const std::size_t expected =
        name == "space directions" ? static_cast<std::size_t>(dimension.value_or(0)) : 3;
    if (!in_space || vectors.size() != expected ||
        !std::all_of(vectors.begin(), vectors.end(),
                     [](const std::string& word) { return word == "none" || vector_of_three(word); }))
      throw unreadable(
          file, "NRRD",
          fmt::format("its {} are not {} vectors of three finite numbers in a space of that dimension", name,
                      expected));
  }
}

// MetaIO ends a key at a blank or colon too, and uses the last of duplicate keys: with another NDims it would
// count for ever.
void check_keys(const TextHeader& header, const fs::path& file) {
  const auto refuse = [&](std::string why) { return unreadable(file, "MetaImage", std::move(why)); };
  std::set<std::string> keys;
  for (std::size_t k = 0; k < header.line.size(); ++k) {
    const std::string& line = header.line[k];
    if (line.find('=') == std::string::npos ||
        std::any_of(line.begin(), line.end(), [](unsigned char c) { return std::iscntrl(c) && c != '\t'; }))
      throw refuse(fmt::format("line {} of its header is not of the form 'key = value'", k + 1));
    if (!keys.insert(line.substr(0, line.find_first_of(" \t=:"))).second)
      throw refuse(fmt::format("line {} of its header has a key that another line has", k + 1));
  }
  for (const auto& [key, value] : header.value)
    if (key.size() > 250 || value.size() > 4000)  // MetaIO's buffers
      throw refuse(
          fmt::format("the line of {} is {} letters long", key.substr(0, 40), key.size() + value.size()));
}

}  // namespace

std::uintmax_t length_of(const fs::path& file) {
  std::error_code failed;
  const std::uintmax_t length = fs::file_size(file, failed);
  return failed ? 0 : length;
}

TextHeader read_text_header(const fs::path& file, char separator, std::string_view last_key) {
  std::string start(static_cast<std::size_t>(std::min(length_of(file), longest_header)), '\0');
  std::ifstream in(file, std::ios::binary);
  in.read(start.data(), static_cast<std::streamsize>(start.size()));
  start.resize(static_cast<std::size_t>(in.gcount()));

  TextHeader header;
  while (header.bytes < start.size()) {
    const auto end = std::min(start.find('\n', header.bytes), start.size());
    const std::string_view text = trimmed(std::string_view(start).substr(header.bytes, end - header.bytes));
    header.bytes = std::min(end + 1, start.size());
    header.complete = text.empty();
    if (header.complete) break;
    header.line.emplace_back(text);
    const auto middle = text.find(separator);
    if (middle == std::string_view::npos) continue;
    const std::string key(trimmed(text.substr(0, middle)));
    header.value.try_emplace(key, trimmed(text.substr(middle + 1)));
    header.complete = key == last_key;
    if (header.complete) break;
  }
  return header;
}

bool is_true(const std::string& word) {
  return !word.empty() && (word.front() == 'T' || word.front() == 't' || word.front() == '1');
}

std::string either(const TextHeader& header, std::initializer_list<const char*> keys) {
  for (const char* key : keys)
    if (header.has(key)) return key;
  return {};
}

InputError unreadable(const fs::path& file, const std::string& format, std::string_view why) {
  return InputError({.fact = fmt::format("'{}' cannot be read as {}", file.filename().string(), format),
                     .where = image_place(file),
                     .why = printable(why, most_repeated),
                     .remedy = "check that the file is complete and of the format that its suffix names; "
                               "export the segmentation again"});
}

void check_nrrd_header(const TextHeader& header, const fs::path& file) {
  const auto refuse = [&](std::string why) { return unreadable(file, "NRRD", std::move(why)); };
  const auto dimension = number_in<int>(header.at("dimension"));
  if (header.has("dimension") && (!dimension || *dimension < 1 || *dimension > 16))
    throw refuse(fmt::format("it is said to have {} axes", header.at("dimension")));
  check_long_lines(header, dimension, file);
  if (const std::string encoding = lower(header.at("encoding")); encoding == "bzip2" || encoding == "bz2")
    throw refuse(
        "its voxels are compressed with bzip2, which is not read; open and save it again in 3D Slicer or "
        "ITK, or by `unu save -f nrrd -e gzip`, and give that file");
  std::string origin = header.at("space origin");
  std::erase_if(origin, [](char c) { return c == '(' || c == ')'; });
  std::replace(origin.begin(), origin.end(), ',', ' ');
  if (!are_finite(words_in(origin)))
    throw refuse(fmt::format("its space origin is {} instead of finite numbers", header.at("space origin")));
  if (const std::string directions = header.at("space directions"); dimension && !directions.empty()) {
    const auto words = words_in(directions);
    const auto none = std::count(words.begin(), words.end(), "none");
    if (*dimension >= 3 && *dimension - none < 3)
      throw refuse(fmt::format("only {} of its axes have a direction", *dimension - none));
    check_axes(header, *dimension, file);
    for (std::size_t a = 0; a < words.size(); ++a)  // ITK divides by the length
      if (const auto v = vector_of_three(words[a]); v && !(v->stableNorm() > 1e-100))
        throw no_place_in_space(
            file, fmt::format("axis {} has the direction {}, which has no length", a + 1, words[a]));
  } else if (dimension.value_or(0) == 3 && !header.has("spacings")) {
    throw refuse(
        "it does not state the voxel size (no space directions and no spacings): if known, add a line such "
        "as `spacings: 1 1 1`, in mm, to the header");
  } else if (const auto spacings = words_in(header.at("spacings")); !are_finite(spacings)) {
    throw refuse(fmt::format("its spacings are {}", header.at("spacings")));
  } else {
    for (const std::string& spacing : spacings)
      if (number_in<double>(spacing) == 0.0)
        throw no_place_in_space(file, fmt::format("the voxel spacing is {} mm", fmt::join(spacings, " x ")));
  }
}

void check_metaimage_header(const TextHeader& header, const fs::path& file,
                            std::vector<std::string>& warnings) {
  const auto refuse = [&](std::string why) { return unreadable(file, "MetaImage", std::move(why)); };
  const auto axes = number_in<int>(header.at("NDims"));
  if (!axes || *axes < 1 || *axes > 10)
    throw refuse(header.has("NDims") ? fmt::format("it is said to have {} axes", header.at("NDims"))
                                     : "it does not state its number of axes (no NDims)");
  if (!header.complete) throw refuse("it does not name the file of its voxels (no ElementDataFile)");
  check_keys(header, file);
  const auto n = static_cast<std::size_t>(*axes);
  const auto check = [&](const std::string& key, std::size_t count) {
    if (key.empty()) return;
    const auto words = words_in(header.at(key));
    if (words.size() != count || !are_finite(words))
      throw refuse(fmt::format("{} is '{}' instead of {} finite numbers", key, header.at(key), count));
  };
  const std::string matrix = either(header, {"TransformMatrix", "Rotation", "Orientation"});
  const std::string origin = either(header, {"Offset", "Position", "Origin"});
  if (!header.has("DimSize")) throw refuse("it does not state its size (no DimSize)");
  if (!header.has("ElementSpacing")) throw refuse("it does not state the voxel size (no ElementSpacing)");
  check("DimSize", n);
  check("ElementSpacing", n);
  check(origin, n);
  check(matrix, n * n);
  if (const auto cosines = words_in(header.at(matrix)); !matrix.empty())
    for (std::size_t a = 0; a < n; ++a) {
      const auto axis = std::span(cosines).subspan(a * n, n);
      if (std::none_of(axis.begin(), axis.end(), [](const std::string& cosine) {
            return std::abs(number_in<double>(cosine).value_or(1.0)) > 1e-100;
          }))
        throw no_place_in_space(file, fmt::format("axis {} has the direction ({}), which has no length",
                                                  a + 1, fmt::join(axis, ", ")));
    }
  const auto spacing = words_in(header.at("ElementSpacing"));
  if (std::any_of(spacing.begin(), spacing.end(), [](const auto& word) {
        return !(number_in<double>(word) > 1e-100);
      }))  // ITK treats the rest as zero
    throw refuse(fmt::format("the voxel spacing is {} mm", fmt::join(spacing, " x ")));
  if (header.at("ElementType").ends_with("_ARRAY"))
    throw refuse(fmt::format("its voxels are of type {}", header.at("ElementType")));
  if (const std::string key = either(header, {"BinaryData"}); !key.empty() && !is_true(header.at(key)))
    throw refuse("its voxels are written as text (ASCII), which is not read; save it with BinaryData = True");

  if (matrix.empty())
    warnings.push_back(
        "The file does not state the image's orientation in the patient (no TransformMatrix); its axes are "
        "assumed to be left, posterior and superior.");
  if (origin.empty())
    warnings.push_back(
        "The file does not state the place of its first voxel (no Offset); 0, 0, 0 is assumed.");
}

}  // namespace dimple
