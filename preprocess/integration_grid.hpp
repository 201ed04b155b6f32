#pragma once

#include "preprocess/body_surface.hpp"

namespace dimple {

struct GridOptions {
  Index count = 0;     ///< integration points, about; 0: ratio x nodes
  double ratio = 1.5;  ///< points per node (Horton et al. 2007: 6371 / 4250)
};

/// A regular background grid that does not conform to the body; mm, in the surface's own frame.
struct IntegrationGrid {
  Points point;  ///< [3xQ] centroid of each cell's part inside the body: the cell's centre if it is whole
  Eigen::VectorXd volume;  ///< [Q] of that part [mm^3]
  double cell = 0.0;       ///< edge [mm]
  Index clipped = 0;       ///< cells that the surface cuts
  Index merged = 0;        ///< slivers under a tenth of a cell, given to a neighbour
};

/// Cubic cells, about as many as asked for, clipped at the surface: the sum of their volumes is the body's.
///
/// Clipping is by parallel lines, four by four through each cell, cut where they pass the surface.
/// Source:   Horton et al. 2007, section 2: one point per cell, independent of the nodes.
/// Departs:  a cut cell's point is the centroid of its inner part, and carries only the volume of that part.
/// Throws ModelError if fewer than 8 cells meet the body.
IntegrationGrid make_integration_grid(const BodySurface& body, const GridOptions& options, Index node_count);

}  // namespace dimple
