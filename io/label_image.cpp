#include "io/label_image.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <numeric>
#include <optional>
#include <type_traits>
#include <utility>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/image_axes.hpp"
#include "io/label_formats.hpp"
#include "io/label_names.hpp"
#include "io/stop.hpp"
#include "io/text.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

enum class Format { nrrd, nifti, metaimage, unknown };

constexpr std::size_t block = std::size_t{1} << 22;  // voxels between two tests for a stop

Format format_of(const fs::path& file) {
  const std::string name = lower(file.filename().string());
  const auto ends = [&](auto... suffix) { return (name.ends_with(suffix) || ...); };
  if (ends(".nrrd", ".nhdr")) return Format::nrrd;
  if (ends(".nii", ".nii.gz", ".hdr", ".hdr.gz", ".img", ".img.gz")) return Format::nifti;
  if (ends(".mha", ".mhd")) return Format::metaimage;
  return Format::unknown;
}

/// Description of the error in a number that should be a label; nullptr if none.
const char* fault(double label) {
  if (!std::isfinite(label)) return "not finite";
  if (label < 0.0) return "negative";
  if (label != std::floor(label)) return "not a whole number";
  if (label > std::numeric_limits<std::int32_t>::max()) return "larger than 2147483647";
  return nullptr;
}

template <class T>
constexpr Number number_type() {
  if constexpr (std::is_floating_point_v<T>) return sizeof(T) == 4 ? Number::real32 : Number::real64;
  return static_cast<Number>(2 * std::countr_zero(sizeof(T)) + (std::is_signed_v<T> ? 0 : 1));
}

/// Distance of neighbours along each stored axis, in numbers.
std::array<Index, 3> steps_of(const StoredImage& image) {
  return image.elsewhere.empty() ? std::array<Index, 3>{1, image.size[0], image.size[0] * image.size[1]}
                                 : image.step;
}

bool is_plain(const StoredImage& image) {
  return image.slope == 1.0 && image.intercept == 0.0;
}

/// Value of the file's number. A double holds every label that is accepted; numbers that it rounds are far
/// above the greatest.
template <class T>
double value_of(const StoredImage& image, T number) {
  if (is_plain(image)) return static_cast<double>(number);
  return image.slope * static_cast<double>(number) + image.intercept;
}

/// The label of a value: the nearest whole number if rounding explains the difference, else the value itself.
/// Single precision and resampling leave up to 1e-4. A program that scales labels into whole numbers (nibabel
/// does, of floats) leaves half a step of its scale. The multiples of a scale that is not a whole number
/// differ from whole ones by 1/3 somewhere: the limit of 1/4 refuses an MRI.
double label_of(const StoredImage& image, double value) {
  const double half_a_step = image.slope == 1.0 ? 0.0 : 0.5 * std::abs(image.slope);
  const double slack = std::min(0.25, std::max(1e-4, half_a_step + 1e-6 * std::abs(value)));
  const double nearest = std::round(value);
  return std::abs(value - nearest) <= slack ? nearest : value;
}

/// Largest difference between a value and its label; 0 if only the scale's single precision causes one.
/// Throws unless every voxel holds a label.
double check_voxels(const StoredImage& image, const fs::path& file) {
  const std::size_t count = image.count();
  std::size_t faulty = 0, first = 0;
  double first_value = 0.0, farthest = 0.0;
  const double unreported = is_plain(image) ? 0.0 : 1e-6;
  with_type(image.type, [&]<class T>(T) {
    const std::span<const T> number = numbers<T>(image);
    if (std::is_unsigned_v<T> && sizeof(T) < 4 && is_plain(image)) return;  // nothing can be wrong
    for (std::size_t begin = 0; begin < count; begin += block) {
      stop_if_requested();
      const auto part = number.subspan(begin, std::min(block, count - begin));
      // Most blocks hold few different numbers: only those that differ from the one before are examined.
      for (std::size_t v = 0; v < part.size(); ++v) {
        if (v > 0 && part[v] == part[v - 1] && faulty == 0) continue;
        const double value = value_of(image, part[v]), label = label_of(image, value);
        if (const double off = std::abs(value - label); off > unreported * std::max(1.0, label))
          farthest = std::max(farthest, off);
        if (fault(label) && faulty++ == 0) first = begin + v, first_value = label;
      }
    }
  });
  if (faulty > 0) {
    const std::array<Index, 3> step = steps_of(image);
    const auto along = [&](std::size_t a) { return static_cast<Index>(first) / step[a] % image.size[a]; };
    throw InputError(
        {.fact = fmt::format("{} of {} voxels hold no label: the first is {:.7g}, which is {}", faulty, count,
                             first_value, fault(first_value)),
         .where =
             fmt::format("{}, stored voxel ({}, {}, {})", image_place(file), along(0), along(1), along(2)),
         .why = "a label is a whole number from 0 (background) upward; an MRI or a probability map is no "
                "segmentation",
         .remedy = "give the segmentation, exported as a label map with an integer type"});
  }
  return farthest;
}

void check_geometry(const Eigen::Affine3d& to_world, const fs::path& file) {
  const auto refuse = [&](const std::string& fact) { return no_place_in_space(file, fact); };
  const Mat3 m = to_world.linear();
  if (!to_world.matrix().allFinite()) throw refuse("the image's geometry holds a number that is not finite");
  const Vec3 spacing = m.colwise().norm();
  if (!(spacing.minCoeff() > 1e-6) || !(spacing.maxCoeff() < 1e6))
    throw refuse(
        fmt::format("the voxel spacing is {:.6g} x {:.6g} x {:.6g} mm", spacing[0], spacing[1], spacing[2]));
  const double volume = std::abs(Mat3(m.colwise().normalized()).determinant());
  if (!(volume > 1e-3))  // 1 for axes at right angles
    throw refuse("the image's axes do not span space: they are in one plane or nearly so");
}

/// Step from canonical voxels to stored ones: (i, j, k) is number first + i step[0] + j step[1] + k step[2].
struct Walk {
  Index first = 0;
  std::array<Index, 3> step{};
};

/// An image with more runs is no segmentation: a run of an organ's labels has tens of voxels, one of an MRI's
/// grey values has one. Small images may hold anything, with a warning.
std::size_t most_runs(const LabelImage& image) {
  const Index voxels = image.size[0] * image.size[1] * image.size[2];
  return std::max<std::size_t>(std::size_t{1} << 22, static_cast<std::size_t>(voxels) / 8);
}

/// Appends the runs of one row of stored numbers.
template <class T>
void append_runs(std::vector<Run>& run, const T* number, Index count, const StoredImage& stored) {
  constexpr Index stride = 64;
  const std::size_t begin_of_row = run.size();
  for (Index begin = 0, end = 0; begin < count; begin = end) {
    end = begin + 1;
    // Compares many numbers with their left neighbours together, then one by one.
    while (end + stride <= count && std::memcmp(number + end, number + end - 1, stride * sizeof(T)) == 0)
      end += stride;
    while (end < count && number[end] == number[begin]) ++end;
    const auto label = static_cast<std::int32_t>(label_of(stored, value_of(stored, number[begin])));
    if (label == 0) continue;
    const auto first = static_cast<std::int32_t>(begin), after = static_cast<std::int32_t>(end);
    if (run.size() > begin_of_row && run.back().end == first && run.back().label == label)
      run.back().end = after;
    else
      run.push_back({first, after, label});
  }
}

/// Converts the stored voxels to canonical rows. Rows across memory are gathered in groups that are
/// contiguous there.
template <class T>
void take_rows(LabelImage& image, const StoredImage& stored, const Walk& walk, const fs::path& file) {
  const T* number = numbers<T>(stored).data();
  const auto [ni, nj, nk] = image.size;
  const std::size_t limit = most_runs(image);
  // The axis along which neighbouring rows are neighbours in memory, and the other.
  const std::size_t along = std::abs(walk.step[1]) < std::abs(walk.step[2]) ? 1 : 2, across = 3 - along;
  const Index side = std::abs(walk.step[0]) == 1 ? 1 : 64, pitch = ni + 64 / static_cast<Index>(sizeof(T));
  std::vector<T> tile(static_cast<std::size_t>(side * pitch));

  std::vector<Run> run;  // in the order in which rows are visited
  const auto row_of = [&, nj = nj](Index a, Index b) {
    return static_cast<std::size_t>(along == 1 ? a + nj * b : b + nj * a);
  };
  image.row_offset.assign(static_cast<std::size_t>(nj * nk) + 1, 0);
  for (Index b = 0; b < image.size[across]; ++b)
    for (Index a = 0; a < image.size[along]; a += side) {
      stop_if_requested();
      const Index width = std::min(side, image.size[along] - a);
      const T* corner = number + walk.first + a * walk.step[along] + b * walk.step[across];
      if (walk.step[0] != 1)
        for (Index i = 0; i < ni; ++i)
          for (Index w = 0; w < width; ++w)
            tile[static_cast<std::size_t>(w * pitch + i)] = corner[i * walk.step[0] + w * walk.step[along]];
      for (Index w = 0; w < width; ++w) {
        const std::size_t before = run.size();
        append_runs(run, walk.step[0] == 1 ? corner : tile.data() + w * pitch, ni, stored);
        image.row_offset[row_of(a + w, b) + 1] = run.size() - before;
      }
      if (run.size() > limit)
        throw InputError(
            {.fact = fmt::format("the labels change more than {} times along the rows of {} x {} x {} voxels",
                                 limit, ni, nj, nk),
             .where = image_place(file),
             .why = "neighbours are rarely equal: this is an MRI or CT rather than its segmentation",
             .remedy = "give the segmentation, exported as a label map"});
    }
  std::partial_sum(image.row_offset.begin(), image.row_offset.end(), image.row_offset.begin());
  if (along == 1) {  // rows are in their final order
    image.run = std::move(run);
    return;
  }
  image.run.resize(run.size());
  auto from = run.begin();
  for (Index b = 0; b < image.size[across]; ++b)
    for (Index a = 0; a < image.size[along]; ++a) {
      const std::size_t row = row_of(a, b);
      const auto to = from + static_cast<std::ptrdiff_t>(image.row_offset[row + 1] - image.row_offset[row]);
      std::copy(from, to, image.run.begin() + static_cast<std::ptrdiff_t>(image.row_offset[row]));
      from = to;
    }
}

LabelImage canonical(const StoredImage& stored, const fs::path& file) {
  check_geometry(stored.to_world, file);
  const double rounded = check_voxels(stored, file);
  const StoredAxes order = nearest_to_LPS(stored.to_world.linear());
  const Mat3& linear = stored.to_world.linear();

  LabelImage image;
  image.names = stored.names;
  image.format = stored.format;
  image.warnings = stored.warnings;
  if (rounded > 0.0)
    image.warnings.push_back(fmt::format(
        "Labels that are not whole numbers were rounded, by {:.2g} at most; check that the image is a "
        "segmentation.",
        rounded));
  image.orientation = letters(order);
  image.stored_size = stored.size;

  Walk walk;
  const std::array<Index, 3> stored_step = steps_of(stored);
  Vec3 origin = stored.to_world.translation();
  for (std::size_t c = 0; c < 3; ++c) {
    const auto a = static_cast<std::size_t>(order.stored[c]);
    const auto column = static_cast<Index>(c);
    image.size[c] = stored.size[a];
    walk.step[c] = stored_step[a];
    image.to_world.linear().col(column) = linear.col(order.stored[c]);
    if (order.flipped[c]) {
      origin += linear.col(order.stored[c]) * static_cast<double>(stored.size[a] - 1);
      walk.first += stored_step[a] * (stored.size[a] - 1);
      walk.step[c] = -walk.step[c];
      image.to_world.linear().col(column) *= -1.0;
    }
  }
  image.to_world.linear() = snapped(image.to_world.linear()).array() + 0.0;  // no -0
  const Vec3 spacing = image.spacing();
  for (std::size_t c = 0; c < 3; ++c) image.stored_spacing[order.stored[c]] = spacing[static_cast<Index>(c)];
  image.to_world.translation() = origin.array() + 0.0;
  image.to_world.makeAffine();

  with_type(stored.type, [&]<class T>(T) { take_rows<T>(image, stored, walk, file); });
  if (image.run.empty())
    throw InputError({.fact = fmt::format("all {} voxels are background (0)", stored.count()),
                      .where = image_place(file),
                      .why = "an organ is made of the voxels whose label is not 0, and there is none",
                      .remedy = "check that the segmentation was saved, and that this is the right file"});
  if (!is_at_right_angles(linear))
    image.warnings.push_back(
        "The image's axes are not at right angles; the shear is kept. 3D Slicer may refuse this file or show "
        "it without the shear.");
  return image;
}

/// Largest extent of the box around the foreground [mm].
double foreground_extent(const LabelImage& image) {
  const auto [low, high] = foreground_box(image);
  double extent = 0.0;
  for (std::size_t c = 0; c < 3; ++c)
    extent =
        std::max(extent, static_cast<double>(high[c] - low[c] + 1) * image.spacing()[static_cast<Index>(c)]);
  return extent;
}

/// Grey values of an MRI pass for labels if they are whole numbers, but most neighbours differ: in a
/// segmentation most are alike.
bool looks_like_grey_values(const LabelImage& image) {
  std::int64_t pairs = 0, differing = 0;
  for (std::size_t r = 0; r < image.run.size(); ++r) {
    pairs += image.run[r].end - image.run[r].begin - 1;
    // The next run may be of another row and begin at the same voxel by chance; those are few.
    if (r == 0 || image.run[r - 1].end != image.run[r].begin) continue;
    ++pairs, ++differing;
  }
  return pairs > 1000 && 2 * differing > pairs;
}

/// Names from a table, or a built-in numbering.
struct Naming {
  std::string given;  ///< empty: nothing
  LabelTable table;
  bool known_without_file = false;
};

Naming read_naming(const fs::path& label_names) {
  Naming naming{.given = label_names.string(), .table = {}};
  if (label_names.empty()) return naming;
  if (auto known = fs::exists(label_names) ? std::nullopt : known_label_names(label_names.string())) {
    naming.table = std::move(*known);
    naming.known_without_file = true;
  } else {
    naming.table = read_label_names(label_names);
  }
  return naming;
}

/// Adds names to the image, and warnings about unusual properties.
LabelImage judged(LabelImage image, const Naming& naming) {
  const LabelTable& table = naming.table;
  for (const auto& [label, name] : table.names) image.names[label] = name;
  image.warnings.insert(image.warnings.end(), table.warnings.begin(), table.warnings.end());
  if (naming.known_without_file)
    if (std::string warning = other_numbering(naming.given, image); !warning.empty())
      image.warnings.push_back(std::move(warning));
  if (!naming.given.empty() && std::none_of(image.run.begin(), image.run.end(),
                                            [&](const Run& run) { return table.names.contains(run.label); }))
    image.warnings.push_back("The table of label names names none of the labels in the image.");

  const double extent = foreground_extent(image);
  if (extent < 5.0 || extent > 2000.0)
    image.warnings.push_back(
        fmt::format("The labels extend over {:.4g} mm, which is unusual for an organ; check the unit of the "
                    "voxel spacing.",
                    extent));
  if (looks_like_grey_values(image))
    image.warnings.push_back(
        "Most neighbouring voxels have different labels: this may be an MRI or CT rather than its "
        "segmentation.");
  return image;
}

/// Recognises DICOM, whose names have no suffix, by byte 128.
bool is_dicom(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::array<char, 4> word{};
  in.seekg(128);
  in.read(word.data(), word.size());
  return in.gcount() == 4 && std::string_view(word.data(), word.size()) == "DICM";
}

[[noreturn]] void refuse_suffix(const fs::path& file, bool reading) {
  Report report{
      .fact = fmt::format("'{}' does not end in a known suffix", file.filename().string()),
      .where = image_place(file),
      .why = reading ? "known are .nrrd, .nhdr, .seg.nrrd, .nii, .nii.gz, .hdr, .img, .mha and .mhd"
                     : "known are .nrrd, .seg.nrrd, .nii, .nii.gz and .mha",
      .remedy = "export the segmentation in one of these formats; from 3D Slicer, save it as .seg.nrrd"};
  if (const auto suffix = file.extension(); reading && (suffix == ".mgz" || suffix == ".mgh")) {
    report.fact = fmt::format("'{}' is in FreeSurfer's format, which is not read", file.filename().string());
    report.remedy = fmt::format("convert it with FreeSurfer's `mri_convert {} {}.nii.gz`",
                                file.filename().string(), file.stem().string());
  }
  if (reading) throw InputError(std::move(report));
  report.remedy = "choose a name with one of these suffixes";
  throw UsageError(std::move(report));
}

template <class T>
void store_as(StoredImage& stored, const LabelImage& image) {
  stored.data.assign(static_cast<std::size_t>(image.size[0] * image.size[1] * image.size[2]) * sizeof(T),
                     std::byte{0});
  T* row = reinterpret_cast<T*>(stored.data.data());
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j, row += image.size[0])
      for (const Run& r : image.row(j, k)) std::fill(row + r.begin, row + r.end, static_cast<T>(r.label));
}

StoredImage to_stored(const LabelImage& image) {
  StoredImage stored;
  stored.size = image.size;
  stored.to_world = image.to_world;
  std::int32_t largest = 0;
  for (const Run& run : image.run) largest = std::max(largest, run.label);
  if (largest <= std::numeric_limits<std::uint8_t>::max()) {
    stored.type = Number::uint8;
    store_as<std::uint8_t>(stored, image);
  } else if (largest <= std::numeric_limits<std::uint16_t>::max()) {
    stored.type = Number::uint16;
    store_as<std::uint16_t>(stored, image);
  } else {
    stored.type = Number::int32;
    store_as<std::int32_t>(stored, image);
  }
  return stored;
}

/// brain.nii.gz -> brain.labels.txt
fs::path names_next_to(const fs::path& file) {
  fs::path stem = file;
  if (stem.extension() == ".gz") stem.replace_extension();
  return stem.replace_extension(".labels.txt");
}

}  // namespace

Vec3 LabelImage::spacing() const {
  const Vec3 length = to_world.linear().colwise().norm();
  return length.unaryExpr([](double x) { return with_twelve_digits(x); });
}

double LabelImage::voxel_volume() const {
  return with_twelve_digits(to_world.linear().determinant());
}

std::int32_t LabelImage::at(Index i, Index j, Index k) const {
  const auto runs = row(j, k);
  const auto found = std::partition_point(runs.begin(), runs.end(), [i](const Run& r) { return r.end <= i; });
  return found != runs.end() && found->begin <= i ? found->label : 0;
}

void append_row(LabelImage& image, std::span<const std::int32_t> label) {
  if (image.row_offset.empty()) image.row_offset.push_back(0);
  const auto count = static_cast<std::int32_t>(label.size());
  for (std::int32_t begin = 0, end = 0; begin < count; begin = end) {
    const std::int32_t value = label[static_cast<std::size_t>(begin)];
    while (end < count && label[static_cast<std::size_t>(end)] == value) ++end;
    if (value != 0) image.run.push_back({begin, end, value});
  }
  image.row_offset.push_back(image.run.size());
}

VoxelBox foreground_box(const LabelImage& image) {
  VoxelBox box{.low = image.size, .high = {-1, -1, -1}};
  auto& [low, high] = box;
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j) {
      const auto row = image.row(j, k);
      if (row.empty()) continue;
      low = {std::min<Index>(low[0], row.front().begin), std::min(low[1], j), std::min(low[2], k)};
      high = {std::max<Index>(high[0], row.back().end - 1), std::max(high[1], j), std::max(high[2], k)};
    }
  return box;
}

LabelImage read_label_image(const fs::path& file, const fs::path& label_names) {
  const Format format = format_of(file);
  std::error_code ignored;  // the error in the path is reported below
  if (fs::is_directory(file, ignored))
    throw InputError({.fact = fmt::format("'{}' is a folder", file.string()),
                      .where = image_place(file),
                      .why = "a label image is one file; a folder of DICOM slices is not read",
                      .remedy = "name a .nrrd, .nii or .mha; load a DICOM segmentation in 3D Slicer and save "
                                "it as .seg.nrrd"});
  require_regular_file(file);
  if (is_dicom(file))
    throw InputError({.fact = "the file is DICOM, which is not read",
                      .where = image_place(file),
                      .why = "one slice, or a DICOM segmentation; known are .nrrd, .nii and .mha",
                      .remedy = "load the series in 3D Slicer and save its segmentation as .seg.nrrd; or "
                                "convert a DICOM segmentation by segimage2itkimage of dcmqi"});
  if (format == Format::unknown) refuse_suffix(file, true);
  const Naming naming = read_naming(label_names);  // first: it is cheap, and the image may be large
  return judged(canonical(format == Format::nrrd    ? read_nrrd(file)
                          : format == Format::nifti ? read_nifti(file)
                                                    : read_metaimage(file),
                          file),
                naming);
}

LabelImage label_image_of(const LabelArray& array, const fs::path& label_names) {
  const fs::path place = "in memory";
  const Naming naming = read_naming(label_names);
  StoredImage stored;
  stored.size = checked_size({array.size.begin(), array.size.end()}, 1, place);
  std::visit(
      [&]<class T>(const T* voxel) {
        stored.type = number_type<T>();
        stored.elsewhere = std::as_bytes(std::span(voxel, stored.count()));
      },
      array.voxel);
  stored.step = array.step;
  stored.to_world = array.to_world;
  stored.format = "array";
  return judged(canonical(stored, place), naming);
}

void write_label_image(const fs::path& file, const LabelImage& image) {
  const Format format = format_of(file);
  // Headers with the data in a second file cannot be replaced in one step.
  const std::string name = file.filename().string();
  if (format == Format::unknown ||
      (format == Format::nifti && !name.ends_with(".nii") && !name.ends_with(".nii.gz")) ||
      (format != Format::nifti && !name.ends_with(".nrrd") && !name.ends_with(".mha")))
    refuse_suffix(file, false);

  const StoredImage stored = to_stored(image);
  const fs::path temporary = temporary_next_to(file);
  try {
    claim_temporary(temporary, file);  // throws the system's reason if the folder is missing or read-only
    StoredImage written;
    if (format == Format::nrrd) {
      const bool segmentation = name.ends_with(".seg.nrrd");
      write_nrrd(temporary, stored, segmentation || !image.names.empty() ? segment_keys(image) : KeyValues{});
      written = read_nrrd(temporary);
    } else if (format == Format::nifti) {
      write_nifti(temporary, stored);
      written = read_nifti(temporary);
    } else {
      write_metaimage(temporary, stored);
      written = read_metaimage(temporary);
    }
    // ITK's writers do not notice every failure of the disk.
    if (written.data != stored.data) throw std::runtime_error("the written file differs when read back");
  } catch (const OutputError&) {
    std::error_code ignored;
    fs::remove(temporary, ignored);
    throw;
  } catch (const std::exception& error) {
    std::error_code ignored;
    fs::remove(temporary, ignored);
    throw OutputError(
        {.fact = fmt::format("cannot write '{}': {}", file.string(), error.what()),
         .where = image_place(file),
         .why = "the image was written under a temporary name, found incomplete and removed",
         .remedy = "check the room on that disk, or choose another output folder with --output"});
  }
  // The names first: an image that exists is then complete.
  if (format != Format::nrrd)
    if (const std::string names = label_descriptions(image); !names.empty())
      write_file(names_next_to(file), names);
  move_into_place(temporary, file);
}

}  // namespace dimple
