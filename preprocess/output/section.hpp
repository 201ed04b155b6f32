#pragma once

#include "preprocess/model.hpp"

namespace dimple {

/// A body cut open at rest along a plane, the cut face filled with triangles: for pictures of its inside.
/// Lengths in mm, LPS.
struct Section {
  Points place;         ///< [3xN]
  Triangles triangles;  ///< anticlockwise as seen from the front
  Vec3 front;           ///< unit normal of the plane, towards the half that is removed
};

/// Section along the tool's axis and the body's longest direction across it. Triangles are an eighth of the
/// patch's radius wide near the patch and an eightieth of the body far from it. The outline is exact on the
/// lattice's lines: corners are cut off within a triangle. Empty: no surface, or its plane misses it.
///
/// No library: VTK's clip of a lattice needs a signed distance at each place, which costs more than all of
/// this. CGAL's Mesh_2 does not promise the same triangles on each machine.
Section cut_open(const Discretisation& body);

/// Values of integration points as means over the eight nearest to a place, with weights that fall to zero at
/// the ninth. Points whose value is not a number do not count; where none counts the mean is not a number.
/// Tissues are not distinguished.
struct PointMeans {
  Eigen::MatrixXi point;   ///< [8xM], or as many as there are
  Eigen::MatrixXd weight;  ///< [8xM]
  Eigen::RowVectorXd operator()(const Eigen::RowVectorXd& of_points) const;
};
PointMeans make_point_means(const Points& point, const Points& places);

}  // namespace dimple
