#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Voxels [begin, end) of a row that hold one label, which is not background.
struct Run {
  std::int32_t begin, end, label;
  bool operator==(const Run&) const = default;
};

/// A segmentation: one label number per voxel, 0 is background.
///
/// Kept as runs along i, because labels are alike over many voxels: 512^3 voxels take a few MB. Runs of a row
/// ascend, do not overlap, and are as long as they can be.
///
/// Axes are canonical: permuted and flipped on reading so that voxel axes i, j, k run as nearly as
/// possible along +L, +P, +S. One organ therefore gives one LabelImage, however it was stored.
struct LabelImage {
  std::array<Index, 3> size{};          ///< voxels along i, j, k
  std::vector<Run> run;                 ///< of all rows, j fastest
  std::vector<std::size_t> row_offset;  ///< [size[1]*size[2] + 1] where in `run` each row begins
  Eigen::Affine3d to_world;             ///< voxel centre (i, j, k) -> LPS position [mm]; det > 0
  std::map<int, std::string> names;     ///< label number -> name, if the file or a table has one

  std::string format;                  ///< "NRRD", "3D Slicer segmentation (NRRD)", "NIfTI-1", "MetaImage"
  std::string orientation;             ///< anatomical letters of the stored axes, e.g. "RAS", "PIR"
  std::array<Index, 3> stored_size{};  ///< voxels along the stored axes
  Vec3 stored_spacing = Vec3::Zero();  ///< [mm], along the stored axes
  std::vector<std::string> warnings;   ///< sentences for the user: what was assumed, and why

  std::span<const Run> row(Index j, Index k) const {
    const std::size_t* offset = row_offset.data() + (j + size[1] * k);
    return {run.data() + offset[0], run.data() + offset[1]};
  }
  /// Needs a voxel of the image. Cost: a search among the runs of its row; for many voxels use row().
  std::int32_t at(Index i, Index j, Index k) const;
  /// Voxel edge lengths along i, j, k [mm], and the volume of a voxel [mm^3]; to twelve digits, so that they
  /// do not depend on the image's orientation.
  Vec3 spacing() const;
  double voxel_volume() const;
};

/// Adds the next row: image.size[0] labels, i ascending. Rows come with j fastest, size[1]*size[2] of them.
void append_row(LabelImage& image, std::span<const std::int32_t> label);

/// Voxels low to high, both included.
struct VoxelBox {
  std::array<Index, 3> low, high;
};
/// The box around the foreground; without any, `high` is -1.
VoxelBox foreground_box(const LabelImage& image);

/// Reads .nrrd, .nhdr, .seg.nrrd, .nii, .nii.gz, .hdr with .img, .mha, .mhd.
///
/// Positions are those of nibabel and 3D Slicer, with two exceptions and a warning for both. An image sheared
/// too far for the latter is read as it is, and a file in metres or microns is scaled as a whole. Of a NIfTI
/// file the sform counts if its code is set, else the qform if its code is set, else pixdim.
///
/// One organ has the same shape however it was stored. Spacings and angles are snapped, so that no result
/// depends on the digits in which headers of one image differ (single precision: 1e-7 of a number; text with
/// six digits: 5e-6). Spacings to six significant digits from 1 mm upward, five below (0.73242 for 375/512
/// mm: 2.5 um over 500 voxels); cosines between axes to 1e-6, and to right angles below 2e-5. The orientation
/// has no influence inside the image and is kept, but axes within 2e-5 of the patient's become the patient's.
///
/// `label_names`, if not empty, is a table of names or a built-in numbering; see io/label_names.hpp. It
/// overrides names in the image. Throws InputError: no such file, unknown format, truncated data, not
/// three-dimensional, several components, segments in several layers, only background. Labels must be whole
/// numbers from 0 on, except for rounding, with a warning. An image whose neighbours are hardly ever alike
/// (an MRI) is refused, since its runs might exceed the memory.
LabelImage read_label_image(const std::filesystem::path& file, const std::filesystem::path& label_names = {});

/// Labels in another program's memory, contiguous, with any axis fastest.
struct LabelArray {
  std::variant<const std::int8_t*, const std::uint8_t*, const std::int16_t*, const std::uint16_t*,
               const std::int32_t*, const std::uint32_t*, const std::int64_t*, const std::uint64_t*,
               const float*, const double*>
      voxel;
  std::array<Index, 3> size{};
  std::array<Index, 3> step{};  ///< numbers from a voxel to the next along each axis
  Eigen::Affine3d to_world;     ///< voxel centre (i, j, k) -> LPS position [mm]
};
/// Image equal to that of a file with these numbers; they are read in place, and not kept.
LabelImage label_image_of(const LabelArray& array, const std::filesystem::path& label_names = {});

/// Writes in the format of the suffix (.nrrd, .seg.nrrd, .nii, .nii.gz, .mha), compressed except .nii, as
/// uint8, uint16 or int32 by the largest label. Written next to its name, read back, then renamed. Names of
/// the labels present go into .nrrd and .seg.nrrd as 3D Slicer's SegmentN_ keys; for NIfTI and MetaImage into
/// an ITK-SNAP table next to the image, brain.nii.gz -> brain.labels.txt. NIfTI holds its geometry in single
/// precision. Throws UsageError (unknown suffix), OutputError (cannot write).
void write_label_image(const std::filesystem::path& file, const LabelImage& image);

/// Measures of one label of an image.
struct LabelMeasure {
  int value = 0;
  std::string name;  ///< empty if there is none
  std::int64_t voxels = 0;
  double volume_mm3 = 0.0;
  Vec3 centre_mm = Vec3::Zero();  ///< mean of its voxels' positions, LPS
  int pieces = 0;                 ///< face-connected components
  std::int64_t largest_piece_voxels = 0;
  bool meets_border = false;
};

/// Every foreground label, in ascending order of value.
std::vector<LabelMeasure> measure_labels(const LabelImage& image);

}  // namespace dimple
