#pragma once

#include <vector>

#include "preprocess/model.hpp"
#include "preprocess/surface/sheet.hpp"

namespace dimple {

/// Distance of the nodes on both faces of a cut from its sheet [spacings].
constexpr double off_sheet = 1e-3;

/// The nodes and points of a model that a sheet has cut, without its supports.
struct DividedCells {
  Model model;
  std::vector<Index> whole;  ///< [points] the point of the model before that each is a part of
  Index count = 0;           ///< cells that the sheet passes through, now two each
  double area = 0.0;         ///< of the sheet's triangles whose middles are in cells [m^2]
};

/// Divides the cells that a sheet [m, LPS] crosses, and adds nodes on both faces of the cut behind all
/// others, as cut_by_sheet() describes. Throws Stopped.
DividedCells divide_cells(const Model& before, const Sheet& sheet);

}  // namespace dimple
