#pragma once

#include <vector>

#include "preprocess/supports/interpolation.hpp"

namespace dimple {

/// Samples of a surface, each the mean over some small flat pieces: of their places and of the shape
/// functions there. So a constant pressure has the nodal forces of its integral.
struct CellMeans {
  Points place;            ///< [3xM] at rest [m]
  Eigen::VectorXd area;    ///< [M] of surface that each represents [m^2]
  Points normal;           ///< [3xM] outward unit vectors at rest
  Interpolation at_place;  ///< the shape functions there
};

/// `cell`: the pieces of each sample, in the order of its keys; `place`, `area` [3xK] m, m^2: of the pieces,
/// outward normal x area; `at_piece`: the shape functions there.
CellMeans means_of(const std::vector<std::vector<Index>>& cell, const Points& place, const Points& area,
                   const Interpolation& at_piece, Index node_count);

}  // namespace dimple
