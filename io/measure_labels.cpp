#include <algorithm>
#include <numeric>
#include <utility>

#include "io/label_image.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

// The voxels of each face-connected piece, at one of its runs, and 0 at the others. By runs instead of ITK's
// ConnectedComponentImageFilter, which needs every voxel and one pass per label.
std::vector<std::int64_t> voxels_of_pieces(const LabelImage& image) {
  // Union-find over runs: the later root of two connected runs gets the earlier one.
  std::vector<std::size_t> parent(image.run.size());
  std::iota(parent.begin(), parent.end(), std::size_t{0});
  const auto root = [&](std::size_t r) {
    while (parent[r] != r) r = parent[r] = parent[parent[r]];  // always to an earlier run: it ends
    return r;
  };
  const auto join = [&](std::span<const Run> row, std::span<const Run> before) {
    for (auto a = row.begin(), b = before.begin(); a != row.end() && b != before.end();) {
      if (a->label == b->label && a->begin < b->end && b->begin < a->end) {
        const std::size_t x = root(static_cast<std::size_t>(&*a - image.run.data())),
                          y = root(static_cast<std::size_t>(&*b - image.run.data()));
        parent[std::max(x, y)] = std::min(x, y);
      }
      a->end < b->end ? ++a : ++b;
    }
  };
  for (Index k = 0; k < image.size[2]; ++k) {
    stop_if_requested();
    for (Index j = 0; j < image.size[1]; ++j) {
      if (j > 0) join(image.row(j, k), image.row(j - 1, k));
      if (k > 0) join(image.row(j, k), image.row(j, k - 1));
    }
  }
  std::vector<std::int64_t> piece(image.run.size(), 0);
  for (std::size_t r = 0; r < image.run.size(); ++r) piece[root(r)] += image.run[r].end - image.run[r].begin;
  return piece;
}

struct Sum {
  std::int64_t voxels = 0;
  Vec3 places = Vec3::Zero();
  bool meets_border = false;
};

std::map<std::int32_t, Sum> sums_of(const LabelImage& image) {
  std::map<std::int32_t, Sum> sums;
  for (Index k = 0; k < image.size[2]; ++k) {
    stop_if_requested();
    for (Index j = 0; j < image.size[1]; ++j) {
      const bool at_border = j == 0 || k == 0 || j == image.size[1] - 1 || k == image.size[2] - 1;
      for (const Run& run : image.row(j, k)) {
        Sum& sum = sums[run.label];
        const double n = run.end - run.begin;
        sum.voxels += run.end - run.begin;
        sum.places +=
            n * Vec3(0.5 * (run.begin + run.end - 1), static_cast<double>(j), static_cast<double>(k));
        sum.meets_border = sum.meets_border || at_border || run.begin == 0 || run.end == image.size[0];
      }
    }
  }
  return sums;
}

}  // namespace

std::vector<LabelMeasure> measure_labels(const LabelImage& image) {
  std::map<std::int32_t, LabelMeasure> measures;
  const std::vector<std::int64_t> piece = voxels_of_pieces(image);
  for (std::size_t r = 0; r < piece.size(); ++r) {
    if (piece[r] == 0) continue;
    LabelMeasure& measure = measures[image.run[r].label];
    ++measure.pieces;
    measure.largest_piece_voxels = std::max(measure.largest_piece_voxels, piece[r]);
  }
  std::map<std::int32_t, Sum> sums = sums_of(image);
  std::vector<LabelMeasure> list;
  for (auto& [label, measure] : measures) {
    const Sum& sum = sums[label];
    measure.value = label;
    if (const auto name = image.names.find(label); name != image.names.end()) measure.name = name->second;
    measure.voxels = sum.voxels;
    measure.volume_mm3 = static_cast<double>(sum.voxels) * image.voxel_volume();
    measure.centre_mm = image.to_world * Vec3(sum.places / static_cast<double>(sum.voxels));
    measure.meets_border = sum.meets_border;
    list.push_back(std::move(measure));
  }
  return list;
}

}  // namespace dimple
