#pragma once

#include <vector>

#include "preprocess/model.hpp"
#include "preprocess/supports/cell_means.hpp"

namespace dimple {

/// The part of a body's surface that a tool may be in contact with, as samples that move with the body. A
/// sample consists of the small flat pieces (pieces_of()) nearest to one node; a neighbour takes them if they
/// have hardly any area.
struct ContactSurface : CellMeans {
  Eigen::VectorXd spacing;  ///< [M] of the nodes there [m]
  /// The pieces themselves, where nothing is enforced: they measure the penetration of the tool.
  Points between;  ///< [3xK] their middles at rest [m]
  Interpolation at_between;
  /// [K] the sample of each piece, and its fraction of that sample's area; empty: not requested.
  Eigen::VectorXi sample_of;
  Eigen::VectorXd fraction;
  /// [M] the samples around each that face in the same direction, itself included, and their weights: a hat
  /// of two node spacings to each side, for means of pressures.
  CompressedRows around;
  Eigen::VectorXd hat;  ///< [around.member]
  /// The body's surface around that part, without samples: the tool must not come there.
  Points beyond;  ///< [3xL] at rest [m]
  Interpolation at_beyond;
  Index count() const { return place.cols(); }
};

/// Fills in `around` and `hat` from samples and spacing.
void look_around(ContactSurface& surface);

/// Samples of the surface within `reach` [m] of the tool's axis that faces the tool, except the base. `path`:
/// the tool's displacement after each of its steps [m]; the surface along its path is included. Throws
/// ModelError: the model has no surface, or none of it is there.
ContactSurface contact_surface(const Model& model, double reach, const std::vector<Vec3>& path = {});
/// Overload for another tool than the model's.
ContactSurface contact_surface(const Model& model, const ToolPlace& tool, double reach,
                               const std::vector<Vec3>& path = {});

}  // namespace dimple
