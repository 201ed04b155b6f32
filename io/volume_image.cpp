#include "io/volume_image.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/parallel_for.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <type_traits>
#include <utility>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/label_formats.hpp"
#include "io/stop.hpp"
#include "io/text.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

}  // namespace

std::string volume_suffix(const fs::path& file) {
  const std::string name = lower(file.filename().string());
  const auto ends = [&](auto... suffix) { return (name.ends_with(suffix) || ...); };
  if (ends(".nrrd", ".nhdr")) return ".nrrd";
  if (ends(".nii", ".hdr", ".img")) return ".nii";
  if (ends(".nii.gz", ".hdr.gz", ".img.gz")) return ".nii.gz";
  if (ends(".mha", ".mhd")) return ".mha";
  throw InputError({.fact = fmt::format("'{}' does not end in a known suffix", file.filename().string()),
                    .where = "image " + file.string(),
                    .why = "known are .nrrd, .nhdr, .nii, .nii.gz, .hdr, .img, .mha and .mhd",
                    .remedy = "save the image in one of these formats, for instance as .nii.gz",
                    .code = "bad-image"});
}

// ---------------------------------------------------------------------------------------------------------
// Reading
// ---------------------------------------------------------------------------------------------------------

VolumeImage::VolumeImage(const fs::path& file) {
  const std::string suffix = volume_suffix(file);
  try {
    require_regular_file(file);
    stored_ = std::make_unique<StoredImage>(suffix == ".nrrd"  ? read_nrrd(file)
                                            : suffix == ".mha" ? read_metaimage(file)
                                                               : read_nifti(file));
  } catch (const InputError& error) {
    // The readers' messages are about label images and how to get a better one.
    Report report = error.report;
    report.where = "image " + file.string();
    report.remedy =
        "give a three-dimensional image with one number per voxel, saved again as .nii.gz, .nrrd or .mha";
    report.code = "bad-image";
    throw InputError(std::move(report));
  }
  const Mat3 axes = stored_->to_world.linear();
  const Vec3 spacing = axes.colwise().norm();
  if (!stored_->to_world.matrix().allFinite() || !(spacing.minCoeff() > 1e-6) ||
      !(spacing.maxCoeff() < 1e6) || !(std::abs(Mat3(axes.colwise().normalized()).determinant()) > 1e-3))
    throw InputError({.fact = fmt::format("the voxels of {:.6g} x {:.6g} x {:.6g} mm have no place in space",
                                          spacing[0], spacing[1], spacing[2]),
                      .where = "image " + file.string(),
                      .why = "spacing, direction and origin in its header do not span space",
                      .remedy = "correct the header, or save the image again",
                      .code = "bad-image"});
  grid_ = {stored_->size, stored_->to_world};
}
VolumeImage::~VolumeImage() = default;
VolumeImage::VolumeImage(VolumeImage&&) noexcept = default;
VolumeImage& VolumeImage::operator=(VolumeImage&&) noexcept = default;

std::size_t VolumeImage::bytes_per_voxel() const {
  return bytes_of(stored_->type);
}

const std::byte* VolumeImage::voxel(Index v) const {
  return stored_->data.data() + static_cast<std::size_t>(v) * bytes_per_voxel();
}

void VolumeImage::set_to_zero(Index v) {
  std::fill_n(stored_->data.data() + static_cast<std::size_t>(v) * bytes_per_voxel(), bytes_per_voxel(),
              std::byte{0});
}

std::int64_t VolumeImage::label_of(const std::byte* bytes) const {
  return std::llround(value_of(bytes));
}

double VolumeImage::value_of(const std::byte* bytes) const {
  double number = 0.0;
  with_type(stored_->type, [&]<class T>(T value) {
    std::memcpy(&value, bytes, sizeof value);
    number = static_cast<double>(value);
  });
  return stored_->slope * number + stored_->intercept;
}

void VolumeImage::sample(std::span<const float> place, Sampling how, std::byte* result) const {
  const auto& n = stored_->size;
  const std::size_t count = place.size() / 3;
  with_type(stored_->type, [&]<class T>(T) {
    const T* const voxel = numbers<T>(*stored_).data();
    T* const out = reinterpret_cast<T*>(result);
    for (std::size_t m = 0; m < count; ++m) {
      const float* x = place.data() + 3 * m;
      std::array<Index, 3> low;
      std::array<double, 3> part;
      bool inside = true;
      for (std::size_t a = 0; a < 3; ++a) {
        const double last = static_cast<double>(n[a] - 1), at = static_cast<double>(x[a]);
        if (how == Sampling::nearest) {
          low[a] = static_cast<Index>(std::floor(at + 0.5));
          inside = inside && low[a] >= 0 && low[a] < n[a];
          continue;
        }
        const double within = std::clamp(at, 0.0, last);
        low[a] = std::min(static_cast<Index>(within), n[a] - 2);
        part[a] = within - static_cast<double>(low[a]);
      }
      const T* const corner = voxel + low[0] + n[0] * (low[1] + n[1] * low[2]);
      if (how == Sampling::nearest) {
        out[m] = inside ? *corner : T{};
        continue;
      }
      // At a voxel itself its number is copied, since a double cannot hold all of them.
      if (part[0] == 0.0 && part[1] == 0.0 && part[2] == 0.0) {
        out[m] = *corner;
        continue;
      }
      double sum = 0.0;
      for (int c = 0; c < 8; ++c) {
        const double w = (c & 1 ? part[0] : 1.0 - part[0]) * (c & 2 ? part[1] : 1.0 - part[1]) *
                         (c & 4 ? part[2] : 1.0 - part[2]);
        if (w != 0.0)
          sum += w * static_cast<double>(corner[(c & 1) + n[0] * (((c >> 1) & 1) + n[1] * ((c >> 2) & 1))]);
      }
      if constexpr (std::is_integral_v<T>) {
        // Rounds to the type; only the largest of 64 bits can exceed it.
        const double nearest = std::round(sum);
        out[m] = nearest >= static_cast<double>(std::numeric_limits<T>::max()) ? std::numeric_limits<T>::max()
                                                                               : static_cast<T>(nearest);
      } else {
        out[m] = static_cast<T>(sum);
      }
    }
  });
}

// ---------------------------------------------------------------------------------------------------------
// Writing
// ---------------------------------------------------------------------------------------------------------

namespace {

constexpr std::size_t chunk_bytes = std::size_t{1}
                                    << 19;  // packed by one thread, independently of the others
constexpr int chunks_at_once = 16;
constexpr int level = 4;  // of deflate: half the time of 6, and files a few percent larger

/// A part of a deflate stream that ends on a byte, and the data for its check sums.
struct Packed {
  std::string bytes = {};
  std::size_t plain = 0;
  uLong crc = 0, adler = 0;
};

Packed pack(std::span<const std::byte> plain) {
  Packed result{.plain = plain.size()};
  const auto* in = reinterpret_cast<const Bytef*>(plain.data());
  const auto length = static_cast<uInt>(plain.size());
  result.crc = crc32(crc32(0, nullptr, 0), in, length);
  result.adler = adler32(adler32(0, nullptr, 0), in, length);
  z_stream stream{};
  if (deflateInit2(&stream, level, Z_DEFLATED, -15, 9, Z_DEFAULT_STRATEGY) != Z_OK) throw std::bad_alloc();
  const std::unique_ptr<z_stream, int (*)(z_stream*)> closed_at_the_end(&stream, &deflateEnd);
  result.bytes.resize(deflateBound(&stream, length) + 64);
  stream.next_in = const_cast<Bytef*>(in);
  stream.avail_in = length;
  stream.next_out = reinterpret_cast<Bytef*>(result.bytes.data());
  stream.avail_out = static_cast<uInt>(result.bytes.size());
  deflate(&stream, Z_SYNC_FLUSH);
  result.bytes.resize(result.bytes.size() - stream.avail_out);
  result.bytes.shrink_to_fit();
  return result;
}

void put(std::string& bytes, std::uint32_t number, bool most_significant_first) {
  for (int b = 0; b < 4; ++b)
    bytes.push_back(static_cast<char>(number >> 8 * (most_significant_first ? 3 - b : b) & 0xff));
}

constexpr const char* last_block = "\x03\x00";  // an empty one, which ends a deflate stream

std::string numbers_of(const Vec3& v, const char* between) {
  return fmt::format("{}", fmt::join(v.begin(), v.end(), between));
}

// In the order of Number.
constexpr std::array<const char*, 10> nrrd_types = {"int8",   "uint8", "int16",  "uint16", "int32",
                                                    "uint32", "int64", "uint64", "float",  "double"};
constexpr std::array<const char*, 10> metaimage_types = {
    "MET_CHAR", "MET_UCHAR",     "MET_SHORT",      "MET_USHORT", "MET_INT",
    "MET_UINT", "MET_LONG_LONG", "MET_ULONG_LONG", "MET_FLOAT",  "MET_DOUBLE"};

std::string nrrd_header(const StoredImage& image, const VolumeKind& kind) {
  const Mat3 axes = image.to_world.linear();
  const bool vectors = kind.components > 1;
  std::string directions;
  for (Index a = 0; a < 3; ++a) directions += fmt::format(" ({})", numbers_of(axes.col(a), ","));
  std::string text = fmt::format(
      "NRRD0004\n# Complete NRRD file format specification at:\n# "
      "http://teem.sourceforge.net/nrrd/format.html\n"
      "type: {}\ndimension: {}\nspace: left-posterior-superior\nsizes: {}{}\nspace directions:{}{}\nkinds: "
      "{}domain "
      "domain domain\nendian: {}\nencoding: gzip\nspace origin: ({})\n",
      nrrd_types[static_cast<std::size_t>(image.type)], vectors ? 4 : 3,
      vectors ? fmt::format("{} ", kind.components) : "", fmt::join(image.size, " "), vectors ? " none" : "",
      directions, vectors ? "vector " : "", std::endian::native == std::endian::little ? "little" : "big",
      numbers_of(Vec3(image.to_world.translation()), ","));
  if (!kind.meaning.empty()) text += fmt::format("displacement field type:={}\n", kind.meaning);
  for (const auto& [key, value] : image.segment_keys) {
    // The box around each segment has changed: the whole image is never too small.
    const bool is_box = key.starts_with("Segment") && key.ends_with("_Extent");
    text += fmt::format(
        "{}:={}\n", key,
        is_box ? fmt::format("0 {} 0 {} 0 {}", image.size[0] - 1, image.size[1] - 1, image.size[2] - 1)
               : value);
  }
  return text + "\n";
}

constexpr std::size_t room_for_length = 16;  // in the header, until it is known

std::string metaimage_header(const StoredImage& image, const VolumeKind& kind) {
  const Mat3 axes = image.to_world.linear();
  std::string matrix;
  for (Index a = 0; a < 3; ++a) matrix += " " + numbers_of(Vec3(axes.col(a).normalized()), " ");
  return fmt::format(
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = {}\nCompressedData = True\n"
      "CompressedDataSize = {:>{}}\nTransformMatrix ={}\nOffset = {}\nCenterOfRotation = 0 0 "
      "0\nElementSpacing = {}\n"
      "DimSize = {}\n{}ElementType = {}\nElementDataFile = LOCAL\n",
      std::endian::native == std::endian::little ? "False" : "True", "", room_for_length, matrix,
      numbers_of(Vec3(image.to_world.translation()), " "), numbers_of(Vec3(axes.colwise().norm()), " "),
      fmt::join(image.size, " "),
      kind.components > 1 ? fmt::format("ElementNumberOfChannels = {}\n", kind.components) : "",
      metaimage_types[static_cast<std::size_t>(image.type)]);
}

}  // namespace

struct VolumeWriter::State {
  fs::path file, temporary;
  StoredImage image;  // without its voxels
  VolumeKind kind;
  std::string suffix;
  std::ofstream out;
  std::string header;
  std::size_t written = 0, all = 0;  // bytes of voxels
  // Streams in sequence: NIfTI has all first components before all second ones, the others have one stream.
  struct Stream {
    std::vector<std::byte> waiting;
    std::vector<Packed> packed;
  };
  std::vector<Stream> stream;
  bool finished = false;

  [[noreturn]] void failed(const std::string& what) {
    throw OutputError({.fact = fmt::format("cannot write '{}': {}", file.string(), what),
                       .where = "images",
                       .why = "the image was written under a temporary name and removed",
                       .remedy = "check the room on that disk, or choose another folder with -o"});
  }
  void put_out(const char* bytes, std::size_t count) {
    if (!out.write(bytes, static_cast<std::streamsize>(count))) failed("the disk is full or gone");
  }
  bool is_packed() const { return suffix != ".nii"; }
  bool in_order() const { return stream.size() == 1; }

  void pack_waiting(Stream& s, bool all_of_it) {
    const std::size_t whole =
        s.waiting.size() / chunk_bytes + (all_of_it && s.waiting.size() % chunk_bytes > 0);
    if (whole == 0) return;
    const std::size_t first = s.packed.size();
    s.packed.resize(first + whole);
    tbb::parallel_for(std::size_t{0}, whole, [&](std::size_t c) {
      stop_if_requested();
      const std::size_t begin = c * chunk_bytes;
      s.packed[first + c] =
          pack(std::span(s.waiting).subspan(begin, std::min(chunk_bytes, s.waiting.size() - begin)));
    });
    s.waiting.erase(s.waiting.begin(), s.waiting.begin() + static_cast<std::ptrdiff_t>(std::min(
                                                               whole * chunk_bytes, s.waiting.size())));
    if (!in_order()) return;
    for (std::size_t c = first; c < s.packed.size(); ++c) {
      put_out(s.packed[c].bytes.data(), s.packed[c].bytes.size());
      s.packed[c].bytes = {};
    }
  }
};

VolumeWriter::VolumeWriter(fs::path file, const VoxelGrid& grid, const VolumeKind& kind)
    : state_(std::make_unique<State>()) {
  State& s = *state_;
  s.file = std::move(file);
  s.kind = kind;
  s.suffix = volume_suffix(s.file);
  s.image.size = grid.size;
  s.image.to_world = grid.to_world;
  s.image.type = Number::real32;
  if (kind.like) {
    const StoredImage& like = kind.like->stored();
    s.image.type = like.type;
    s.image.slope = like.slope;
    s.image.intercept = like.intercept;
    s.image.segment_keys = like.segment_keys;
  }
  s.all = static_cast<std::size_t>(grid.voxels()) * static_cast<std::size_t>(kind.components) *
          bytes_of(s.image.type);
  const bool nifti = s.suffix.starts_with(".nii");
  s.stream.resize(nifti ? static_cast<std::size_t>(kind.components) : 1);
  if (nifti) {
    try {
      const std::vector<std::byte> header = nifti_header(s.image, kind.components);
      s.header.assign(reinterpret_cast<const char*>(header.data()), header.size());
    } catch (const std::runtime_error& error) {
      s.failed(error.what());
    }
  } else {
    s.header = s.suffix == ".nrrd" ? nrrd_header(s.image, kind) : metaimage_header(s.image, kind);
  }
  s.temporary = temporary_next_to(s.file);
  claim_temporary(s.temporary, s.file);
  s.out.open(s.temporary, std::ios::binary);
  if (!s.out) s.failed("the system refused");
  // The header is text before the packed data, but for NIfTI a part of it.
  if (s.suffix == ".nii.gz") s.stream[0].packed.push_back(pack(std::as_bytes(std::span(s.header))));
  if (s.suffix != ".nii.gz") s.put_out(s.header.data(), s.header.size());
  if (s.suffix == ".mha")
    s.put_out("\x78\x5e", 2);
  else if (s.is_packed())
    s.put_out("\x1f\x8b\x08\x00\x00\x00\x00\x00\x00\x03", 10);
  if (s.suffix == ".nii.gz" && s.in_order()) {
    s.put_out(s.stream[0].packed[0].bytes.data(), s.stream[0].packed[0].bytes.size());
    s.stream[0].packed[0].bytes = {};
  }
}

VolumeWriter::VolumeWriter(VolumeWriter&&) noexcept = default;

VolumeWriter::~VolumeWriter() {
  if (!state_ || state_->finished) return;
  std::error_code ignored;
  state_->out.close();
  fs::remove(state_->temporary, ignored);
}

void VolumeWriter::write(std::span<const std::byte> voxels) {
  State& s = *state_;
  const std::size_t width = bytes_of(s.image.type),
                    per_voxel = width * static_cast<std::size_t>(s.kind.components);
  if (!s.is_packed() && s.in_order()) {
    s.put_out(reinterpret_cast<const char*>(voxels.data()), voxels.size());
    s.written += voxels.size();
    return;
  }
  const std::size_t part = chunk_bytes * chunks_at_once / per_voxel * per_voxel;
  for (std::size_t begin = 0; begin < voxels.size(); begin += part) {
    stop_if_requested();
    const auto now = voxels.subspan(begin, std::min(part, voxels.size() - begin));
    const std::size_t streams = s.stream.size();
    for (std::size_t c = 0; c < streams; ++c) {
      auto& stream = s.stream[c];
      if (s.in_order()) {
        stream.waiting.insert(stream.waiting.end(), now.begin(), now.end());
      } else {
        const std::size_t before = stream.waiting.size(), count = now.size() / per_voxel;
        stream.waiting.resize(before + count * width);
        for (std::size_t v = 0; v < count; ++v)
          std::memcpy(stream.waiting.data() + before + v * width, now.data() + v * per_voxel + c * width,
                      width);
      }
      if (s.is_packed()) {
        s.pack_waiting(stream, false);
      } else {  // each component at its place
        s.out.seekp(
            static_cast<std::streamoff>(s.header.size() + c * (s.all / streams) + s.written / streams));
        s.put_out(reinterpret_cast<const char*>(stream.waiting.data()), stream.waiting.size());
        stream.waiting.clear();
      }
    }
    s.written += now.size();
  }
}

void VolumeWriter::finish() {
  State& s = *state_;
  if (s.written != s.all) throw std::logic_error("a volume image was given other voxels than it has");
  if (s.is_packed()) {
    uLong crc = crc32(0, nullptr, 0), adler = adler32(0, nullptr, 0);
    std::size_t plain = 0;
    for (auto& stream : s.stream) {
      s.pack_waiting(stream, true);
      for (const Packed& packed : stream.packed) {
        s.put_out(packed.bytes.data(), packed.bytes.size());
        crc = crc32_combine(crc, packed.crc, static_cast<z_off_t>(packed.plain));
        adler = adler32_combine(adler, packed.adler, static_cast<z_off_t>(packed.plain));
        plain += packed.plain;
      }
    }
    s.put_out(last_block, 2);
    std::string end;
    if (s.suffix == ".mha") {
      put(end, static_cast<std::uint32_t>(adler), true);
    } else {
      put(end, static_cast<std::uint32_t>(crc), false);
      put(end, static_cast<std::uint32_t>(plain), false);  // the last 32 bits of the length
    }
    s.put_out(end.data(), end.size());
    if (s.suffix == ".mha") {
      const auto length = static_cast<std::size_t>(s.out.tellp()) - s.header.size();
      const std::string digits = fmt::format("{:>{}}", length, room_for_length);
      s.out.seekp(static_cast<std::streamoff>(s.header.find("CompressedDataSize = ") + 21));
      s.put_out(digits.data(), digits.size());
    }
  }
  s.out.close();
  if (!s.out) s.failed("the disk is full or gone");
  move_into_place(s.temporary, s.file);
  s.finished = true;
}

}  // namespace dimple
