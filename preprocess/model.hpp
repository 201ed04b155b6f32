#pragma once

#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Lists of numbers packed end to end: row r holds member[offset[r]] ... member[offset[r + 1] - 1],
/// ascending.
struct CompressedRows {
  Eigen::VectorXi offset;  ///< [rows + 1]
  Eigen::VectorXi member;  ///< [offset[rows]]
  Index rows() const { return offset.size() - 1; }
  Index count(Index row) const { return offset[row + 1] - offset[row]; }
};

/// Where the rigid, flat-ended, cylindrical tool touches the body.
struct Indenter {
  Vec3 centre = Vec3::Zero();  ///< of its circle, on the body's surface [m]
  Vec3 push = -Vec3::UnitZ();  ///< unit vector: the way it moves
  double radius = 5e-3;        ///< [m]
};

/// Everything that stays fixed during a run. SI units; positions are LPS, in metres.
struct Model {
  Points X;                     ///< [3xN] nodes at rest
  Eigen::VectorXd spacing;      ///< [N] distance to the next nodes that the cloud aimed at there
  Points point;                 ///< [3xQ] integration points
  Eigen::VectorXd volume;       ///< [Q] of the tissue that each point stands for
  std::vector<Index> base;      ///< nodes held fixed, ascending
  std::vector<Index> indenter;  ///< nodes of the circle, ascending
  Indenter tool;

  CompressedRows support;  ///< row q: the nodes that point q sees
  Points dphi;             ///< [3 x support.member] gradient of each such node's shape function at q [1/m]
  Eigen::VectorXd mass;    ///< [N] kg

  Index node_count() const { return X.cols(); }
  Index point_count() const { return point.cols(); }
};

/// Row r of the result lists the rows of `rows` that hold r, ascending: for a support, each node's influence.
/// `slot`, if given, receives the place in rows.member that each member of the result came from.
CompressedRows transpose(const CompressedRows& rows, Index columns, Eigen::VectorXi* slot = nullptr);

}  // namespace dimple
