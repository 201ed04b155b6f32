#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "io/label_image.hpp"

namespace dimple {

/// An image as another program might store it: canonical axis stored[c] is along axis c, perhaps reversed.
struct StoredImage {
  std::array<Index, 3> size;
  Eigen::Affine3d to_world;
  std::vector<std::uint8_t> voxel;
};

inline StoredImage stored_as(const LabelImage& image, const std::array<int, 3>& axis,
                             const std::array<bool, 3>& reversed) {
  StoredImage raw{{}, Eigen::Affine3d::Identity(), {}};
  Vec3 origin = image.to_world.translation();
  for (std::size_t c = 0; c < 3; ++c) {
    const auto a = static_cast<std::size_t>(axis[c]);
    raw.size[c] = image.size[a];
    Vec3 column = image.to_world.linear().col(axis[c]);
    if (reversed[c]) {
      origin += column * static_cast<double>(image.size[a] - 1);
      column = -column;
    }
    raw.to_world.linear().col(static_cast<Index>(c)) = column;
  }
  raw.to_world.translation() = origin;
  std::array<Index, 3> at{};
  for (at[2] = 0; at[2] < raw.size[2]; ++at[2])
    for (at[1] = 0; at[1] < raw.size[1]; ++at[1])
      for (at[0] = 0; at[0] < raw.size[0]; ++at[0]) {
        std::array<Index, 3> from{};
        for (std::size_t c = 0; c < 3; ++c)
          from[static_cast<std::size_t>(axis[c])] = reversed[c] ? raw.size[c] - 1 - at[c] : at[c];
        raw.voxel.push_back(static_cast<std::uint8_t>(image.at(from[0], from[1], from[2])));
      }
  return raw;
}

inline StoredImage as_it_is(const LabelImage& image) {
  return stored_as(image, {0, 1, 2}, {false, false, false});
}

inline std::string bytes_of(const std::vector<std::uint8_t>& voxel) {
  return {voxel.begin(), voxel.end()};
}

inline std::string comma_separated(const auto& values) {
  std::ostringstream text;
  text.precision(17);
  for (Index n = 0; n < values.size(); ++n) text << (n ? "," : "") << values[n];
  return text.str();
}

/// NRRD file written by hand, so that the reader is not tested against a writer with the same mistakes.
inline std::string nrrd_of(const StoredImage& raw, bool ras = false, const std::string& more = "") {
  Eigen::Affine3d world = raw.to_world;
  if (ras) world = Eigen::Scaling(-1.0, -1.0, 1.0) * world;
  std::ostringstream text;
  text << "NRRD0004\ntype: uint8\ndimension: 3\nspace: "
       << (ras ? "right-anterior-superior" : "left-posterior-superior") << "\nsizes: " << raw.size[0] << ' '
       << raw.size[1] << ' ' << raw.size[2] << "\nspace directions:";
  for (int c = 0; c < 3; ++c) text << " (" << comma_separated(Vec3(world.linear().col(c))) << ")";
  text << "\nspace origin: (" << comma_separated(Vec3(world.translation())) << ")\nencoding: raw\n"
       << more << '\n';
  return text.str() + bytes_of(raw.voxel);
}

inline std::string metaimage_of(const StoredImage& raw) {
  std::ostringstream text;
  text.precision(17);
  text << "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
          "CompressedData = False\nTransformMatrix =";
  const Vec3 spacing = raw.to_world.linear().colwise().norm();
  for (int c = 0; c < 3; ++c)
    for (int r = 0; r < 3; ++r) text << ' ' << raw.to_world.linear()(r, c) / spacing[c];
  text << "\nOffset =";
  for (int r = 0; r < 3; ++r) text << ' ' << raw.to_world.translation()[r];
  text << "\nElementSpacing = " << spacing[0] << ' ' << spacing[1] << ' ' << spacing[2]
       << "\nDimSize = " << raw.size[0] << ' ' << raw.size[1] << ' ' << raw.size[2]
       << "\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
  return text.str() + bytes_of(raw.voxel);
}

/// A NIfTI-1 header by the byte offsets of the standard (nifti1.h).
struct NiftiFile {
  std::string bytes = std::string(352, '\0');
  std::string voxels;
  template <class T>
  void set(std::size_t offset, T value) {
    std::memcpy(bytes.data() + offset, &value, sizeof value);
  }
  void dims(std::initializer_list<Index> sizes) {
    set<std::int16_t>(40, static_cast<std::int16_t>(sizes.size()));
    std::size_t offset = 42;
    for (const Index size : sizes)
      set<std::int16_t>(std::exchange(offset, offset + 2), static_cast<std::int16_t>(size));
  }
  void type(std::int16_t code, std::int16_t bits) { set(70, code), set(72, bits); }
  void pixdim(int axis, float value) { set(76 + 4 * static_cast<std::size_t>(axis), value); }
  void units(char code) { set(123, code); }
  void sform(std::int16_t code, const Eigen::Affine3d& lps) {
    set(254, code);
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 4; ++c)
        set(static_cast<std::size_t>(280 + 16 * r + 4 * c),
            static_cast<float>((r < 2 ? -1.0 : 1.0) * lps.matrix()(r, c)));
  }
  explicit NiftiFile(const StoredImage& raw) : voxels(bytes_of(raw.voxel)) {
    set<std::int32_t>(0, 348);
    dims({raw.size[0], raw.size[1], raw.size[2]});
    type(2, 8);
    pixdim(0, 1.0f);
    for (int c = 0; c < 3; ++c) pixdim(c + 1, static_cast<float>(raw.to_world.linear().col(c).norm()));
    set(108, 352.0f);
    units(2);
    sform(1, raw.to_world);
    std::memcpy(bytes.data() + 344, "n+1", 4);
  }
  std::string file() const { return bytes + voxels; }
};

}  // namespace dimple
