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

/// A coarser space for the change of volume: overlapping patches with weights at the points around.
/// Each patch is in one tissue.
struct PressurePatches {
  CompressedRows of_point;  ///< row q: the patches that point q belongs to
  Eigen::VectorXd psi;      ///< partition of unity: its weight in each; they sum to 1 at every point
  Eigen::VectorXd volume;   ///< [patches] sum of psi V [m^3]
  Index count() const { return volume.size(); }
};

/// Contribution to |F|^2 that the mean gradient of a cell leaves out, for all cells of one tissue:
///
///     sum over cells of V (mean(|F|^2) - |mean(F)|^2) = sum_ab K_ab u_a . u_b
struct GradientVariance {
  int tissue = 0;
  CompressedRows rows;  ///< row a: the nodes with a cell in common with a, and a itself
  Eigen::VectorXd K;    ///< [rows.member] [m]; symmetric, zero for linear fields
};

/// Contact patch of a rigid, flat-ended, cylindrical tool on the body.
struct ToolPlace {
  Vec3 centre = Vec3::Zero();      ///< of its contact patch, on the body's surface [m]
  Vec3 approach = -Vec3::UnitZ();  ///< unit vector: its direction of motion
  double radius = 5e-3;            ///< [m]
};

/// The body's boundary as triangles, as the image has it.
struct Surface {
  Points vertex_mm;  ///< [3xV] LPS mm, bit for bit as in files
  Triangles triangles;
  std::vector<char> cut_face = {};  ///< [T] 1: on a face of a cut; empty: there is none
  bool empty() const { return triangles.cols() == 0; }
  bool is_cut_face(Index t) const { return !cut_face.empty() && cut_face[static_cast<std::size_t>(t)] != 0; }
};

/// Nodes and integration points with what they represent, and the nodes that are held: the content of a model
/// folder, which other programs can make too. SI units except for the surface; positions are LPS, in metres.
struct Discretisation {
  Points X;                      ///< [3xN] nodes at rest
  Eigen::VectorXd spacing;       ///< [N] node spacing requested there
  Points point;                  ///< [3xQ] integration points
  Eigen::VectorXd volume;        ///< [Q] of the tissue that each point represents
  SecondMoments second_moments;  ///< [6xQ] mean of (x - point)(x - point)^T over each cell [m^2]; empty: none
  Eigen::VectorXi label;         ///< [Q] of the image at each point
  std::vector<Index> base;       ///< nodes held fixed, ascending
  std::vector<Index> bonded_patch;  ///< nodes of the contact patch, ascending
  ToolPlace tool;
  Mat3 axes =
      Mat3::Identity();  ///< columns: the image's axes, along which all direction-dependent steps work
  Surface surface;       ///< may be empty

  Index node_count() const { return X.cols(); }
  Index point_count() const { return point.cols(); }
};

/// Report on the search for supports: printed, and kept in summary.json.
struct SupportReport {
  Index unseen = 0;  ///< pairs of a node and a point within reach that the body's surface separates
  std::vector<Index> unconnected;  ///< points that see too few nodes: the nearest were used; ascending
  Index grown = 0;                 ///< points with a support that was enlarged to condition the moment matrix
  double largest_growth = 1.0;     ///< largest factor
  Index fewest = 0, most = 0;      ///< nodes in a support
  double mean = 0.0;
  double worst_pivot_ratio = 1.0;
  Index fewest_at = -1, worst_pivot_at = -1;  ///< points
  double linear_error = 0.0;  ///< largest error in reproducing a constant or linear field's gradient
};

/// Error of the gradients in the divergence theorem before and after make_consistent().
struct ConsistencyReport {
  double before = 0.0,
         after = 0.0;           ///< largest |sum_q V_q dphi_qa - integral phi_a n dS| / sum_q V_q |dphi_qa|
  double largest_change = 0.0;  ///< of a gradient / the largest gradient of its cell
  int iterations = 0;
};

class Sight;

/// All constant data of a run, as make_model() or build_model() returns them.
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
  /// Visibility of its nodes; null where nothing is hidden. Needed to evaluate the field between nodes.
  std::shared_ptr<const Sight> sight;
};

/// Transpose of a list: row r holds the rows of `rows` that hold r, ascending; for a support, each node's
/// influence. `slot`, if given, receives the index in rows.member that each member of the result came from.
CompressedRows transpose(const CompressedRows& rows, Index columns, Eigen::VectorXi* slot = nullptr);

}  // namespace dimple
