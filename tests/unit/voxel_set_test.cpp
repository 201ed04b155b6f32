#include "preprocess/image/voxel_set.hpp"

#include <gtest/gtest.h>

#include <functional>

#include "tests/helpers/image.hpp"

namespace dimple {
namespace {

using Inside = std::function<bool(Index i, Index j, Index k)>;
constexpr std::array<Index, 3> size = {14, 11, 9};

VoxelSet set_of(const std::array<Index, 3>& n, const Inside& inside) {
  return voxels_with(image_of(n, Vec3::Ones(), inside), {});
}

// A body lopsided along every axis, most of all along k.
bool organ(Index i, Index j, Index k) {
  return k >= 1 && k < 8 && i >= 1 && i < 13 - 2 * (k / 2) && j >= 2 && j < 9 - k / 2 && (i < 9 || j < 6);
}

bool contains(const VoxelSet& set, Index i, Index j, Index k) {
  for (const auto& [begin, end] : set.row(j - set.first[1], k - set.first[2]))
    if (i - set.first[0] >= begin && i - set.first[0] < end) return true;
  return false;
}

void expect_same(const VoxelSet& a, const VoxelSet& b) {
  EXPECT_EQ(a.size, b.size);
  EXPECT_EQ(a.offset, b.offset);
  ASSERT_EQ(a.stretch.size(), b.stretch.size());
  for (std::size_t s = 0; s < a.stretch.size(); ++s) {
    EXPECT_EQ(a.stretch[s].begin, b.stretch[s].begin);
    EXPECT_EQ(a.stretch[s].end, b.stretch[s].end);
  }
}

std::vector<AxisOrder> all_turns() {
  std::vector<AxisOrder> turns;
  for (const std::array<int, 3>& axis :
       {std::array<int, 3>{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}})
    for (int flips = 0; flips < 8; ++flips) {
      const AxisOrder order{axis, {(flips & 1) != 0, (flips & 2) != 0, (flips & 4) != 0}};
      const bool odd = (axis[0] + 1) % 3 != axis[1];
      if (odd == ((flips == 1) || (flips == 2) || (flips == 4) || (flips == 7))) turns.push_back(order);
    }
  return turns;
}

TEST(VoxelSet, CountedInAnotherOrderHoldsTheSameVoxels) {
  const VoxelSet set = set_of(size, organ);
  ASSERT_EQ(all_turns().size(), 24u);
  for (const AxisOrder& order : all_turns()) {
    const VoxelSet turned = reordered(set, order, size);
    Index count = 0;
    std::array<Index, 3> at{}, old{};
    for (at[2] = turned.first[2]; at[2] < turned.first[2] + turned.size[2]; ++at[2])
      for (at[1] = turned.first[1]; at[1] < turned.first[1] + turned.size[1]; ++at[1])
        for (at[0] = turned.first[0]; at[0] < turned.first[0] + turned.size[0]; ++at[0]) {
          for (std::size_t d = 0; d < 3; ++d) {
            const auto axis = static_cast<std::size_t>(order.axis[d]);
            old[axis] = order.reversed[d] ? size[axis] - 1 - at[d] : at[d];
          }
          const bool in = contains(turned, at[0], at[1], at[2]);
          count += in;
          ASSERT_EQ(in, contains(set, old[0], old[1], old[2]));
        }
    Index all = 0;
    for (const auto& [begin, end] : set.stretch) all += end - begin;
    EXPECT_EQ(count, all);
  }
}

TEST(VoxelSet, CroppedHasTheBoxOfItsOwnVoxelsWhateverWasThereBefore) {
  const auto body = [](Index i, Index j, Index k) { return organ(i, j, k) && i > 3 && j < 6 && k > 2; };
  const VoxelSet all = set_of(size, [&](Index i, Index j, Index k) {
    return body(i, j, k) || i + j + k == 0 || i + j + k == size[0] + size[1] + size[2] - 3;
  });
  const Pieces pieces = face_connected(all);
  ASSERT_EQ(pieces.piece.size(), 3u);
  const VoxelSet requested = set_of(size, body), part = cropped(selection(all, pieces, {false, true, false}));
  EXPECT_NE(all.size, requested.size);
  for (const VoxelSet& same : {part, cropped(requested)}) {
    EXPECT_EQ(same.first, requested.first);
    expect_same(same, requested);
  }
}

// For any axes of the scanner, the organ's own order gives one set of voxels.
TEST(VoxelSet, InItsOwnOrderIsTheSameHoweverItWasTurned) {
  const Vec3 spacing(1.0, 1.5, 2.0);
  const VoxelSet set = set_of(size, organ), own = reordered(set, own_order(set, spacing), size);
  for (const AxisOrder& order : all_turns()) {
    const VoxelSet turned = reordered(set, order, size);
    std::array<Index, 3> turned_size{};
    Vec3 turned_spacing;
    for (std::size_t d = 0; d < 3; ++d) {
      turned_size[d] = size[static_cast<std::size_t>(order.axis[d])];
      turned_spacing[static_cast<Index>(d)] = spacing[order.axis[d]];
    }
    const VoxelSet again = reordered(turned, own_order(turned, turned_spacing), turned_size);
    expect_same(again, own);
  }
}

TEST(VoxelSet, OfADomeOnItsBaseStaysAsItIsAndOfABlockToo) {
  const VoxelSet dome = set_of({24, 24, 14}, [](Index i, Index j, Index k) {
    const Vec3 x(static_cast<double>(i) - 11.5, (static_cast<double>(j) - 11.5) * 0.9,
                 static_cast<double>(k) - 1.0);
    return k >= 1 && x.norm() < 10.0;
  });
  EXPECT_EQ(own_order(dome, Vec3::Ones()), AxisOrder{});
  const VoxelSet block = set_of({12, 12, 8}, [](Index i, Index j, Index k) {
    return i > 0 && i < 11 && j > 0 && j < 11 && k > 0 && k < 7;
  });
  EXPECT_EQ(own_order(block, Vec3::Ones()), AxisOrder{});
}

}  // namespace
}  // namespace dimple
