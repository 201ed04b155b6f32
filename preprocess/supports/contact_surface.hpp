#pragma once

#include <vector>

#include "preprocess/model.hpp"
#include "preprocess/supports/cell_means.hpp"

namespace dimple {

/// The part of a body's surface that a tool may touch, as samples that move with the body: each of the small
/// flat pieces (pieces_of()) that are nearest to one of the nodes, a neighbour's where these have hardly any
/// surface between them.
struct ContactSurface : CellMeans {
  Eigen::VectorXd spacing;  ///< [M] of the nodes there [m]
  /// The pieces themselves, where nothing is enforced: for how far the body's surface comes into the tool.
  Points between;  ///< [3xK] their middles at rest [m]
  Interpolation at_between;
  /// [K] the sample that each piece belongs to, and its share in that one's area; empty: nobody asks.
  Eigen::VectorXi sample_of;
  Eigen::VectorXd share;
  /// [M] the samples around each whose surface faces the same way, itself among them, and their weights: a
  /// hat of two node spacings to each side, for means of pressures.
  CompressedRows around;
  Eigen::VectorXd hat;  ///< [around.member]
  /// The body's surface around that part, which has no samples: the tool must not come there.
  Points beyond;  ///< [3xL] at rest [m]
  Interpolation at_beyond;
  Index count() const { return place.cols(); }
};

/// Fills in `around` and `hat` of what has samples and spacing.
void look_around(ContactSurface& surface);

/// What lies within `reach` [m] of the tool's axis and faces the tool, but for the base. Throws ModelError:
/// the model has no surface, or none of it is there. `way`: how far the tool comes after each of its steps
/// [m]; what its axis passes is then taken too.
ContactSurface contact_surface(const Model& model, double reach, const std::vector<Vec3>& way = {});
/// The same of another tool than the model's.
ContactSurface contact_surface(const Model& model, const ToolPlace& tool, double reach,
                               const std::vector<Vec3>& way = {});

}  // namespace dimple
