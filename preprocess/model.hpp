#pragma once

#include <memory>
#include <string>
#include <vector>

#include "io/types.hpp"
#include "preprocess/scheme.hpp"

namespace dimple {

/// Lists of numbers packed end to end: row r holds member[offset[r]] ... member[offset[r + 1] - 1],
/// ascending.
struct CompressedRows {
  Eigen::VectorXi offset;  ///< [rows + 1]
  Eigen::VectorXi member;  ///< [offset[rows]]
  Index rows() const { return offset.size() - 1; }
  Index count(Index row) const { return offset[row + 1] - offset[row]; }
};

/// Symmetric 3x3 matrices, one a column: xx, yy, zz, xy, yz, zx.
using SecondMoments = Eigen::Matrix<double, 6, Eigen::Dynamic>;

/// Column q as a matrix, and the matrix as column q; and all of them after the rotation R, R S R^T.
Mat3 as_matrix(const SecondMoments& moments, Index q);
void set_moments(SecondMoments& moments, Index q, const Mat3& about);
SecondMoments turned(const SecondMoments& moments, const Mat3& R);

/// A coarser space for the change of volume: overlapping patches, each with a part in the points around it.
/// Each patch lies in one tissue.
struct PressurePatches {
  CompressedRows of_point;  ///< row q: the patches that point q belongs to
  Eigen::VectorXd psi;      ///< [of_point.member] its share in each; they sum to 1 at every point
  Eigen::VectorXd volume;   ///< [patches] sum of psi V [m^3]
  Index count() const { return volume.size(); }
};

/// What the mean gradient of a cell leaves out of |F|^2, for all cells of one tissue:
///
///     sum over cells of V (mean(|F|^2) - |mean(F)|^2) = sum_ab K_ab u_a . u_b
struct GradientVariance {
  int tissue = 0;
  CompressedRows rows;  ///< row a: the nodes that share a cell with a, itself too
  Eigen::VectorXd K;    ///< [rows.member] [m]; symmetric, no linear field has any
};

/// Where the rigid, flat-ended, cylindrical tool touches the body.
struct ToolPlace {
  Vec3 centre = Vec3::Zero();  ///< of its circle, on the body's surface [m]
  Vec3 push = -Vec3::UnitZ();  ///< unit vector: the way it moves
  double radius = 5e-3;        ///< [m]
};

/// The body's boundary as triangles, as the image has it.
struct Surface {
  Points vertex_mm;  ///< [3xV] LPS mm, to the last bit as files have it
  Triangles triangles;
  std::vector<char> cut_face = {};  ///< [T] 1: on the bank of a cut; empty: there is none
  bool empty() const { return triangles.cols() == 0; }
  bool is_cut_face(Index t) const { return !cut_face.empty() && cut_face[static_cast<std::size_t>(t)] != 0; }
};

/// Where nodes and integration points lie, what they stand for, and which nodes are held: what a model folder
/// keeps, and what a program of another's can make. SI units but for the surface; positions are LPS, in
/// metres.
struct Discretisation {
  Points X;                      ///< [3xN] nodes at rest
  Eigen::VectorXd spacing;       ///< [N] distance to the next nodes that the cloud aimed at there
  Points point;                  ///< [3xQ] integration points
  Eigen::VectorXd volume;        ///< [Q] of the tissue that each point stands for
  SecondMoments second_moments;  ///< [6xQ] mean of (x - point)(x - point)^T over each cell [m^2]; empty: none
  Eigen::VectorXi label;         ///< [Q] of the image at each point
  std::vector<Index> base;       ///< nodes held fixed, ascending
  std::vector<Index> circle;     ///< nodes of the circle, ascending
  ToolPlace tool;
  Mat3 axes =
      Mat3::Identity();  ///< columns: the image's axes; what has a direction of its own is made along them
  Surface surface;       ///< may be empty

  Index node_count() const { return X.cols(); }
  Index point_count() const { return point.cols(); }
};

/// What happened while the supports were found: printed, and kept in summary.json.
struct SupportReport {
  Index unseen = 0;  ///< pairs of a node and a point, near enough, that the body's own surface comes between
  std::vector<Index>
      unconnected;              ///< points that see too few nodes: they took those that are near; ascending
  Index grown = 0;              ///< points with a support that was enlarged to condition the moment matrix
  double largest_growth = 1.0;  ///< by which factor at most
  Index fewest = 0, most = 0;   ///< nodes in a support
  double mean = 0.0;
  double worst_pivot_ratio = 1.0;
  Index fewest_at = -1, worst_pivot_at = -1;  ///< points
  double linear_error = 0.0;  ///< largest error in reproducing a constant or linear field's gradient
};

/// How far the gradients were from the divergence theorem, and are: see make_consistent().
struct ConsistencyReport {
  double before = 0.0,
         after = 0.0;           ///< largest |sum_q V_q dphi_qa - integral phi_a n dS| / sum_q V_q |dphi_qa|
  double largest_change = 0.0;  ///< of a gradient, as a part of the largest gradient of its cell
  int iterations = 0;
};

class Sight;

/// Everything that stays fixed during a run, complete as make_model() or build_model() returns it.
struct Model : Discretisation {
  Scheme scheme = converging;
  Eigen::VectorXi tissue;  ///< [Q] number of each point's tissue, from 0

  CompressedRows support;  ///< row q: the nodes that point q sees
  /// [3 x support.member] gradient of each such node's shape function at q, or its mean over q's cell [1/m]
  Points dphi;
  PressurePatches patches;                 ///< empty: the volume is held at every point
  std::vector<GradientVariance> variance;  ///< of each tissue; empty: left out
  Eigen::VectorXd mass;                    ///< [N] kg

  SupportReport support_report;
  ConsistencyReport consistency_report;
  /// What its surface hides, where that is anything: whoever asks for the field between the nodes needs it
  /// again.
  std::shared_ptr<const Sight> sight;
};

/// Row r of the result lists the rows of `rows` that hold r, ascending: for a support, each node's influence.
/// `slot`, if given, receives the place in rows.member that each member of the result came from.
CompressedRows transpose(const CompressedRows& rows, Index columns, Eigen::VectorXi* slot = nullptr);

}  // namespace dimple
