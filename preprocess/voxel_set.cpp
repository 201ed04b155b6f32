#include "preprocess/voxel_set.hpp"

#include <algorithm>
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
    stop_if_asked();
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

VoxelSet complement(const VoxelSet& set) {
  VoxelSet rest{.first = set.first, .size = set.size, .stretch = {}, .offset = {0}};
  const auto length = static_cast<std::int32_t>(set.size[0]);
  for (Index k = 0; k < set.size[2]; ++k)
    for (Index j = 0; j < set.size[1]; ++j) {
      std::int32_t begin = 0;
      for (const auto& s : set.row(j, k)) {
        if (s.begin > begin) rest.stretch.push_back({begin, s.begin});
        begin = s.end;
      }
      if (begin < length) rest.stretch.push_back({begin, length});
      rest.offset.push_back(rest.stretch.size());
    }
  return rest;
}

Pieces face_connected(const VoxelSet& set) {
  // A forest over stretches; of two that touch, the root of the later hangs on that of the earlier.
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
    stop_if_asked();
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
