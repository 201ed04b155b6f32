#include "preprocess/image/change_image.hpp"

#include <algorithm>
#include <array>
#include <limits>

namespace dimple {

// ITK's filters that shrink an image use one voxel of several or their mean; none uses a majority of labels.
LabelImage in_double_voxels(const LabelImage& image) {
  LabelImage result = image;
  for (std::size_t d = 0; d < 3; ++d) {
    result.size[d] = (image.size[d] + 1) / 2;
    result.stored_size[d] = (image.stored_size[d] + 1) / 2;
  }
  result.stored_spacing *= 2.0;
  result.to_world = image.to_world * Eigen::Translation3d(Vec3::Constant(0.5)) * Eigen::Scaling(2.0);
  result.run.clear();
  result.row_offset.clear();
  std::vector<std::int32_t> fine(static_cast<std::size_t>(4 * 2 * result.size[0])),
      row(static_cast<std::size_t>(result.size[0]));
  const auto width = static_cast<std::size_t>(2 * result.size[0]);
  for (Index k = 0; k < result.size[2]; ++k)
    for (Index j = 0; j < result.size[1]; ++j) {
      std::fill(fine.begin(), fine.end(), 0);
      for (std::size_t n = 0; n < 4; ++n) {
        const Index fine_j = 2 * j + static_cast<Index>(n % 2), fine_k = 2 * k + static_cast<Index>(n / 2);
        if (fine_j >= image.size[1] || fine_k >= image.size[2]) continue;
        for (const Run& r : image.row(fine_j, fine_k))
          std::fill(fine.begin() + static_cast<std::ptrdiff_t>(n * width) + r.begin,
                    fine.begin() + static_cast<std::ptrdiff_t>(n * width) + r.end, r.label);
      }
      for (std::size_t i = 0; i < row.size(); ++i) {
        std::array<std::int32_t, 8> votes{};
        for (std::size_t n = 0; n < 8; ++n) votes[n] = fine[(n / 2) * width + 2 * i + n % 2];
        std::sort(votes.begin(), votes.end());
        int most = 0;
        row[i] = 0;
        const auto empty = std::count(votes.begin(), votes.end(), 0);
        const bool even = (static_cast<Index>(i) + j + k) % 2 == 0;
        if (empty < 4 || (empty == 4 && even))
          for (const std::int32_t label : votes)
            if (const auto count = static_cast<int>(std::count(votes.begin(), votes.end(), label));
                label != 0 && (count > most || (count == most && !even)))
              row[i] = label, most = count;
      }
      append_row(result, row);
    }
  return result;
}

LabelImage without_far_tissue(const LabelImage& image, const Vec3& place_mm, const Vec3& direction,
                              double radius_mm) {
  LabelImage result = image;
  result.run.clear();
  result.row_offset.clear();
  std::vector<std::int32_t> row(static_cast<std::size_t>(image.size[0]));
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j) {
      std::fill(row.begin(), row.end(), 0);
      for (const Run& r : image.row(j, k))
        for (std::int32_t i = r.begin; i < r.end; ++i) {
          const Vec3 d = image.to_world * Vec3(i, static_cast<double>(j), static_cast<double>(k)) - place_mm;
          if ((d - d.dot(direction) * direction).norm() <= radius_mm)
            row[static_cast<std::size_t>(i)] = r.label;
        }
      append_row(result, row);
    }
  return result;
}

double reach_of(const LabelImage& image, const std::vector<int>& labels, const Vec3& direction) {
  double reach = -std::numeric_limits<double>::infinity();
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j)
      for (const Run& r : image.row(j, k)) {
        if (!labels.empty() && std::find(labels.begin(), labels.end(), r.label) == labels.end()) continue;
        for (const std::int32_t i : {r.begin, r.end - 1})
          reach = std::max(
              reach, direction.dot(image.to_world * Vec3(i, static_cast<double>(j), static_cast<double>(k))));
      }
  return reach;
}

}  // namespace dimple
