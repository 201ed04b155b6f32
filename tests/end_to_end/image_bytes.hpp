#pragma once

// Label images byte by byte, so that a test can damage any field; the product's writers are not used.

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace dimple {

/// A box of label 1 inside the image, with one voxel each of labels 2 to 5. These four are not in one plane,
/// so their positions determine the whole placement.
struct SmallOrgan {
  std::array<int, 3> size{9, 8, 7};
  std::vector<double> voxel;  ///< i fastest
  Eigen::Affine3d to_world;   ///< voxel (i, j, k) -> LPS [mm]
  SmallOrgan();
  double& at(int i, int j, int k) { return voxel[static_cast<std::size_t>(i + size[0] * (j + size[1] * k))]; }
};

inline const std::map<int, int> organ_counts = {{1, 206}, {2, 1}, {3, 1}, {4, 1}, {5, 1}};
inline const std::map<int, std::array<int, 3>> organ_places = {
    {2, {1, 1, 1}}, {3, {7, 2, 1}}, {4, {2, 6, 2}}, {5, {3, 3, 5}}};

/// The numbers as type T, in the machine's byte order (little-endian) or the other.
template <class T>
std::string as_bytes(const std::vector<double>& numbers, bool big_endian = false) {
  std::string bytes;
  for (const double number : numbers) {
    const T value = static_cast<T>(number);
    char raw[sizeof(T)];
    std::memcpy(raw, &value, sizeof(T));
    for (std::size_t b = 0; b < sizeof(T); ++b) bytes += raw[big_endian ? sizeof(T) - 1 - b : b];
  }
  return bytes;
}

std::string gzip(const std::string& plain);
std::string zlib(const std::string& plain);

/// Text header of NRRD or MetaImage: lines "key<separator>value" in order, then the voxels.
class TextImage {
 public:
  TextImage& set(const std::string& key, const std::string& value);  ///< in its place, or at the end
  TextImage& erase(const std::string& key);
  TextImage& data(std::string bytes);
  TextImage& geometry(const Eigen::Affine3d& to_world);
  TextImage& more(std::string lines);  ///< further lines, unchanged
  std::string header() const;
  std::string file() const { return header() + data_; }

 protected:
  std::string first_line_, separator_, last_line_, more_, data_;
  std::vector<std::pair<std::string, std::string>> fields_;
  bool is_nrrd_ = false;
};

struct Nrrd : TextImage {
  explicit Nrrd(const SmallOrgan& organ = {});
};

struct MetaImage : TextImage {
  explicit MetaImage(const SmallOrgan& organ = {});
};

/// NIfTI-1 by the byte offsets of the standard, with an sform and a qform that agree.
class Nifti {
 public:
  explicit Nifti(const SmallOrgan& organ = {});
  template <class T>
  Nifti& set(std::size_t offset, T value) {
    std::memcpy(header_.data() + offset, &value, sizeof value);
    return *this;
  }
  Nifti& dims(const std::vector<int>& sizes);
  Nifti& type(int code, int bits);
  Nifti& pixdim(int axis, double value) { return set(76 + 4 * static_cast<std::size_t>(axis), float(value)); }
  Nifti& sform(int code, const Eigen::Affine3d& lps);
  Nifti& qform(int code) { return set(252, static_cast<std::int16_t>(code)); }
  Nifti& data(std::string bytes);
  Nifti& swap_header();  ///< to the other byte order
  std::string header() const { return header_.substr(0, 348); }
  std::string file() const { return header_ + data_; }

 private:
  std::string header_ = std::string(352, '\0'), data_;
};

}  // namespace dimple
