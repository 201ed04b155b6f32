#include "io/label_formats.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <system_error>
#include <type_traits>

#include "io/memory.hpp"
#include "io/text.hpp"

namespace dimple {

namespace fs = std::filesystem;

std::array<Index, 3> checked_size(const std::vector<Index>& size, Index components, const fs::path& file,
                                  const std::string& layers) {
  const auto refuse = [&](std::string fact, std::string why, std::string remedy) {
    return InputError({.fact = std::move(fact),
                       .where = image_place(file),
                       .why = std::move(why),
                       .remedy = std::move(remedy)});
  };
  if (components != 1)
    throw refuse(fmt::format("every voxel holds {} numbers instead of one label{}{}", components,
                             layers.empty() ? "" : ": ", printable(layers, most_repeated)),
                 layers.empty()
                     ? "the image is a colour or vector image, or a segmentation in several layers, whose "
                       "segments may overlap"
                     : "segments in different layers may overlap, and a voxel can have only one label",
                 "in 3D Slicer, module Segmentations: export the segments to a label map (a voxel in two "
                 "segments goes to one of them) and save that as .nrrd");
  std::size_t dimensions = size.size();
  while (dimensions > 3 && size[dimensions - 1] == 1) --dimensions;
  if (dimensions > 3)
    throw refuse(fmt::format("the image has {} axes ({} voxels)", dimensions, fmt::join(size, " x ")),
                 "an organ is segmented in one three-dimensional image",
                 "save one time frame or one channel as an image of its own");
  if (dimensions == 0)
    throw refuse("the image has 0 axes", "the header is damaged", "export the segmentation again");
  if (dimensions < 3 || size[0] == 1 || size[1] == 1 || size[2] == 1)
    throw refuse(fmt::format("the image is flat: {} voxels", fmt::join(size, " x ")),
                 "an organ needs three dimensions, with at least two voxels along each",
                 "give the whole segmented volume, not one slice of it");
  constexpr double limit = std::numeric_limits<std::int32_t>::max();
  double voxels = 1.0;
  for (std::size_t a = 0; a < 3; ++a) {
    if (size[a] <= 0)
      throw refuse(fmt::format("axis {} is said to hold {} voxels", a + 1, size[a]), "the header is damaged",
                   "export the segmentation again");
    voxels *= static_cast<double>(size[a]);
  }
  if (voxels > limit)
    throw refuse(fmt::format("the image has {:.3g} voxels", voxels),
                 fmt::format("at most {:.3g} are read; or the header is damaged", limit),
                 "crop the image to the organ, or resample it to larger voxels");
  return {size[0], size[1], size[2]};
}

std::optional<double> millimetres_in(const std::string& unit) {
  static const std::map<std::string, double> known = {
      {"", 1.0},          {"mm", 1.0},       {"millimeter", 1.0}, {"millimetre", 1.0},  {"cm", 10.0},
      {"m", 1000.0},      {"meter", 1000.0}, {"metre", 1000.0},   {"um", 0.001},        {"\u00b5m", 0.001},
      {"\u03bcm", 0.001}, {"micron", 0.001}, {"microns", 0.001},  {"micrometer", 0.001}};
  const auto found = known.find(unit);
  return found == known.end() ? std::nullopt : std::optional(found->second);
}

void scale_to_millimetres(StoredImage& image, double factor, const std::string& unit) {
  image.to_world.matrix().topRows<3>() *= factor;
  image.warnings.push_back(
      fmt::format("The file gives lengths in {}; spacing and origin were multiplied by {} to millimetres.",
                  unit, factor));
}

void check_length(const StoredImage& image, const fs::path& file) {
  constexpr double deflate_limit = 1032.0;  // bytes out per byte in, at best
  std::error_code failed;
  const std::uintmax_t length = fs::file_size(file, failed);
  if (!failed && static_cast<double>(image.data_bytes()) > deflate_limit * static_cast<double>(length))
    throw truncated(file, fmt::format("{} bytes cannot hold {} bytes of voxels", length, image.data_bytes()));

  const double memory = memory_at_hand();
  // In addition to the start of each row; runs are few, or the image is refused.
  const double thinnest = static_cast<double>(*std::min_element(image.size.begin(), image.size.end()));
  const double voxels = static_cast<double>(image.data_bytes()) / static_cast<double>(bytes_of(image.type));
  const double needed = static_cast<double>(image.data_bytes()) + voxels / thinnest * sizeof(std::size_t);
  if (needed > memory)
    throw InputError(
        {.fact = fmt::format("the voxels need {:.1f} GB of memory, and {:.1f} GB are available", needed / 1e9,
                             memory / 1e9),
         .where = image_place(file),
         .why = fmt::format("the image has {} x {} x {} voxels; or its header is damaged", image.size[0],
                            image.size[1], image.size[2]),
         .remedy = "crop the image to the organ, resample it to larger voxels, or use a larger machine"});
}

void warn_of_surplus(StoredImage& image, std::uintmax_t bytes) {
  if (bytes == 0) return;
  image.warnings.push_back(fmt::format(
      "The file has {}{} more bytes after its voxels; check that its size of {} x {} x {} is right.",
      bytes >= surplus_limit ? "more than " : "", bytes, image.size[0], image.size[1], image.size[2]));
}

void swap_bytes(StoredImage& image) {
  with_type(image.type, [&]<class T>(T) {
    for (std::size_t n = 0; n + sizeof(T) <= image.data.size(); n += sizeof(T))
      std::reverse(image.data.data() + n, image.data.data() + n + sizeof(T));
  });
}

bool is_at_right_angles(const Mat3& axes) {
  const Mat3 unit = axes.colwise().normalized();
  return (unit.transpose() * unit - Mat3::Identity()).cwiseAbs().maxCoeff() < 5e-4;  // the bound of ITK
}

InputError no_place_in_space(const fs::path& file, std::string_view fact) {
  return InputError(
      {.fact = printable(fact, most_repeated),
       .where = image_place(file),
       .why = "spacing, direction and origin in the file's header do not describe a place in space",
       .remedy = "correct the header, or export the segmentation again"});
}

InputError truncated(const fs::path& file, std::string_view fact) {
  return InputError({.fact = printable(fact, most_repeated),
                     .where = image_place(file),
                     .why = "the file is incomplete or damaged, as after a copy that was cut short",
                     .remedy = "copy or export the segmentation again"});
}

}  // namespace dimple
