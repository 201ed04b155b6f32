// NIfTI-1 through libnifti (the copy that ITK carries) and zlib rather than ITK's reader, which refuses a
// sheared sform, scales the spacing but not the origin of a file in metres, turns NaN into 0 and takes a file
// without orientation in silence.

#include <fmt/format.h>
#include <nifti1_io.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <stdexcept>
#include <system_error>

#include "io/label_formats.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

using GzFile = std::unique_ptr<gzFile_s, decltype(&gzclose)>;

constexpr int header_bytes = 348;
static_assert(sizeof(nifti_1_header) == header_bytes);

/// Fills `bytes` or throws; gzread passes a file that is not compressed through.
void read_exactly(gzFile in, std::byte* bytes, std::size_t count, const fs::path& file) {
  std::size_t done = 0;
  while (done < count) {
    const auto chunk = static_cast<unsigned>(std::min<std::size_t>(count - done, 1u << 30));
    const int n = gzread(in, bytes + done, chunk);
    if (n > 0) {
      done += static_cast<std::size_t>(n);
      continue;
    }
    int code = Z_OK;
    const std::string text = gzerror(in, &code);
    if (n < 0 && code == Z_DATA_ERROR)
      throw truncated(file, fmt::format("the compressed data are damaged after {} bytes", done));
    throw truncated(file, fmt::format("the file ends after {} of {} bytes", done, count));
  }
}

nifti_1_header read_header(gzFile in, const fs::path& file, bool& swapped) {
  const auto refuse = [&](std::string fact, std::string remedy) -> InputError {
    return InputError({.fact = std::move(fact),
                       .where = image_place(file),
                       .why = "the suffix .nii promises a NIfTI-1 file with header and voxels in one",
                       .remedy = std::move(remedy)});
  };
  nifti_1_header header{};
  std::byte bytes[header_bytes];
  read_exactly(in, bytes, header_bytes, file);
  std::memcpy(&header, bytes, header_bytes);

  int swapped_size = header.sizeof_hdr;
  nifti_swap_4bytes(1, &swapped_size);
  if (header.sizeof_hdr == 540 || swapped_size == 540)
    throw refuse("the file is NIfTI-2, which is not read", "convert it to NIfTI-1, NRRD or MetaImage");
  swapped = swapped_size == header_bytes;
  if (swapped) swap_nifti_header(&header, 1);
  if (header.sizeof_hdr != header_bytes || std::memcmp(header.magic, "n+1", 4) != 0)
    throw refuse("the file is not a NIfTI-1 image", "check the file; export the segmentation anew");
  return header;
}

Number number_type(const nifti_1_header& header, const fs::path& file) {
  switch (header.datatype) {
    case NIFTI_TYPE_INT8:
      return Number::int8;
    case NIFTI_TYPE_UINT8:
      return Number::uint8;
    case NIFTI_TYPE_INT16:
      return Number::int16;
    case NIFTI_TYPE_UINT16:
      return Number::uint16;
    case NIFTI_TYPE_INT32:
      return Number::int32;
    case NIFTI_TYPE_UINT32:
      return Number::uint32;
    case NIFTI_TYPE_INT64:
      return Number::int64;
    case NIFTI_TYPE_UINT64:
      return Number::uint64;
    case NIFTI_TYPE_FLOAT32:
      return Number::real32;
    case NIFTI_TYPE_FLOAT64:
      return Number::real64;
    default:
      throw InputError({.fact = fmt::format("the voxels are of type {}, not one number each",
                                            nifti_datatype_string(header.datatype)),
                        .where = image_place(file),
                        .why = "a label image holds one whole number per voxel",
                        .remedy = "export the segmentation as a label map with an integer type"});
  }
}

/// The double that a person would write for this float: 1.366f is 1.366, not 1.3660000562667847. Lets a NIfTI
/// file agree with an NRRD file of the same image; the change is below the float's own rounding.
double as_written(float value) {
  if (!std::isfinite(value)) return value;
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, value).ptr;
  double exact = 0.0;
  std::from_chars(text, end, exact);
  return exact;
}

Eigen::Matrix<double, 3, 4> rows(const mat44& m) {
  Eigen::Matrix<double, 3, 4> rows;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 4; ++c) rows(r, c) = as_written(m.m[r][c]);
  return rows;
}

bool is_orthogonal(const Mat3& m) {
  const Mat3 unit = m.colwise().normalized();
  return (unit.transpose() * unit - Mat3::Identity()).cwiseAbs().maxCoeff() < 5e-4;  // ITK's bound lies here
}

/// NIfTI's three methods, chosen among as ITK 5.2 does, so that positions agree with 3D Slicer.
void read_geometry(const nifti_1_header& h, StoredImage& image) {
  using Rows = Eigen::Matrix<double, 3, 4>;
  mat44 s{};
  for (int c = 0; c < 4; ++c) s.m[0][c] = h.srow_x[c], s.m[1][c] = h.srow_y[c], s.m[2][c] = h.srow_z[c];
  const Rows sform = rows(s);
  const Rows qform = rows(nifti_quatern_to_mat44(h.quatern_b, h.quatern_c, h.quatern_d, h.qoffset_x,
                                                 h.qoffset_y, h.qoffset_z, h.pixdim[1], h.pixdim[2],
                                                 h.pixdim[3], h.pixdim[0] < 0.0f ? -1.0f : 1.0f));
  const bool has_s = h.sform_code > 0, has_q = h.qform_code > 0;
  const bool sform_is_orthogonal = has_s && is_orthogonal(sform.leftCols<3>());

  Rows ras = Rows::Zero();
  if (has_s && (!has_q || (h.sform_code == NIFTI_XFORM_SCANNER_ANAT && sform_is_orthogonal))) {
    ras = sform;
    if (!sform_is_orthogonal)
      image.warnings.push_back(
          "The image's axes are not at right angles (sform matrix); the shear is kept. ITK and 3D Slicer "
          "would refuse this file.");
  } else if (has_q) {
    ras = qform;
  } else {
    for (int c = 0; c < 3; ++c) ras(c, c) = as_written(h.pixdim[c + 1]);
    ras.topRows<2>() *= -1.0;  // ITK: stored axes along +L, +P, +S
    image.warnings.push_back(
        "The file does not say how the image lies in the patient (no qform, no sform); its axes are taken "
        "to run along left, posterior and superior from the origin.");
  }
  if (has_s && has_q) {
    double apart = 0.0;
    for (int corner = 0; corner < 8; ++corner) {
      Eigen::Vector4d x(0, 0, 0, 1);
      for (int a = 0; a < 3; ++a)
        if (corner >> a & 1) x[a] = static_cast<double>(image.size[static_cast<std::size_t>(a)] - 1);
      apart = std::max(apart, ((sform - qform) * x).norm());
    }
    if (apart > 0.01)
      image.warnings.push_back(fmt::format(
          "sform and qform place the image up to {:.3g} apart; {} is used, as in ITK and 3D Slicer.", apart,
          ras == sform ? "sform" : "qform"));
  }
  ras.topRows<2>() *= -1.0;  // RAS to LPS
  image.to_world.matrix().topRows<3>() = ras;
}

}  // namespace

StoredImage read_nifti(const fs::path& file) {
  errno = 0;
  const GzFile in(gzopen(file.c_str(), "rb"), &gzclose);
  if (!in)
    throw InputError(
        {.fact = fmt::format("cannot open '{}': {}", file.string(), std::generic_category().message(errno)),
         .where = image_place(file),
         .why = "the system refused",
         .remedy = "check the path and that you may read the file"});
  bool swapped = false;
  const nifti_1_header header = read_header(in.get(), file, swapped);

  StoredImage image;
  image.format = "NIfTI-1";
  image.type = number_type(header, file);
  std::vector<Index> size;
  for (int a = 1; a <= std::clamp<int>(header.dim[0], 0, 7); ++a) size.push_back(header.dim[a]);
  // The fifth axis counts components, whatever its length and the intent code say.
  const Index components = size.size() > 4 ? size[4] : 1;
  if (size.size() > 4) size[4] = 1;
  image.size = checked_size(size, components, file);
  check_length(image, file);
  if (header.scl_slope != 0.0f && std::isfinite(header.scl_slope)) {  // 0 means: not scaled
    image.slope = as_written(header.scl_slope);
    image.intercept = as_written(header.scl_inter);
  }

  read_geometry(header, image);
  switch (XYZT_TO_SPACE(header.xyzt_units)) {
    case NIFTI_UNITS_METER:
      scale_to_millimetres(image, 1000.0, "metres");
      break;
    case NIFTI_UNITS_MICRON:
      scale_to_millimetres(image, 0.001, "microns");
      break;
    default:
      break;  // millimetres, or unsaid, which means the same in practice
  }

  // Skip extensions. A writer that forgot vox_offset meant the end of the header and its four bytes.
  const double offset = header.vox_offset;
  if (!(offset >= 0.0 && offset < 1e9))
    throw InputError({.fact = fmt::format("the voxels are said to begin at byte {}", offset),
                      .where = image_place(file),
                      .why = "the header's vox_offset is damaged",
                      .remedy = "export the segmentation anew"});
  std::vector<std::byte> skipped(
      static_cast<std::size_t>(std::max(offset, header_bytes + 4.0) - header_bytes));
  read_exactly(in.get(), skipped.data(), skipped.size(), file);

  image.data.resize(image.data_bytes());
  read_exactly(in.get(), image.data.data(), image.data.size(), file);
  char more[4096];
  int n = 0;
  while ((n = gzread(in.get(), more, sizeof more)) > 0) {  // to the end, where zlib compares checksums
  }
  if (int code = Z_OK; n < 0 || (gzerror(in.get(), &code), code != Z_OK))
    throw truncated(file, "the checksum at the end of the compressed data does not agree or is missing");
  if (swapped) {
    const std::size_t width = bytes_of(image.type);
    nifti_swap_Nbytes(image.data.size() / width, static_cast<int>(width), image.data.data());
  }
  return image;
}

void write_nifti(const fs::path& file, const StoredImage& image) {
  nifti_1_header h{};
  h.sizeof_hdr = header_bytes;
  std::memcpy(h.magic, "n+1", 4);
  h.vox_offset = header_bytes + 4;
  h.dim[0] = 3;
  for (std::size_t a = 0; a < 3; ++a) {
    if (image.size[a] > std::numeric_limits<short>::max())
      throw std::runtime_error(
          fmt::format("NIfTI-1 holds at most 32767 voxels along an axis, not {}", image.size[a]));
    h.dim[a + 1] = static_cast<short>(image.size[a]);
  }
  for (int a = 4; a < 8; ++a) h.dim[a] = 1;
  h.datatype = image.type == Number::uint8    ? NIFTI_TYPE_UINT8
               : image.type == Number::uint16 ? NIFTI_TYPE_UINT16
                                              : NIFTI_TYPE_INT32;
  h.bitpix = static_cast<short>(8 * bytes_of(image.type));
  h.xyzt_units = NIFTI_UNITS_MM;
  h.scl_slope = 1.0f;

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
  // A quaternion cannot say shear; it would contradict the sform.
  h.qform_code = is_orthogonal(ras.leftCols<3>()) ? NIFTI_XFORM_SCANNER_ANAT : NIFTI_XFORM_UNKNOWN;

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
  const char no_extension[4] = {};
  const bool written =
      write(&h, sizeof h) && write(no_extension, 4) && write(image.data.data(), image.data.size());
  const int closed = out ? gzclose(out.release()) : Z_ERRNO;
  if (!written || closed != Z_OK)
    throw std::runtime_error(errno != 0 ? std::generic_category().message(errno) : "zlib could not write");
}

}  // namespace dimple
