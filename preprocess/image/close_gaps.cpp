#include "preprocess/image/close_gaps.hpp"

#include <fmt/format.h>
#include <itkCommand.h>
#include <itkImage.h>
#include <itkSignedMaurerDistanceMapImageFilter.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "io/error.hpp"
#include "io/memory.hpp"
#include "io/stop.hpp"
#include "preprocess/image/voxel_set.hpp"

namespace dimple {
namespace {

using Mask = itk::Image<unsigned char, 3>;
using Map = itk::Image<float, 3>;

// Distances that differ by less are equal: their last digits depend on the order of the axes.
constexpr double slack = 1e-5;

// Mask, distance map and the additional memory of ITK's filter, measured.
constexpr double bytes_per_voxel = 16.0;

/// A box of voxels around the body, with room for the ball.
struct Room {
  std::array<Index, 3> first{};  ///< in the image; may be outside of it
  std::array<Index, 3> size{};
  std::size_t count() const { return static_cast<std::size_t>(size[0] * size[1] * size[2]); }
  std::size_t at(Index i, Index j, Index k) const {
    return static_cast<std::size_t>(i + size[0] * (j + size[1] * k));
  }
};

VoxelSet largest_piece(const VoxelSet& set) {
  const Pieces pieces = face_connected(set);
  std::vector<bool> kept(pieces.piece.size(), false);
  kept[largest(pieces)] = true;
  return cropped(selection(set, pieces, kept));
}

void refuse_too_wide(const VoxelSet& body, const Vec3& spacing, double width_mm) {
  double smallest = std::numeric_limits<double>::infinity();
  for (std::size_t d = 0; d < 3; ++d)  // the box has one empty voxel on each side
    smallest = std::min(smallest, spacing[static_cast<Index>(d)] * static_cast<double>(body.size[d] - 2));
  if (width_mm <= smallest) return;
  throw ModelError(
      {.fact = fmt::format("gaps of up to {:.4g} mm are to be closed in an organ {:.4g} mm thick", width_mm,
                           smallest),
       .where = "--close (image.close_mm)",
       .why = "no gap in it can be that wide, and closing it would leave nothing of the organ's shape",
       .remedy = "give the width of the folds' gaps, for a brain about --close 4mm",
       .code = "close-too-wide"});
}

Room room_around(const VoxelSet& body, const Vec3& spacing, double radius_mm) {
  Room room;
  double count = 1.0;
  for (std::size_t d = 0; d < 3; ++d) {
    const auto pad = static_cast<Index>(std::ceil(radius_mm / spacing[static_cast<Index>(d)]));
    room.first[d] = body.first[d] - pad;
    room.size[d] = body.size[d] + 2 * pad;
    count *= static_cast<double>(room.size[d]);
  }
  const double needed = bytes_per_voxel * count, there = memory_at_hand();
  if (needed > there)
    throw ModelError(
        {.fact = fmt::format("closing gaps among {:.0f} voxels needs {:.1f} GB of memory, and {:.1f} GB are "
                             "available",
                             count, needed / 1e9, there / 1e9),
         .where = "--close (image.close_mm)",
         .why = fmt::format("each voxel of the organ's box needs {:.0f} bytes", bytes_per_voxel),
         .remedy = "give an image with larger voxels, or leave --close out",
         .code = "memory"});
  return room;
}

/// Square of the distance to the nearest voxel of `object` [mm^2], for the voxels outside of it.
Map::Pointer squared_distance(Mask* object) {
  using Maurer = itk::SignedMaurerDistanceMapImageFilter<Mask, Map>;
  const auto filter = Maurer::New();
  filter->SetInput(object);
  filter->SetBackgroundValue(0);
  filter->SetUseImageSpacing(true);
  filter->SetSquaredDistance(true);
  filter->SetNumberOfWorkUnits(static_cast<itk::ThreadIdType>(
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism)));
  const auto listen = itk::CStyleCommand::New();
  listen->SetCallback([](itk::Object* caller, const itk::EventObject&, void*) {
    if (stop_requested() != StopReason::none) static_cast<itk::ProcessObject*>(caller)->AbortGenerateDataOn();
  });
  filter->AddObserver(itk::ProgressEvent(), listen);
  try {
    filter->Update();
  } catch (const itk::ProcessAborted&) {
    stop_if_requested();
    throw;
  }
  stop_if_requested();
  return filter->GetOutput();
}

/// 1 where closing by the ball adds a voxel to the body, else 0.
Mask::Pointer added_voxels(const VoxelSet& body, const Room& room, const Vec3& spacing, double radius_mm) {
  const auto mask = Mask::New();
  Mask::SizeType size;
  Mask::SpacingType step;
  for (unsigned d = 0; d < 3; ++d) {
    size[d] = static_cast<itk::SizeValueType>(room.size[d]);
    step[d] = spacing[d];
  }
  mask->SetRegions(size);
  mask->SetSpacing(step);
  mask->Allocate(true);
  unsigned char* const voxel = mask->GetBufferPointer();
  const auto each_stretch = [&](auto&& act) {
    for (Index k = 0; k < body.size[2]; ++k)
      for (Index j = 0; j < body.size[1]; ++j)
        for (const auto& [begin, end] : body.row(j, k)) {
          unsigned char* const row =
              voxel + room.at(body.first[0] - room.first[0], j + body.first[1] - room.first[1],
                              k + body.first[2] - room.first[2]);
          act(row + begin, row + end);
        }
  };
  each_stretch([](auto* begin, auto* end) { std::fill(begin, end, static_cast<unsigned char>(1)); });

  const double reach = radius_mm * radius_mm * (1.0 + slack);
  const std::size_t count = room.count();
  {  // out of the ball's reach from the body
    const Map::Pointer away = squared_distance(mask);
    const float* const distance2 = away->GetBufferPointer();
    for (std::size_t v = 0; v < count; ++v) voxel[v] = distance2[v] > reach;
    mask->Modified();
  }
  {  // out of its reach from there
    const Map::Pointer away = squared_distance(mask);
    const float* const distance2 = away->GetBufferPointer();
    for (std::size_t v = 0; v < count; ++v) voxel[v] = distance2[v] > reach;
  }
  each_stretch([](auto* begin, auto* end) { std::fill(begin, end, static_cast<unsigned char>(0)); });
  return mask;
}

/// Labels of the body's voxels in the room, 0 elsewhere.
std::vector<std::int32_t> labels_of(const LabelImage& image, const VoxelSet& body, const Room& room) {
  std::vector<std::int32_t> label(room.count(), 0);
  for (Index k = 0; k < body.size[2]; ++k)
    for (Index j = 0; j < body.size[1]; ++j) {
      if (body.row(j, k).empty()) continue;
      const auto runs = image.row(j + body.first[1], k + body.first[2]);
      for (const auto& [begin, end] : body.row(j, k))
        for (const Run& run : runs) {
          const Index from = std::max<Index>(begin + body.first[0], run.begin),
                      to = std::min<Index>(end + body.first[0], run.end);
          for (Index i = from; i < to; ++i)
            label[room.at(i - room.first[0], j + body.first[1] - room.first[1],
                          k + body.first[2] - room.first[2])] = run.label;
        }
    }
  return label;
}

/// Steps to the voxels within the ball, the nearest first.
struct Step {
  double distance2;
  std::ptrdiff_t by;
};
std::vector<Step> steps_within(double radius_mm, const Vec3& spacing, const Room& room) {
  std::array<Index, 3> reach{};
  for (std::size_t d = 0; d < 3; ++d)
    reach[d] = static_cast<Index>(std::floor(radius_mm * (1.0 + slack) / spacing[static_cast<Index>(d)]));
  std::vector<Step> steps;
  for (Index k = -reach[2]; k <= reach[2]; ++k)
    for (Index j = -reach[1]; j <= reach[1]; ++j)
      for (Index i = -reach[0]; i <= reach[0]; ++i) {
        const Vec3 away(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k));
        const double distance2 = away.cwiseProduct(spacing).squaredNorm();
        if (distance2 <= radius_mm * radius_mm * (1.0 + slack))
          steps.push_back({distance2, i + room.size[0] * (j + room.size[1] * k)});
      }
  std::stable_sort(steps.begin(), steps.end(),
                   [](const Step& a, const Step& b) { return a.distance2 < b.distance2; });
  return steps;
}

std::int32_t nearest_label(const std::vector<std::int32_t>& label, std::size_t voxel,
                           const std::vector<Step>& steps) {
  std::int32_t best = 0;
  double nearest = std::numeric_limits<double>::infinity();
  for (const Step& step : steps) {
    if (step.distance2 > nearest * (1.0 + slack)) break;
    const std::int32_t there = label[voxel + static_cast<std::size_t>(step.by)];
    if (there == 0) continue;
    best = best == 0 ? there : std::min(best, there);
    nearest = std::min(nearest, step.distance2);
  }
  return best;
}

}  // namespace

ClosedImage close_gaps(const LabelImage& image, const std::vector<int>& labels, double width_mm) {
  const VoxelSet all = voxels_with(image, labels);
  if (all.stretch.empty() || !(width_mm > 0.0)) return {image};
  const VoxelSet body = largest_piece(all);
  const Vec3 spacing = image.spacing();
  const double radius = 0.5 * width_mm;
  refuse_too_wide(body, spacing, width_mm);
  const Room room = room_around(body, spacing, radius);
  const Mask::Pointer mask = added_voxels(body, room, spacing, radius);
  const unsigned char* const added = mask->GetBufferPointer();

  const std::vector<std::int32_t> label = labels_of(image, body, room);
  const std::vector<Step> steps = steps_within(radius, spacing, room);
  ClosedImage result;
  result.image = image;
  result.image.run.clear();
  result.image.row_offset.assign(1, 0);
  std::int64_t count = 0, before = 0;
  for (const auto& [begin, end] : body.stretch) before += end - begin;
  const auto is_chosen = [&](std::int32_t value) {
    return value != 0 && (labels.empty() || std::find(labels.begin(), labels.end(), value) != labels.end());
  };
  std::vector<std::int32_t> row(static_cast<std::size_t>(image.size[0]));
  // Nothing is added outside of the body's box.
  const Index begin = std::max<Index>(body.first[0], 0),
              end = std::min(body.first[0] + body.size[0], image.size[0]);
  for (Index k = 0; k < image.size[2]; ++k) {
    stop_if_requested();
    for (Index j = 0; j < image.size[1]; ++j) {
      const Index in_j = j - body.first[1], in_k = k - body.first[2];
      const bool in_box = in_j >= 0 && in_j < body.size[1] && in_k >= 0 && in_k < body.size[2];
      const auto place = [&](Index i) {
        return room.at(i - room.first[0], j - room.first[1], k - room.first[2]);
      };
      if (!in_box || std::none_of(added + place(begin), added + place(end), [](auto a) { return a != 0; })) {
        const auto runs = image.row(j, k);
        result.image.run.insert(result.image.run.end(), runs.begin(), runs.end());
        result.image.row_offset.push_back(result.image.run.size());
        continue;
      }
      std::fill(row.begin(), row.end(), 0);
      for (const Run& run : image.row(j, k))
        std::fill(row.begin() + run.begin, row.begin() + run.end, run.label);
      for (Index i = begin; i < end; ++i)
        if (auto& here = row[static_cast<std::size_t>(i)]; added[place(i)] != 0 && !is_chosen(here)) {
          here = nearest_label(label, place(i), steps);
          ++count;
        }
      append_row(result.image, row);
    }
  }
  result.added_mm3 = image.voxel_volume() * static_cast<double>(count);
  result.body_mm3 = image.voxel_volume() * static_cast<double>(before);
  return result;
}

}  // namespace dimple
