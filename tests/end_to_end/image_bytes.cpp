#include "tests/end_to_end/image_bytes.hpp"

#include <zlib.h>

#include <algorithm>
#include <sstream>
#include <stdexcept>

namespace dimple {
namespace {

std::string deflated(const std::string& plain, int window_bits) {
  z_stream stream{};
  deflateInit2(&stream, 9, Z_DEFLATED, window_bits, 9, Z_DEFAULT_STRATEGY);
  std::string packed(deflateBound(&stream, plain.size()) + 32, '\0');
  stream.next_in = reinterpret_cast<unsigned char*>(const_cast<char*>(plain.data()));
  stream.avail_in = static_cast<unsigned>(plain.size());
  stream.next_out = reinterpret_cast<unsigned char*>(packed.data());
  stream.avail_out = static_cast<unsigned>(packed.size());
  const int state = deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  if (state != Z_STREAM_END) throw std::runtime_error("deflate failed");
  return packed;
}

std::string joined(const auto& numbers, const char* between) {
  std::ostringstream text;
  text.precision(17);
  for (Eigen::Index n = 0; n < numbers.size(); ++n) text << (n ? between : "") << numbers[n];
  return text.str();
}

}  // namespace

SmallOrgan::SmallOrgan() : voxel(9 * 8 * 7, 0.0) {
  to_world = Eigen::Translation3d(-20.25, 33.5, 7.0) * Eigen::Scaling(1.5, 2.0, 2.5);
  for (int k = 1; k <= 5; ++k)
    for (int j = 1; j <= 6; ++j)
      for (int i = 1; i <= 7; ++i) at(i, j, k) = 1.0;
  for (const auto& [label, place] : organ_places) at(place[0], place[1], place[2]) = label;
}

std::string gzip(const std::string& plain) {
  return deflated(plain, 15 + 16);
}

std::string zlib(const std::string& plain) {
  return deflated(plain, 15);
}

TextImage& TextImage::set(const std::string& key, const std::string& value) {
  const auto field =
      std::find_if(fields_.begin(), fields_.end(), [&](const auto& f) { return f.first == key; });
  if (field == fields_.end())
    fields_.emplace_back(key, value);
  else
    field->second = value;
  return *this;
}

TextImage& TextImage::erase(const std::string& key) {
  std::erase_if(fields_, [&](const auto& field) { return field.first == key; });
  return *this;
}

TextImage& TextImage::data(std::string bytes) {
  data_ = std::move(bytes);
  return *this;
}

TextImage& TextImage::more(std::string lines) {
  more_ = std::move(lines);
  return *this;
}

TextImage& TextImage::geometry(const Eigen::Affine3d& to_world) {
  const Eigen::Matrix3d m = to_world.linear();
  const Eigen::Vector3d origin = to_world.translation();
  if (is_nrrd_) {
    std::string directions;
    for (int a = 0; a < 3; ++a) directions += (a ? " (" : "(") + joined(Eigen::Vector3d(m.col(a)), ",") + ")";
    set("space directions", directions)
        .set("space origin", std::string("(").append(joined(origin, ",")) + ")");
  } else {
    const Eigen::Vector3d spacing = m.colwise().norm();
    const Eigen::Matrix3d unit = m.colwise().normalized();
    set("TransformMatrix", joined(Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(unit.data(), 9)), " "))
        .set("Offset", joined(origin, " "))
        .set("ElementSpacing", joined(spacing, " "));
  }
  return *this;
}

std::string TextImage::header() const {
  std::string text = first_line_;
  for (const auto& [key, value] : fields_) text += key + separator_ + value + "\n";
  return text + more_ + last_line_;
}

Nrrd::Nrrd(const SmallOrgan& organ) {
  first_line_ = std::string("NRRD0004\n");
  separator_ = std::string(": ");
  last_line_ = std::string(1, '\n');
  is_nrrd_ = true;
  set("type", "uint8").set("dimension", "3").set("space", "left-posterior-superior");
  set("sizes", joined(Eigen::Map<const Eigen::Vector3i>(organ.size.data()), " "));
  geometry(organ.to_world);
  set("encoding", "raw");
  data(as_bytes<std::uint8_t>(organ.voxel));
}

MetaImage::MetaImage(const SmallOrgan& organ) {
  separator_ = " = ";
  set("ObjectType", "Image").set("NDims", "3").set("BinaryData", "True");
  set("BinaryDataByteOrderMSB", "False").set("CompressedData", "False");
  geometry(organ.to_world);
  set("DimSize", joined(Eigen::Map<const Eigen::Vector3i>(organ.size.data()), " "));
  set("ElementType", "MET_UCHAR").set("ElementDataFile", "LOCAL");
  data(as_bytes<std::uint8_t>(organ.voxel));
}

Nifti::Nifti(const SmallOrgan& organ) {
  set(0, std::int32_t{348});
  dims({organ.size[0], organ.size[1], organ.size[2]});
  type(2, 8);
  pixdim(0, 1.0);
  for (int a = 0; a < 3; ++a) pixdim(a + 1, organ.to_world.linear().col(a).norm());
  set(108, 352.0f);
  set(123, char{2});  // mm
  sform(1, organ.to_world);
  qform(1);
  set(264, 1.0f);  // quaternion (0, 0, 0, 1): stored axes along L, P, S
  for (int r = 0; r < 3; ++r)
    set(static_cast<std::size_t>(268 + 4 * r),
        static_cast<float>((r < 2 ? -1.0 : 1.0) * organ.to_world.translation()[r]));
  std::memcpy(header_.data() + 344, "n+1", 4);
  data(as_bytes<std::uint8_t>(organ.voxel));
}

Nifti& Nifti::dims(const std::vector<int>& sizes) {
  set(40, static_cast<std::int16_t>(sizes.size()));
  for (std::size_t a = 0; a < sizes.size(); ++a) set(42 + 2 * a, static_cast<std::int16_t>(sizes[a]));
  return *this;
}

Nifti& Nifti::type(int code, int bits) {
  return set(70, static_cast<std::int16_t>(code)).set(72, static_cast<std::int16_t>(bits));
}

Nifti& Nifti::sform(int code, const Eigen::Affine3d& lps) {
  set(254, static_cast<std::int16_t>(code));
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 4; ++c)
      set(static_cast<std::size_t>(280 + 16 * r + 4 * c),
          static_cast<float>((r < 2 ? -1.0 : 1.0) * lps.matrix()(r, c)));
  return *this;
}

Nifti& Nifti::data(std::string bytes) {
  data_ = std::move(bytes);
  return *this;
}

Nifti& Nifti::swap_header() {
  const auto swap = [&](std::size_t offset, std::size_t width, std::size_t count) {
    for (std::size_t n = 0; n < count; ++n)
      std::reverse(header_.begin() + static_cast<std::ptrdiff_t>(offset + n * width),
                   header_.begin() + static_cast<std::ptrdiff_t>(offset + (n + 1) * width));
  };
  swap(0, 4, 1), swap(40, 2, 8), swap(70, 2, 2), swap(76, 4, 11), swap(252, 2, 2), swap(256, 4, 18);
  return *this;
}

}  // namespace dimple
