#pragma once

// Common parts of the image formats, for label_image.cpp, volume_image.cpp and the readers only.

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "io/error.hpp"
#include "io/types.hpp"

namespace dimple {

/// The type of an image's numbers. Tables of what the formats call them have this order.
enum class Number { int8, uint8, int16, uint16, int32, uint32, int64, uint64, real32, real64 };

inline std::size_t bytes_of(Number type) {
  constexpr std::array<std::size_t, 10> bytes = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
  return bytes[static_cast<std::size_t>(type)];
}

/// An image as its file holds it: axes in stored order, voxels in their stored type, unchecked.
struct StoredImage {
  std::array<Index, 3> size{};
  Number type = Number::uint8;
  std::vector<std::byte> data;                ///< native byte order, first axis fastest
  std::span<const std::byte> elsewhere = {};  ///< instead of `data`: in another's memory
  std::array<Index, 3> step{};                ///< there: numbers from a voxel to the next along each axis
  double slope = 1.0, intercept = 0.0;        ///< label = slope * number + intercept
  Eigen::Affine3d to_world = Eigen::Affine3d::Identity();  ///< stored voxel (i, j, k) -> LPS [mm]
  std::map<int, std::string> names;
  std::map<std::string, std::string> segment_keys;  ///< of a 3D Slicer segmentation, unchanged
  std::string format;
  std::vector<std::string> warnings;

  std::size_t count() const { return static_cast<std::size_t>(size[0] * size[1] * size[2]); }
  std::size_t data_bytes() const { return count() * bytes_of(type); }
};

/// Name of a file for stages and errors: "label image brain.nrrd".
inline std::string image_place(const std::filesystem::path& file) {
  return "label image " + file.string();
}

/// Throws InputError unless the sizes describe one three-dimensional image of one number per voxel that fits
/// in memory; further axes must have length 1. `components` counts the numbers per voxel, `layers` names the
/// segments they hold, if available.
std::array<Index, 3> checked_size(const std::vector<Index>& size, Index components,
                                  const std::filesystem::path& file, const std::string& layers = {});

/// Millimetres per unit, or nothing if the unit is unknown.
std::optional<double> millimetres_in(const std::string& unit);

/// Multiplies spacing and origin alike, with a warning.
void scale_to_millimetres(StoredImage& image, double factor, const std::string& unit);

/// Throws InputError if the file is too short for its voxels even with the best compression by deflate. Also
/// throws if this machine (or `ulimit -v`) has too little memory: a header cannot request it without limit.
void check_length(const StoredImage& image, const std::filesystem::path& file);

/// Bytes after the voxels that are still unpacked, for the check sums.
constexpr std::size_t surplus_limit = std::size_t{1} << 26;

/// Warns if the file continues after its voxels: its header may belong to another file.
void warn_of_surplus(StoredImage& image, std::uintmax_t bytes);

/// True if the axes are perpendicular within ITK's limit.
bool is_at_right_angles(const Mat3& axes);

/// Reverses the bytes of each number.
void swap_bytes(StoredImage& image);

/// Longest text of a file that a message repeats.
inline constexpr std::size_t most_repeated = 500;

InputError no_place_in_space(const std::filesystem::path& file, std::string_view fact);
InputError truncated(const std::filesystem::path& file, std::string_view fact);

StoredImage read_nifti(const std::filesystem::path& file);
StoredImage read_nrrd(const std::filesystem::path& file);
StoredImage read_metaimage(const std::filesystem::path& file);

/// Calls `visit` with a zero of the type in which the image is stored.
void with_type(Number type, const auto& visit) {
  switch (type) {
    case Number::int8:
      return visit(std::int8_t{});
    case Number::uint8:
      return visit(std::uint8_t{});
    case Number::int16:
      return visit(std::int16_t{});
    case Number::uint16:
      return visit(std::uint16_t{});
    case Number::int32:
      return visit(std::int32_t{});
    case Number::uint32:
      return visit(std::uint32_t{});
    case Number::int64:
      return visit(std::int64_t{});
    case Number::uint64:
      return visit(std::uint64_t{});
    case Number::real32:
      return visit(float{});
    case Number::real64:
      return visit(double{});
  }
}

/// The voxels in memory; bytes are no objects of another type, but may become some.
template <class T>
std::span<const T> numbers(const StoredImage& image) {
  const std::byte* first = image.elsewhere.empty() ? image.data.data() : image.elsewhere.data();
  return {reinterpret_cast<const T*>(first), image.count()};
}

/// NIfTI-1: the header of such an image, with `components` numbers per voxel, and the four bytes after it.
/// Throws std::runtime_error: more voxels along an axis than it has room for.
std::vector<std::byte> nifti_header(const StoredImage& image, int components);

/// Writers to a temporary name; they throw std::runtime_error with the library's or the system's words.
void write_nifti(const std::filesystem::path& file, const StoredImage& image);
void write_nrrd(const std::filesystem::path& file, const StoredImage& image,
                const std::map<std::string, std::string>& keys);
void write_metaimage(const std::filesystem::path& file, const StoredImage& image);

}  // namespace dimple
