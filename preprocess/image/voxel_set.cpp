#include "preprocess/image/voxel_set.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "io/stop.hpp"

namespace dimple {

VoxelSet voxels_with(const LabelImage& image, const std::vector<int>& labels) {
  const auto is_chosen = [&](int value) {
    return labels.empty() ? value != 0 : std::find(labels.begin(), labels.end(), value) != labels.end();
  };
  std::vector<VoxelSet::Stretch> row, all;
  std::vector<std::size_t> count;
  std::array<Index, 3> lower = image.size, upper = {-1, -1, -1};
  for (Index k = 0; k < image.size[2]; ++k) {
    stop_if_requested();
    for (Index j = 0; j < image.size[1]; ++j) {
      row.clear();
      for (const Run& run : image.row(j, k)) {
        if (!is_chosen(run.label)) continue;
        if (!row.empty() && row.back().end == run.begin)
          row.back().end = run.end;
        else
          row.push_back({run.begin, run.end});
      }
      count.push_back(row.size());
      if (row.empty()) continue;
      all.insert(all.end(), row.begin(), row.end());
      lower = {std::min<Index>(lower[0], row.front().begin), std::min(lower[1], j), std::min(lower[2], k)};
      upper = {std::max<Index>(upper[0], row.back().end - 1), std::max(upper[1], j), k};
    }
  }
  VoxelSet set;
  if (all.empty()) return set;
  for (std::size_t d = 0; d < 3; ++d) {
    set.first[d] = lower[d] - 1;
    set.size[d] = upper[d] - lower[d] + 3;
  }
  set.stretch = std::move(all);
  for (auto& [begin, end] : set.stretch) {
    begin -= static_cast<std::int32_t>(set.first[0]);
    end -= static_cast<std::int32_t>(set.first[0]);
  }
  set.offset.assign(1, 0);
  for (Index k = 0; k < set.size[2]; ++k)
    for (Index j = 0; j < set.size[1]; ++j) {
      const bool border = j == 0 || k == 0 || j == set.size[1] - 1 || k == set.size[2] - 1;
      const Index row_of_image = (j + set.first[1]) + image.size[1] * (k + set.first[2]);
      set.offset.push_back(set.offset.back() + (border ? 0 : count[static_cast<std::size_t>(row_of_image)]));
    }
  return set;
}

VoxelSet cropped(const VoxelSet& set) {
  if (set.stretch.empty()) return set;
  std::array<Index, 3> lower = set.size, upper = {-1, -1, -1};
  for (Index k = 0; k < set.size[2]; ++k)
    for (Index j = 0; j < set.size[1]; ++j) {
      const auto row = set.row(j, k);
      if (row.empty()) continue;
      lower = {std::min<Index>(lower[0], row.front().begin), std::min(lower[1], j), std::min(lower[2], k)};
      upper = {std::max<Index>(upper[0], row.back().end - 1), std::max(upper[1], j), k};
    }
  VoxelSet part;
  for (std::size_t d = 0; d < 3; ++d) {
    part.first[d] = set.first[d] + lower[d] - 1;
    part.size[d] = upper[d] - lower[d] + 3;
  }
  const auto before = static_cast<std::int32_t>(lower[0] - 1);
  part.offset = {0};
  for (Index k = lower[2] - 1; k <= upper[2] + 1; ++k)
    for (Index j = lower[1] - 1; j <= upper[1] + 1; ++j) {
      if (j >= lower[1] && j <= upper[1] && k >= lower[2] && k <= upper[2])
        for (const auto& [begin, end] : set.row(j, k)) part.stretch.push_back({begin - before, end - before});
      part.offset.push_back(part.stretch.size());
    }
  return part;
}

VoxelSet complement(const VoxelSet& set) {
  VoxelSet remaining{.first = set.first, .size = set.size, .stretch = {}, .offset = {0}};
  const auto length = static_cast<std::int32_t>(set.size[0]);
  for (Index k = 0; k < set.size[2]; ++k)
    for (Index j = 0; j < set.size[1]; ++j) {
      std::int32_t begin = 0;
      for (const auto& s : set.row(j, k)) {
        if (s.begin > begin) remaining.stretch.push_back({begin, s.begin});
        begin = s.end;
      }
      if (begin < length) remaining.stretch.push_back({begin, length});
      remaining.offset.push_back(remaining.stretch.size());
    }
  return remaining;
}

namespace {

// Variance [voxels^2] and skewness of a set along each axis. A mirror image has exactly the same and exactly
// the opposite: places count from the middle of the box in halves, and their sums are whole numbers.
struct Spreading {
  Vec3 variance, skewness;
};

Spreading spreading_of(const VoxelSet& set) {
  __extension__ using Whole = __int128;
  std::array<std::array<Whole, 3>, 3> sum{};  // sums of the first, second and third power, by axis
  Whole count = 0;
  const auto from_middle = [&](Index at, std::size_t d) {
    return static_cast<Whole>(2 * at - (set.size[d] - 1));
  };
  const auto add = [&](std::size_t d, Whole place, Whole times) {
    sum[d][0] += times * place;
    sum[d][1] += times * place * place;
    sum[d][2] += times * place * place * place;
  };
  // Sums of powers along i over all voxels before one, for differences.
  std::vector<std::array<Whole, 3>> until(static_cast<std::size_t>(set.size[0]) + 1);
  for (Index i = 0; i < set.size[0]; ++i) {
    const Whole x = from_middle(i, 0);
    const auto at = static_cast<std::size_t>(i);
    until[at + 1] = {until[at][0] + x, until[at][1] + x * x, until[at][2] + x * x * x};
  }
  for (Index k = 0; k < set.size[2]; ++k)
    for (Index j = 0; j < set.size[1]; ++j) {
      Whole in_row = 0;
      for (const auto& [begin, end] : set.row(j, k)) {
        in_row += end - begin;
        for (std::size_t power = 0; power < 3; ++power)
          sum[0][power] +=
              until[static_cast<std::size_t>(end)][power] - until[static_cast<std::size_t>(begin)][power];
      }
      count += in_row;
      add(1, from_middle(j, 1), in_row);
      add(2, from_middle(k, 2), in_row);
    }
  Spreading result;
  for (std::size_t d = 0; d < 3; ++d) {
    const auto mean = [&](std::size_t power) {
      return static_cast<double>(sum[d][power - 1]) / static_cast<double>(count);
    };
    const double variance = mean(2) - mean(1) * mean(1);
    const double third = mean(3) - 3.0 * mean(1) * mean(2) + 2.0 * mean(1) * mean(1) * mean(1);
    result.variance[static_cast<Index>(d)] = 0.25 * variance;
    result.skewness[static_cast<Index>(d)] = variance > 0.0 ? third / (variance * std::sqrt(variance)) : 0.0;
  }
  return result;
}

}  // namespace

AxisOrder own_order(const VoxelSet& set, const Vec3& spacing) {
  constexpr double distinct = 1e-9;
  const Spreading of = spreading_of(set);
  const Vec3 length2 = of.variance.cwiseProduct(spacing.cwiseAbs2());
  const auto more = [](double a, double b) { return a > b + distinct * (std::abs(a) + std::abs(b)); };
  const auto skew = [&](int axis) {
    return std::abs(of.skewness[axis]) > distinct ? of.skewness[axis] : 0.0;
  };
  // The last axis remains unless another is better; the same holds between the other two.
  int up = 2;
  for (const int axis : {1, 0})
    if (more(std::abs(skew(axis)), std::abs(skew(up))) ||
        (skew(axis) == 0.0 && skew(up) == 0.0 && more(length2[up], length2[axis])))
      up = axis;
  int along = up == 1 ? 2 : 1, across = up == 0 ? 2 : 0;
  if (more(length2[across], length2[along]) ||
      (!more(length2[along], length2[across]) && more(std::abs(skew(across)), std::abs(skew(along)))))
    std::swap(along, across);
  AxisOrder order{.axis = {across, along, up}, .reversed = {false, skew(along) < 0.0, skew(up) < 0.0}};
  const bool odd = (across + 1) % 3 != along;
  order.reversed[0] = odd != (order.reversed[1] != order.reversed[2]);
  return order;
}

VoxelSet reordered(const VoxelSet& set, const AxisOrder& order, const std::array<Index, 3>& image_size) {
  if (order == AxisOrder{}) return set;
  VoxelSet result;
  std::array<std::size_t, 3> step{};  // of the old axes among the new voxels
  std::size_t voxels = 1;
  for (std::size_t d = 0; d < 3; ++d) {
    const auto old = static_cast<std::size_t>(order.axis[d]);
    result.size[d] = set.size[old];
    result.first[d] = order.reversed[d] ? image_size[old] - set.first[old] - set.size[old] : set.first[old];
    step[old] = voxels;
    voxels *= static_cast<std::size_t>(result.size[d]);
  }
  std::array<bool, 3> reversed{};  // of the old axes
  for (std::size_t d = 0; d < 3; ++d) reversed[static_cast<std::size_t>(order.axis[d])] = order.reversed[d];
  const auto place = [&](std::size_t old, Index at) {
    return step[old] * static_cast<std::size_t>(reversed[old] ? set.size[old] - 1 - at : at);
  };
  std::vector<bool> inside(voxels, false);
  for (Index k = 0; k < set.size[2]; ++k) {
    stop_if_requested();
    for (Index j = 0; j < set.size[1]; ++j)
      for (const auto& [begin, end] : set.row(j, k))
        for (Index i = begin; i < end; ++i) inside[place(0, i) + place(1, j) + place(2, k)] = true;
  }
  result.offset = {0};
  const auto length = static_cast<std::size_t>(result.size[0]);
  for (std::size_t row = 0; row < voxels; row += length) {
    if (row % (length << 12) == 0) stop_if_requested();
    for (std::size_t i = 0; i < length; ++i) {
      if (!inside[row + i]) continue;
      const std::size_t begin = i;
      while (i < length && inside[row + i]) ++i;
      result.stretch.push_back({static_cast<std::int32_t>(begin), static_cast<std::int32_t>(i)});
    }
    result.offset.push_back(result.stretch.size());
  }
  return result;
}

std::size_t largest(const Pieces& pieces) {
  const auto found = std::max_element(pieces.piece.begin(), pieces.piece.end(),
                                      [](const auto& a, const auto& b) { return a.voxels < b.voxels; });
  return static_cast<std::size_t>(found - pieces.piece.begin());
}

Pieces face_connected(const VoxelSet& set) {
  // Union-find over stretches: the root of the later of two connected ones gets that of the earlier.
  std::vector<std::int32_t> parent(set.stretch.size());
  std::iota(parent.begin(), parent.end(), 0);
  const auto root = [&](std::int32_t s) {
    const auto up = [&](std::int32_t r) -> std::int32_t& { return parent[static_cast<std::size_t>(r)]; };
    while (up(s) != s) s = up(s) = up(up(s));
    return s;
  };
  const auto number = [&](const VoxelSet::Stretch* s) {
    return static_cast<std::int32_t>(s - set.stretch.data());
  };
  const auto join = [&](std::span<const VoxelSet::Stretch> row, std::span<const VoxelSet::Stretch> before) {
    const auto *a = row.data(), *b = before.data();
    while (a != row.data() + row.size() && b != before.data() + before.size()) {
      if (a->begin < b->end && b->begin < a->end) {
        const std::int32_t x = root(number(a)), y = root(number(b));
        parent[static_cast<std::size_t>(std::max(x, y))] = std::min(x, y);
      }
      a->end < b->end ? ++a : ++b;
    }
  };
  for (Index k = 0; k < set.size[2]; ++k) {
    stop_if_requested();
    for (Index j = 0; j < set.size[1]; ++j) {
      if (j > 0) join(set.row(j, k), set.row(j - 1, k));
      if (k > 0) join(set.row(j, k), set.row(j, k - 1));
    }
  }

  Pieces pieces;
  pieces.of_stretch.assign(set.stretch.size(), -1);
  for (Index k = 0; k < set.size[2]; ++k)
    for (Index j = 0; j < set.size[1]; ++j)
      for (const auto& s : set.row(j, k)) {
        const auto here = static_cast<std::size_t>(number(&s));
        const auto r = static_cast<std::size_t>(root(number(&s)));
        if (r == here) {
          pieces.of_stretch[here] = static_cast<std::int32_t>(pieces.piece.size());
          pieces.piece.emplace_back();
        }
        pieces.of_stretch[here] = pieces.of_stretch[r];
        Pieces::Piece& piece = pieces.piece[static_cast<std::size_t>(pieces.of_stretch[here])];
        const double length = s.end - s.begin;
        piece.voxels += s.end - s.begin;
        piece.centre +=
            length * Vec3(0.5 * (s.begin + s.end - 1), static_cast<double>(j), static_cast<double>(k));
      }
  for (auto& piece : pieces.piece) piece.centre /= static_cast<double>(piece.voxels);
  return pieces;
}

VoxelSet selection(const VoxelSet& set, const Pieces& pieces, const std::vector<bool>& kept) {
  VoxelSet part{.first = set.first, .size = set.size, .stretch = {}, .offset = {0}};
  for (std::size_t row = 0; row + 1 < set.offset.size(); ++row) {
    for (std::size_t s = set.offset[row]; s < set.offset[row + 1]; ++s)
      if (kept[static_cast<std::size_t>(pieces.of_stretch[s])]) part.stretch.push_back(set.stretch[s]);
    part.offset.push_back(part.stretch.size());
  }
  return part;
}

}  // namespace dimple
