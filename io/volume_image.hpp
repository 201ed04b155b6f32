#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

struct StoredImage;

/// Positions of the voxels of an image, along its stored axes: possibly flipped, oblique or sheared.
struct VoxelGrid {
  std::array<Index, 3> size{};
  Eigen::Affine3d to_world = Eigen::Affine3d::Identity();  ///< voxel centre (i, j, k) -> LPS position [mm]

  Index voxels() const { return size[0] * size[1] * size[2]; }
  Index slice() const { return size[0] * size[1]; }
  Vec3 spacing() const { return to_world.linear().colwise().norm(); }
  double voxel_volume() const { return std::abs(to_world.linear().determinant()); }
  bool operator==(const VoxelGrid& other) const {
    return size == other.size && to_world.matrix() == other.to_world.matrix();
  }
};

enum class Sampling { linear, nearest };

/// An image in its file's own form: an MRI, or a label map, each voxel a number of the file's own type.
class VolumeImage {
 public:
  /// Reads the formats of read_label_image(), with any numbers in them. Throws InputError.
  explicit VolumeImage(const std::filesystem::path& file);
  ~VolumeImage();
  VolumeImage(VolumeImage&&) noexcept;
  VolumeImage& operator=(VolumeImage&&) noexcept;

  const VoxelGrid& grid() const { return grid_; }
  std::size_t bytes_per_voxel() const;
  /// The image at places [3 x count] in voxels along its axes, in its own type. Linear: between the eight
  /// voxels around, whole numbers rounded. Nearest: the voxel's number. Beyond the image: linear, as at its
  /// border; nearest, 0.
  void sample(std::span<const float> place, Sampling how, std::byte* result) const;
  /// The voxel's number after slope and intercept; and as a label, for counting.
  double value_of(const std::byte* number) const;
  std::int64_t label_of(const std::byte* number) const;
  /// Number v, in the order of the file, and all behind it.
  const std::byte* voxel(Index v) const;
  void set_to_zero(Index v);
  const StoredImage& stored() const { return *stored_; }

 private:
  std::unique_ptr<StoredImage> stored_;
  VoxelGrid grid_;
};

/// Type of the numbers of a new image, in addition to its grid.
struct VolumeKind {
  int components = 1;        ///< 3: vectors in LPS, the components of a voxel side by side
  std::string meaning = {};  ///< of a vector image: "modeling" or "resampling", for 3D Slicer
  const VolumeImage* like =
      nullptr;  ///< an image whose type, scale and segments it takes over; else: Float32
};

/// ".nii.gz", ".nii", ".nrrd" or ".mha": the format of images written next to `file`, equal to its own; for
/// formats with the voxels in a second file, the one with a single file.
std::string volume_suffix(const std::filesystem::path& file);

/// Writes an image of that grid in parts, so that it is never in memory as a whole; packed, except .nii. It
/// appears under its name when finish() is called, and not at all otherwise.
///
/// Own code for headers: ITK's writers need all voxels at once, pack them in one thread, and ignore Ctrl-C.
class VolumeWriter {
 public:
  /// Throws OutputError.
  VolumeWriter(std::filesystem::path file, const VoxelGrid& grid, const VolumeKind& kind);
  ~VolumeWriter();
  VolumeWriter(VolumeWriter&&) noexcept;

  /// The next voxels, in the order in which they are stored: first axis fastest. Throws OutputError, Stopped.
  void write(std::span<const std::byte> voxels);
  void write(std::span<const float> numbers) { write(std::as_bytes(numbers)); }
  void finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace dimple
