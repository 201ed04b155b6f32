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
  std::map<int, std::string> names;     ///< label number -> name, where the file or a table says one

  std::string format;                  ///< "NRRD", "3D Slicer segmentation (NRRD)", "NIfTI-1", "MetaImage"
  std::string orientation;             ///< anatomical letters of the stored axes, e.g. "RAS", "PIR"
  std::array<Index, 3> stored_size{};  ///< voxels along the stored axes
  Vec3 stored_spacing = Vec3::Zero();  ///< [mm], along the stored axes
  std::vector<std::string> warnings;   ///< sentences for the user: what was assumed, and why

  std::span<const Run> row(Index j, Index k) const {
    const std::size_t* offset = row_offset.data() + (j + size[1] * k);
    return {run.data() + offset[0], run.data() + offset[1]};
  }
  /// Needs a voxel of the image. Cost: a search among the runs of its row; over many voxels go by row().
  std::int32_t at(Index i, Index j, Index k) const;
  /// Voxel edge lengths along i, j, k [mm], and the volume of a voxel [mm^3]; to twelve digits, so that how
  /// the image lies in space does not show in the last ones.
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
/// Positions are those of nibabel and 3D Slicer, except that an image sheared too far for the latter is read
/// as it is and a file in metres or microns is scaled as a whole, both with a warning. Of a NIfTI file the
/// sform counts if its code is set, else the qform if its code is set, else pixdim.
///
/// One organ has the same shape however it was stored: spacings and angles are snapped, so that nothing that
/// follows from them hangs on the digits in which headers of one image differ (single precision: 1e-7 of a
/// number; a line of text with six digits: 5e-6 of one). Spacings to six significant digits from 1 mm upward,
/// five below (0.73242 for 375/512 mm: 2.5 um over 500 voxels); cosines between axes to 1e-6, and to right
/// angles below 2e-5. How the image lies in space moves nothing inside of it and stays as it is, but axes
/// within 2e-5 of the patient's are the patient's.
///
/// `label_names`, if not empty,
/// is a table of names, or a numbering known without one; see io/label_names.hpp. It overrides names in the
/// image. Throws InputError: no such file, unknown format, not three-dimensional, several components,
/// segments in several layers, labels that are negative or not whole numbers (but for rounding, which a
/// warning reports), nothing but background, neighbours
/// that are hardly ever alike (so many runs that memory would be at stake: an MRI), truncated data.
LabelImage read_label_image(const std::filesystem::path& file, const std::filesystem::path& label_names = {});

/// Labels that another program holds in memory, side by side, whichever axis runs fastest.
struct LabelArray {
  std::variant<const std::int8_t*, const std::uint8_t*, const std::int16_t*, const std::uint16_t*,
               const std::int32_t*, const std::uint32_t*, const std::int64_t*, const std::uint64_t*,
               const float*, const double*>
      voxel;
  std::array<Index, 3> size{};
  std::array<Index, 3> step{};  ///< numbers from a voxel to the next along each axis
  Eigen::Affine3d to_world;     ///< voxel centre (i, j, k) -> LPS position [mm]
};
/// The same image as that of a file with these numbers; they are read where they are, and not kept.
LabelImage label_image_of(const LabelArray& array, const std::filesystem::path& label_names = {});

/// Writes in the format that the suffix names (.nrrd, .seg.nrrd, .nii, .nii.gz, .mha), compressed except
/// .nii, as uint8, uint16 or int32 by the largest label. Written beside its name, read back, then renamed.
/// Names of the labels present go into .nrrd and .seg.nrrd as 3D Slicer's SegmentN_ keys; NIfTI and MetaImage
/// have no place for them, so they go into an ITK-SNAP table beside the image, brain.nii.gz ->
/// brain.labels.txt. NIfTI holds its geometry in single precision. Throws UsageError (unknown suffix),
/// OutputError (cannot write).
void write_label_image(const std::filesystem::path& file, const LabelImage& image);

/// One label of an image, measured.
struct LabelMeasure {
  int value = 0;
  std::string name;  ///< empty if none is known
  std::int64_t voxels = 0;
  double volume_mm3 = 0.0;
  Vec3 centre_mm = Vec3::Zero();  ///< mean of its voxels' positions, LPS
  int pieces = 0;                 ///< face-connected components
  std::int64_t largest_piece_voxels = 0;
  bool touches_border = false;
};

/// Every foreground label, in ascending order of value.
std::vector<LabelMeasure> measure_labels(const LabelImage& image);

}  // namespace dimple
