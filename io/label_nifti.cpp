// NIfTI-1 and -2 by the byte offsets of the standard and zlib instead of ITK's reader. That refuses a sheared
// sform, scales only the spacing of a file in metres, turns NaN into 0, and accepts a missing orientation
// silently. With the libnifti of ITK 5.2 it does not support NIfTI-2. Debian's libnifti2 does, but its
// functions have the names of ITK's with other arguments: a program cannot hold both.

#include <fmt/format.h>
#include <nifti1_io.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string_view>
#include <system_error>

#include "io/file.hpp"
#include "io/label_formats.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

using GzFile = std::unique_ptr<gzFile_s, decltype(&gzclose)>;

/// Offsets and types of the header's fields in a version.
struct Layout {
  int version;
  std::size_t bytes;
  std::size_t datatype, bitpix, dim, pixdim, vox_offset, slope, intercept, units, qform_code, sform_code,
      quaternion, offset, sform, magic;
};
constexpr Layout nifti_1{1, 348, 70, 72, 40, 76, 108, 112, 116, 123, 252, 254, 256, 268, 280, 344};
constexpr Layout nifti_2{2, 540, 12, 14, 16, 104, 168, 176, 184, 500, 344, 348, 352, 376, 400, 4};
static_assert(sizeof(nifti_1_header) == nifti_1.bytes);

/// A header of either version, as numbers.
struct Header {
  const Layout* layout = &nifti_1;
  bool swapped = false;  ///< the other byte order, voxels too
  int datatype = 0, bitpix = 0, units = 0, qform_code = 0, sform_code = 0;
  std::array<std::int64_t, 8> dim{};
  std::array<double, 8> pixdim{};
  double vox_offset = 0.0, slope = 0.0, intercept = 0.0;
  Vec3 quaternion = Vec3::Zero(), offset = Vec3::Zero();
  Eigen::Matrix<double, 3, 4> sform = Eigen::Matrix<double, 3, 4>::Zero();
};

template <class T>
T number_at(const std::byte* bytes, std::size_t offset, bool swapped) {
  std::array<std::byte, sizeof(T)> number;
  std::copy_n(bytes + offset, sizeof(T), number.begin());
  if (swapped) std::reverse(number.begin(), number.end());
  return std::bit_cast<T>(number);
}

template <class Dim, class Real, class Offset, class Code, class Units>
Header decoded(const std::byte* bytes, const Layout& layout, bool swapped) {
  const auto at = [&]<class T>(T, std::size_t offset, std::size_t n = 0) {
    return number_at<T>(bytes, offset + n * sizeof(T), swapped);
  };
  Header h;
  h.layout = &layout;
  h.swapped = swapped;
  h.datatype = at(std::int16_t{}, layout.datatype);
  h.bitpix = at(std::int16_t{}, layout.bitpix);
  for (std::size_t a = 0; a < 8; ++a) h.dim[a] = at(Dim{}, layout.dim, a);
  for (std::size_t a = 0; a < 8; ++a) h.pixdim[a] = at(Real{}, layout.pixdim, a);
  h.vox_offset = static_cast<double>(at(Offset{}, layout.vox_offset));
  h.slope = at(Real{}, layout.slope);
  h.intercept = at(Real{}, layout.intercept);
  h.units = at(Units{}, layout.units);
  h.qform_code = at(Code{}, layout.qform_code);
  h.sform_code = at(Code{}, layout.sform_code);
  for (std::size_t r = 0; r < 3; ++r) {
    const auto row = static_cast<Index>(r);
    h.quaternion[row] = at(Real{}, layout.quaternion, r);
    h.offset[row] = at(Real{}, layout.offset, r);
    for (std::size_t c = 0; c < 4; ++c)
      h.sform(row, static_cast<Index>(c)) = at(Real{}, layout.sform, 4 * r + c);
  }
  return h;
}

GzFile open_gz(const fs::path& file) {
  require_regular_file(file);
  errno = 0;
  GzFile in(gzopen(file.c_str(), "rb"), &gzclose);
  if (!in)
    throw InputError(
        {.fact = fmt::format("cannot open '{}': {}", file.string(), std::generic_category().message(errno)),
         .where = image_place(file),
         .why = "the system refused",
         .remedy = "check the path and that you may read the file"});
  gzbuffer(in.get(), 1 << 17);
  return in;
}

/// Header and voxels: one file, or a pair such as brain.hdr and brain.img.gz.
struct NiftiFiles {
  fs::path header, data;
  bool is_pair = false;
};

NiftiFiles files_of(const fs::path& file) {
  std::string stem = file.string();
  const bool capitals = std::isupper(static_cast<unsigned char>(stem.back())) != 0;
  if (const auto gz = file.extension(); gz == ".gz" || gz == ".GZ") stem.resize(stem.size() - 3);
  const std::string suffix = fs::path(stem).extension().string();
  if (suffix != ".hdr" && suffix != ".img" && suffix != ".HDR" && suffix != ".IMG")
    return {file, file, false};
  stem.resize(stem.size() - 4);
  const auto part = [&](const char* small, const char* large) {
    const std::string plain = stem + (capitals ? large : small), packed = plain + (capitals ? ".GZ" : ".gz");
    return fs::path(!fs::exists(plain) && fs::exists(packed) ? packed : plain);
  };
  return {part(".hdr", ".HDR"), part(".img", ".IMG"), true};
}

/// Fills `bytes` or throws; gzread also reads uncompressed files. They are bytes `before` onward of `total`,
/// for the message.
void read_exactly(gzFile in, std::byte* bytes, std::size_t count, const fs::path& file,
                  std::size_t before = 0, std::size_t total = 0) {
  std::size_t done = 0;
  while (done < count) {
    stop_if_requested();
    const auto chunk = static_cast<unsigned>(std::min<std::size_t>(count - done, 1u << 22));
    const int n = gzread(in, bytes + done, chunk);
    if (n > 0) {
      done += static_cast<std::size_t>(n);
      continue;
    }
    int code = Z_OK;
    gzerror(in, &code);
    if (n < 0 && code == Z_DATA_ERROR)
      throw truncated(file, fmt::format("the compressed data are damaged after {} bytes", before + done));
    throw truncated(file,
                    fmt::format("the file ends after {} of {} bytes", before + done, std::max(total, count)));
  }
}

Header read_header(gzFile in, const fs::path& file, bool is_pair) {
  const auto refuse = [&](std::string fact, std::string remedy) -> InputError {
    return InputError({.fact = std::move(fact),
                       .where = image_place(file),
                       .why = is_pair ? "the suffix .hdr promises a NIfTI header with its voxels in .img"
                                      : "the suffix .nii promises a NIfTI file with header and voxels in one",
                       .remedy = std::move(remedy)});
  };
  std::array<std::byte, nifti_2.bytes> bytes{};
  read_exactly(in, bytes.data(), nifti_1.bytes, file);
  const auto length = [&](bool swapped) { return number_at<std::int32_t>(bytes.data(), 0, swapped); };
  const auto says = [&](const Layout& layout, std::string_view magic) {
    return std::memcmp(bytes.data() + layout.magic, magic.data(), magic.size()) == 0;
  };
  using namespace std::string_view_literals;
  for (const bool swapped : {false, true}) {
    if (length(swapped) == nifti_2.bytes) {
      read_exactly(in, bytes.data() + nifti_1.bytes, nifti_2.bytes - nifti_1.bytes, file);
      // A transfer in text mode changes its last letters.
      if (!says(nifti_2, is_pair ? "ni2\0\r\n\032\n"sv : "n+2\0\r\n\032\n"sv))
        throw refuse("the file is not a NIfTI-2 image", "check the file; export the segmentation again");
      return decoded<std::int64_t, double, std::int64_t, std::int32_t, std::int32_t>(bytes.data(), nifti_2,
                                                                                     swapped);
    }
    if (length(swapped) != nifti_1.bytes) continue;
    if (is_pair && bytes[nifti_1.magic] == std::byte{0})
      throw refuse("the file is Analyze 7.5, which does not state its orientation in the patient",
                   "convert it to NIfTI-1, NRRD or MetaImage and check that left is left");
    if (!says(nifti_1, is_pair ? "ni1\0"sv : "n+1\0"sv)) break;
    return decoded<std::int16_t, float, float, std::int16_t, std::int8_t>(bytes.data(), nifti_1, swapped);
  }
  throw refuse("the file is not a NIfTI-1 image", "check the file; export the segmentation again");
}

// In the order of Number.
constexpr std::array<short, 10> nifti_types = {
    NIFTI_TYPE_INT8,   NIFTI_TYPE_UINT8, NIFTI_TYPE_INT16,  NIFTI_TYPE_UINT16,  NIFTI_TYPE_INT32,
    NIFTI_TYPE_UINT32, NIFTI_TYPE_INT64, NIFTI_TYPE_UINT64, NIFTI_TYPE_FLOAT32, NIFTI_TYPE_FLOAT64};

Number number_type(const Header& header, const fs::path& file) {
  const auto found = std::find(nifti_types.begin(), nifti_types.end(), header.datatype);
  if (found == nifti_types.end())
    throw InputError({.fact = fmt::format("the voxels are of type {}, not one number each",
                                          nifti_datatype_string(header.datatype)),
                      .where = image_place(file),
                      .why = "a label image holds one whole number per voxel",
                      .remedy = "export the segmentation as a label map with an integer type"});
  return static_cast<Number>(found - nifti_types.begin());
}

/// Matrix of the header's quaternion, computed as libnifti does.
Eigen::Matrix<double, 3, 4> qform_of(const Header& h) {
  Vec3 v = h.quaternion;
  double w = 1.0 - v.squaredNorm();
  if (w < (h.layout->version == 1 ? 1e-7 : 1e-15)) {  // a half turn, whose quaternion was rounded
    v.normalize();
    w = 0.0;
  }
  const Mat3 turn = Eigen::Quaterniond(std::sqrt(w), v.x(), v.y(), v.z()).toRotationMatrix();
  const double handedness = h.pixdim[0] < 0.0 ? -1.0 : 1.0;
  Eigen::Matrix<double, 3, 4> m;
  m << turn * Vec3(h.pixdim[1], h.pixdim[2], handedness * h.pixdim[3]).asDiagonal(), h.offset;
  return m;
}

std::string in_words(const Eigen::Matrix<double, 3, 4>& ras) {
  const Vec3 spacing = ras.leftCols<3>().colwise().norm();
  return fmt::format("{:.6g} x {:.6g} x {:.6g} mm from ({:.6g}, {:.6g}, {:.6g})", spacing[0], spacing[1],
                     spacing[2], ras(0, 3), ras(1, 3), ras(2, 3));
}

bool is_a_place(const Eigen::Matrix<double, 3, 4>& m) {
  return m.allFinite() && m.leftCols<3>().colwise().norm().minCoeff() > 1e-6 &&
         std::abs(Mat3(m.leftCols<3>().colwise().normalized()).determinant()) > 1e-3;
}

/// The sform if its code is set, else the qform if its code is set, else pixdim: as nibabel and 3D Slicer do.
/// A qform replaces an sform that is singular or not finite.
void read_geometry(const Header& h, StoredImage& image, const fs::path& file) {
  using Rows = Eigen::Matrix<double, 3, 4>;
  const bool has_q = h.qform_code > 0, has_s = h.sform_code > 0 && (!has_q || is_a_place(h.sform));
  const Vec3 spacing(h.pixdim[1], h.pixdim[2], h.pixdim[3]);
  if (!has_s && !(spacing.minCoeff() > 0.0 && spacing.allFinite()))
    throw InputError(
        {.fact = fmt::format("the voxel spacing is {:.6g} x {:.6g} x {:.6g} mm{}", spacing[0], spacing[1],
                             spacing[2], spacing.allFinite() ? "" : ", which is not finite"),
         .where = image_place(file),
         .why = "the header's pixdim is damaged or was never set",
         .remedy = "correct the header, or export the segmentation again"});
  const Rows qform = has_q ? qform_of(h) : Rows(Rows::Zero());
  Rows ras = Rows::Zero();
  if (has_s) {
    ras = h.sform;
    const Vec3 lengths = h.sform.leftCols<3>().colwise().norm();
    if (!has_q && lengths.allFinite() && !lengths.isApprox(spacing, 1e-3))
      image.warnings.push_back(fmt::format(
          "The header gives a spacing of {:.6g} x {:.6g} x {:.6g} mm, its sform {:.6g} x {:.6g} x {:.6g} mm; "
          "the sform is used.",
          spacing[0], spacing[1], spacing[2], lengths[0], lengths[1], lengths[2]));
    double apart = 0.0;
    for (int corner = 0; has_q && corner < 8; ++corner) {
      Eigen::Vector4d x(0, 0, 0, 1);
      for (int a = 0; a < 3; ++a)
        if (corner >> a & 1) x[a] = static_cast<double>(image.size[static_cast<std::size_t>(a)] - 1);
      apart = std::max(apart, ((h.sform - qform) * x).norm());
    }
    // A tenth of a voxel: more than rounding of a quaternion to single precision. Not a number is apart, too.
    if (has_q && !(apart <= 0.1 * lengths.minCoeff()))
      image.warnings.push_back(fmt::format(
          "sform and qform place the image up to {:.3g} mm apart: the sform says {}, the qform {}; the sform "
          "is used, as in nibabel and 3D Slicer.",
          apart, in_words(h.sform), in_words(qform)));
  } else if (has_q) {
    ras = qform;
    if (h.sform_code > 0)
      image.warnings.push_back("The file's sform does not describe a place in space; the qform is used.");
  } else {
    ras.leftCols<3>() = spacing.asDiagonal();
    ras.topRows<2>() *= -1.0;  // ITK: stored axes along +L, +P, +S
    image.warnings.push_back(
        "The file does not state the image's orientation in the patient (no qform, no sform); its axes are "
        "assumed to be left, posterior and superior from the origin.");
  }
  ras.topRows<2>() *= -1.0;  // RAS to LPS
  image.to_world.matrix().topRows<3>() = ras;
}

/// Sizes of the axes in the file, checked.
void read_size(const Header& header, StoredImage& image, const NiftiFiles& files, const fs::path& named) {
  if (header.dim[0] < 1 || header.dim[0] > 7)
    throw InputError({.fact = fmt::format("the image is said to have {} axes", header.dim[0]),
                      .where = image_place(files.header),
                      .why = "a NIfTI image has 1 to 7; the header is damaged",
                      .remedy = "export the segmentation again"});
  std::vector<Index> size;
  for (std::size_t a = 1; a <= static_cast<std::size_t>(header.dim[0]); ++a)
    size.push_back(a > 3 && header.dim[a] == 0 ? 1 : header.dim[a]);  // 0: the axis does not exist
  // The fifth axis counts components, for any length and intent code.
  const Index components = size.size() > 4 ? size[4] : 1;
  if (size.size() > 4) size[4] = 1;
  image.size = checked_size(size, components, named);
  check_length(image, files.data);
}

/// Conversion of a voxel's bits to its value: type, slope and intercept.
void read_scaling(const Header& header, StoredImage& image) {
  if (const auto bits = static_cast<int>(8 * bytes_of(image.type)); header.bitpix != bits)
    image.warnings.push_back(fmt::format(
        "The header states {} bits per voxel where its type has {}; the type is used.", header.bitpix, bits));
  if (header.slope != 0.0 && std::isfinite(header.slope)) {  // 0 means: not scaled
    image.slope = header.slope;
    image.intercept = header.intercept;
  }
}

void take_unit_of_length(const Header& header, StoredImage& image) {
  switch (XYZT_TO_SPACE(header.units)) {
    case NIFTI_UNITS_METER:
      scale_to_millimetres(image, 1000.0, "metres");
      break;
    case NIFTI_UNITS_MICRON:
      scale_to_millimetres(image, 0.001, "microns");
      break;
    case NIFTI_UNITS_MM:
    case NIFTI_UNITS_UNKNOWN:  // unspecified, which means the same in practice
      break;
    default:
      image.warnings.push_back(fmt::format(
          "The file's unit of length {} is unknown; millimetres are assumed.", XYZT_TO_SPACE(header.units)));
  }
}

constexpr std::size_t chunk_to_skip = 1 << 16;  // [bytes]

/// Skips the header's extensions up to the first voxel. `in` is behind the header, or at the beginning of the
/// file of voxels.
void skip_to_voxels(gzFile in, const Header& header, const StoredImage& image, const NiftiFiles& files) {
  // A writer that left out vox_offset meant the end of the header and its four bytes.
  const double offset = header.vox_offset, length = static_cast<double>(fs::file_size(files.data));
  const bool is_packed = gzdirect(in) == 0;
  if (!(offset >= 0.0 && offset < 1e9) || (!is_packed && offset > length))
    throw InputError({.fact = fmt::format("the voxels are said to begin at byte {}", offset),
                      .where = image_place(files.data),
                      .why = "the header's vox_offset is damaged",
                      .remedy = "export the segmentation again"});
  const double begin =
      files.is_pair ? offset : std::max(offset, static_cast<double>(header.layout->bytes) + 4.0);
  if (const double held = std::max(length - begin, 0.0);
      !is_packed && held < static_cast<double>(image.data_bytes()))
    throw truncated(files.data,
                    fmt::format("the file ends after {} of {} bytes of voxels", held, image.data_bytes()));
  std::vector<std::byte> skipped(chunk_to_skip);
  auto to_skip = static_cast<std::size_t>(begin) - (files.is_pair ? 0 : header.layout->bytes);
  while (to_skip > 0) {
    const std::size_t chunk = std::min(to_skip, skipped.size());
    read_exactly(in, skipped.data(), chunk, files.data);
    to_skip -= chunk;
  }
}

void read_voxels(gzFile in, StoredImage& image, const fs::path& file) {
  image.data.reserve(image.data_bytes());  // address space only: memory is used as the bytes come
  while (image.data.size() < image.data_bytes()) {
    const std::size_t done = image.data.size(),
                      chunk = std::min<std::size_t>(image.data_bytes() - done, 1 << 22);
    image.data.resize(done + chunk);
    read_exactly(in, image.data.data() + done, chunk, file, done, image.data_bytes());
  }
}

/// Reads to the end, where zlib compares checksums: the number of bytes behind the voxels.
std::size_t read_surplus(gzFile in, const fs::path& file) {
  std::vector<std::byte> skipped(chunk_to_skip);
  std::size_t surplus = 0;
  int n = 0;
  while (surplus < surplus_limit) {
    stop_if_requested();
    n = gzread(in, skipped.data(), static_cast<unsigned>(skipped.size()));
    if (n <= 0) break;
    surplus += static_cast<std::size_t>(n);
  }
  if (int code = Z_OK; n < 0 || (gzerror(in, &code), code != Z_OK))
    throw truncated(file, "the checksum at the end of the compressed data does not agree or is missing");
  return surplus;
}

}  // namespace

StoredImage read_nifti(const fs::path& named) {
  const NiftiFiles files = files_of(named);
  GzFile in = open_gz(files.header);
  const Header header = read_header(in.get(), files.header, files.is_pair);
  if (files.is_pair) in = open_gz(files.data);

  StoredImage image;
  image.format = fmt::format("NIfTI-{}", header.layout->version);
  image.type = number_type(header, named);
  read_size(header, image, files, named);
  read_scaling(header, image);
  read_geometry(header, image, named);
  take_unit_of_length(header, image);

  skip_to_voxels(in.get(), header, image, files);
  read_voxels(in.get(), image, files.data);
  warn_of_surplus(image, read_surplus(in.get(), files.data));
  if (header.swapped) swap_bytes(image);
  return image;
}

std::vector<std::byte> nifti_header(const StoredImage& image, int components) {
  nifti_1_header h{};
  h.sizeof_hdr = nifti_1.bytes;
  std::memcpy(h.magic, "n+1", 4);
  h.vox_offset = nifti_1.bytes + 4;
  h.dim[0] = components > 1 ? 5 : 3;  // components are on the fifth axis, behind time
  for (std::size_t a = 0; a < 3; ++a) {
    if (image.size[a] > std::numeric_limits<short>::max())
      throw std::runtime_error(
          fmt::format("NIfTI-1 holds at most 32767 voxels along an axis, not {}", image.size[a]));
    h.dim[a + 1] = static_cast<short>(image.size[a]);
  }
  for (int a = 4; a < 8; ++a) h.dim[a] = 1;
  if (components > 1) {
    h.dim[5] = static_cast<short>(components);
    h.intent_code = NIFTI_INTENT_VECTOR;
    for (int a = 4; a < 8; ++a) h.pixdim[a] = 1.0f;
  }
  h.datatype = nifti_types[static_cast<std::size_t>(image.type)];
  h.bitpix = static_cast<short>(8 * bytes_of(image.type));
  h.xyzt_units = NIFTI_UNITS_MM;
  h.scl_slope = static_cast<float>(image.slope);
  h.scl_inter = static_cast<float>(image.intercept);

  Eigen::Matrix<double, 3, 4> ras = image.to_world.matrix().topRows<3>();
  ras.topRows<2>() *= -1.0;  // LPS to RAS
  mat44 m{};
  m.m[3][3] = 1.0f;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 4; ++c) m.m[r][c] = static_cast<float>(ras(r, c));
  for (int c = 0; c < 4; ++c) h.srow_x[c] = m.m[0][c], h.srow_y[c] = m.m[1][c], h.srow_z[c] = m.m[2][c];
  h.sform_code = NIFTI_XFORM_SCANNER_ANAT;
  float qfac = 1.0f;
  nifti_mat44_to_quatern(m, &h.quatern_b, &h.quatern_c, &h.quatern_d, &h.qoffset_x, &h.qoffset_y,
                         &h.qoffset_z, &h.pixdim[1], &h.pixdim[2], &h.pixdim[3], &qfac);
  h.pixdim[0] = qfac;
  // A quaternion cannot represent shear; it would contradict the sform.
  h.qform_code = is_at_right_angles(ras.leftCols<3>()) ? NIFTI_XFORM_SCANNER_ANAT : NIFTI_XFORM_UNKNOWN;

  std::vector<std::byte> bytes(sizeof h + 4, std::byte{0});  // four more: no extension follows
  std::memcpy(bytes.data(), &h, sizeof h);
  return bytes;
}

void write_nifti(const fs::path& file, const StoredImage& image) {
  const std::vector<std::byte> header = nifti_header(image, 1);
  errno = 0;
  GzFile out(gzopen(file.c_str(), file.extension() == ".gz" ? "wb6" : "wbT"), &gzclose);  // T: not compressed
  const auto write = [&](const void* bytes, std::size_t count) {
    const auto* next = static_cast<const char*>(bytes);
    while (out && count > 0) {
      const int n = gzwrite(out.get(), next, static_cast<unsigned>(std::min<std::size_t>(count, 1u << 30)));
      if (n <= 0) return false;
      next += n, count -= static_cast<std::size_t>(n);
    }
    return out != nullptr;
  };
  const bool written = write(header.data(), header.size()) && write(image.data.data(), image.data.size());
  const int closed = out ? gzclose(out.release()) : Z_ERRNO;
  if (!written || closed != Z_OK)
    throw std::runtime_error(errno != 0 ? std::generic_category().message(errno) : "zlib could not write");
}

}  // namespace dimple
