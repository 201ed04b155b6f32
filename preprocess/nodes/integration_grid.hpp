#pragma once

#include "preprocess/model.hpp"
#include "preprocess/nodes/sizing.hpp"

namespace dimple {

struct GridOptions {
  Index count = 0;     ///< integration points, about; 0: ratio x nodes
  double ratio = 1.5;  ///< points per node (Horton et al. 2007: 6371 / 4250)
  PointDensity density = {};
};

/// A background grid that does not conform to the body; mm, in the surface's own frame.
struct IntegrationGrid {
  Points point;            ///< [3xQ] centroid of each cell's part inside the body
  Eigen::VectorXd volume;  ///< [Q] of that part [mm^3]
  /// [6xQ] mean of (x - point)(x - point)^T over that part: xx, yy, zz, xy, yz, zx [mm^2]. Empty: none.
  SecondMoments second_moments;
  Eigen::VectorXi label;  ///< [Q] of the tissue
  double cell = 0.0;      ///< edge of a cell [mm]; of the largest, where they differ
  Index clipped = 0;      ///< cells that the surface cuts
  Index merged = 0;       ///< slivers under a tenth of a cell, given to a neighbour
};

/// Tissue's label at a place; empty if there is only one tissue.
using LabelAt = std::function<int(const Vec3&)>;

/// Even background grid: cubic cells, about as many as requested, clipped at the surface.
/// 1. Edge (V / points)^(1/3); up to five trials match the number of points to 0.5 %. A corner of the grid is
///    at the middle of the body's box.
/// 2. Four by four parallel lines through each cell, clipped at the surface: volume and centroid inside.
/// 3. Slivers below a tenth of a cell are merged into the face neighbour with most tissue.
/// 4. One point per cell: the centroid, with the volume of the inner part. Volumes sum to the body's.
///
/// Source: Horton et al. 2007, section 2: one point per cell, independent of the nodes. Departs: a cut cell's
/// point is the centroid of its inner part, and has the volume of that part only. Throws ModelError if fewer
/// than 8 cells meet the body.
IntegrationGrid make_integration_grid(const BodySurface& body, const GridOptions& options, Index node_count,
                                      const LabelAt& label_at = {});

/// Graded background grid: box cells that follow the sizing s, with moments for averages over them.
/// 1. Cell volume `(h s)^3 / (far + (patch_edge - far)(1 - s))`, times a factor: about five times as many
/// points per
///    node at the patch's edge as far away, where the strain hardly changes.
/// 2. The body's box is bisected until each cell is small enough; up to five trials match the number to 3 %.
/// 3. Cut cells: parallel lines as above, along the axis most normal to the surface; the two sides of a gap
///    become two points.
/// 4. Cells in which tissues meet: 6^3 samples, a point for each tissue.
/// 5. Slivers below a tenth of their cell are merged into the nearest visible cell of the same tissue.
/// 6. Point: centroid, volume, second moments; volumes are scaled to the body's.
///
/// A method of this project; Horton et al. (2007) use the even grid.
IntegrationGrid make_graded_grid(const BodySurface& body, const GridOptions& options, Index node_count,
                                 const Sizing& sizing, double far_spacing, const LabelAt& label_at = {});

}  // namespace dimple
