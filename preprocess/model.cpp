#include "preprocess/model.hpp"

namespace dimple {

CompressedRows transpose(const CompressedRows& rows, Index columns, Eigen::VectorXi* slot) {
  CompressedRows result;
  result.offset = Eigen::VectorXi::Zero(columns + 1);
  for (const int column : rows.member) ++result.offset[column + 1];
  for (Index c = 0; c < columns; ++c) result.offset[c + 1] += result.offset[c];

  result.member.resize(rows.member.size());
  if (slot) slot->resize(rows.member.size());
  Eigen::VectorXi next = result.offset.head(columns);
  for (Index r = 0; r < rows.rows(); ++r)
    for (int k = rows.offset[r]; k < rows.offset[r + 1]; ++k) {
      const int place = next[rows.member[k]]++;
      result.member[place] = static_cast<int>(r);
      if (slot) (*slot)[place] = k;
    }
  return result;
}

Mat3 as_matrix(const SecondMoments& moments, Index q) {
  const auto s = moments.col(q);
  Mat3 about;
  about << s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2];
  return about;
}

void set_moments(SecondMoments& moments, Index q, const Mat3& about) {
  moments.col(q) << about(0, 0), about(1, 1), about(2, 2), about(0, 1), about(1, 2), about(2, 0);
}

SecondMoments turned(const SecondMoments& moments, const Mat3& R) {
  SecondMoments result(6, moments.cols());
  for (Index q = 0; q < moments.cols(); ++q)
    set_moments(result, q, R * as_matrix(moments, q) * R.transpose());
  return result;
}

}  // namespace dimple
