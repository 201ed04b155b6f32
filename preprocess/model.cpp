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

}  // namespace dimple
