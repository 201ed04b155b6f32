#include "preprocess/supports/cell_means.hpp"

#include <set>

namespace dimple {

CellMeans means_of(const std::vector<std::vector<Index>>& cell, const Points& place, const Points& area,
                   const Interpolation& at_piece, Index node_count) {
  const auto count = static_cast<Index>(cell.size());
  CellMeans mean;
  mean.place.setZero(3, count);
  mean.normal.setZero(3, count);
  mean.area.setZero(count);
  CompressedRows& rows = mean.at_place.rows;
  rows.offset = Eigen::VectorXi::Zero(count + 1);
  std::vector<int> member;
  std::vector<double> weight;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(node_count);
  for (Index c = 0; c < count; ++c) {
    std::set<int> seen;
    for (const Index k : cell[static_cast<std::size_t>(c)]) {
      const double A = area.col(k).norm();
      mean.area[c] += A;
      mean.place.col(c) += A * place.col(k);
      mean.normal.col(c) += area.col(k);
      for (int e = at_piece.rows.offset[k]; e < at_piece.rows.offset[k + 1]; ++e) {
        sum[at_piece.rows.member[e]] += A * at_piece.weight[e];
        seen.insert(at_piece.rows.member[e]);
      }
    }
    mean.place.col(c) /= mean.area[c];
    mean.normal.col(c).normalize();
    for (const int a : seen) {
      member.push_back(a);
      weight.push_back(sum[a] / mean.area[c]);
      sum[a] = 0.0;
    }
    rows.offset[c + 1] = static_cast<int>(member.size());
  }
  rows.member = Eigen::Map<Eigen::VectorXi>(member.data(), static_cast<Index>(member.size()));
  mean.at_place.weight = Eigen::Map<Eigen::VectorXd>(weight.data(), static_cast<Index>(weight.size()));
  return mean;
}

}  // namespace dimple
