#pragma once

#include "preprocess/cloud/sizing.hpp"
#include "preprocess/model.hpp"

namespace dimple {

struct GridOptions {
  Index count = 0;     ///< integration points, about; 0: ratio x nodes
  double ratio = 1.5;  ///< points per node (Horton et al. 2007: 6371 / 4250)
  PointDensity density = {};
};

/// A background grid that does not conform to the body; mm, in the surface's own frame.
struct IntegrationGrid {
  Points point;  ///< [3xQ] centroid of each cell's part inside the body: the cell's centre if it is whole
  Eigen::VectorXd volume;  ///< [Q] of that part [mm^3]
  /// [6xQ] mean of (x - point)(x - point)^T over that part: xx, yy, zz, xy, yz, zx [mm^2]. Empty: not wanted.
  SecondMoments second_moments;
  Eigen::VectorXi label;  ///< [Q] of the tissue
  double cell = 0.0;      ///< edge of a cell [mm]; of the largest, where they differ
  Index clipped = 0;      ///< cells that the surface cuts
  Index merged = 0;       ///< slivers under a tenth of a cell, given to a neighbour
};

/// What tissue there is at a place; empty where all is one.
using LabelAt = std::function<int(const Vec3&)>;

/// Cubic cells, about as many as asked for, clipped at the surface: the sum of their volumes is the body's.
///
/// Clipping is by parallel lines, four by four through each cell, cut where they pass the surface.
/// Source:   Horton et al. 2007, section 2: one point per cell, independent of the nodes.
/// Departs:  a cut cell's point is the centroid of its inner part, and carries only the volume of that part.
/// Throws ModelError if fewer than 8 cells meet the body.
IntegrationGrid make_integration_grid(const BodySurface& body, const GridOptions& options, Index node_count,
                                      const LabelAt& label_at = {});

/// Box cells that follow the sizing, about five times as many to a node at the rim as far away, where the
/// strain hardly changes: the body's box halved until each cell is small enough, clipped as above, with the
/// spread that gradients are averaged over. A cell in which tissues meet becomes a point for each of them.
IntegrationGrid make_graded_grid(const BodySurface& body, const GridOptions& options, Index node_count,
                                 const Sizing& sizing, double far_spacing, const LabelAt& label_at = {});

}  // namespace dimple
