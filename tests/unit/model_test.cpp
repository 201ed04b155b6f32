#include "preprocess/model.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

namespace dimple {
namespace {

using testing::ElementsAre;

CompressedRows rows_of(const std::vector<std::vector<int>>& lists) {
  CompressedRows rows;
  rows.offset = Eigen::VectorXi::Zero(static_cast<Index>(lists.size()) + 1);
  std::vector<int> member;
  for (std::size_t r = 0; r < lists.size(); ++r) {
    member.insert(member.end(), lists[r].begin(), lists[r].end());
    rows.offset[static_cast<Index>(r) + 1] = static_cast<int>(member.size());
  }
  rows.member = Eigen::Map<Eigen::VectorXi>(member.data(), static_cast<Index>(member.size()));
  return rows;
}

TEST(CompressedRows, TransposeListsTheRowsThatHoldEachColumn) {
  Eigen::VectorXi slot;
  const CompressedRows columns = transpose(rows_of({{0, 2}, {}, {2, 3}, {0}}), 5, &slot);
  EXPECT_THAT(columns.offset, ElementsAre(0, 2, 2, 4, 5, 5));
  EXPECT_THAT(columns.member, ElementsAre(0, 3, 0, 2, 2));
  EXPECT_THAT(slot, ElementsAre(0, 4, 1, 2, 3));
}

TEST(CompressedRows, TransposedTwiceAreTheSameAgain) {
  std::mt19937 random(5);
  std::vector<std::vector<int>> lists(40);
  for (auto& list : lists)
    for (int c = 0; c < 30; ++c)
      if (random() % 4 == 0) list.push_back(c);
  const CompressedRows rows = rows_of(lists);
  const CompressedRows again = transpose(transpose(rows, 30), 40);
  EXPECT_EQ(again.offset, rows.offset);
  EXPECT_EQ(again.member, rows.member);
}

TEST(CompressedRows, NothingTransposedIsEmptyColumns) {
  const CompressedRows columns = transpose(rows_of({}), 3);
  EXPECT_EQ(columns.rows(), 3);
  EXPECT_EQ(columns.member.size(), 0);
}

TEST(SecondMoments, AreReadAsTheyAreWrittenInTheOrderOfVtk) {
  Mat3 about;
  about << 1.0, 4.0, 6.0, 4.0, 2.0, 5.0, 6.0, 5.0, 3.0;
  SecondMoments moments(6, 1);
  set_moments(moments, 0, about);
  for (Index k = 0; k < 6; ++k)
    EXPECT_EQ(moments(k, 0), static_cast<double>(k + 1)) << "xx, yy, zz, xy, yz, zx";
  EXPECT_EQ(as_matrix(moments, 0), about);
}

}  // namespace
}  // namespace dimple
