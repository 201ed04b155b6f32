#pragma once

#include <memory>
#include <vector>

#include "preprocess/supports/interpolation.hpp"
#include "preprocess/surface/sheet.hpp"

namespace dimple {

/// A model that a sheet has cut while its nodes keep their places, for live cuts.
struct SheetCut {
  Model model;
  Interpolation added;  ///< of the nodes behind the former ones, in the field of the model before
  /// [patches] the patch of the model before that each is a part of.
  std::vector<Index> of_patch;
  Index divided = 0;  ///< cells that the sheet passes through, now two each
  Index changed = 0;  ///< points with other nodes than before, new points included
  double area = 0.0;  ///< of the sheet's triangles whose middles are in cells [m^2]
};

/// Displacements u [3xN] m of the model before, extended to all nodes of the cut one.
Points carried(const SheetCut& cut, const Points& u);

/// Region in which a cut searches for changes: the result is the same, bit for bit.
enum class Looked {
  near_sheet,  ///< only there: in a time that grows with the sheet, except for packed lists that are
               ///< copied
  everywhere   ///< at every point and node
};

/// Cuts a model by a sheet at rest [m, LPS], without a new discretisation. A method of this project.
/// 1. Parts of the sheet within a quarter of a spacing of an earlier cut, and parallel to it, are left out.
/// 2. A cell that the sheet crosses becomes two, each with its own volume, middle and second moments. The
///    parts are found by 64 samples of the box with the cell's moments. The cell remains whole if the smaller
///    part is below an eighth. Second parts are behind all points.
/// 3. Both faces get nodes, 0.7 spacings apart, behind all nodes. Without them a block found no equilibrium:
///    gradients at the faces, from nodes up to a spacing inside, were ten times as large as elsewhere.
/// 4. Changed points: their cell is divided, the sheet hides one of their nodes, or a new node reaches them.
///    Their supports and gradients are found again, with sight across the sheet excluded.
/// 5. Variance: the former contributions of changed points are subtracted and the new ones added, exactly.
/// 6. Patches are divided (divide_patches()), masses are computed again.
///
/// All else keeps its bits: away from the sheet, consistent gradients (make_consistent()) remain so. The
/// surface is that of the body before: the faces of the cut are for drawing. So is the report on supports,
/// except for what is unseen and unconnected.
///
/// `density`: of each tissue [kg/m^3]. `held`: nodes held by anything. Throws ModelError ("cut"): the sheet
/// changes nothing, or it separates nodes from all that are held; and what find_supports() throws; Stopped.
SheetCut cut_by_sheet(const Model& model, const std::shared_ptr<const Sheet>& sheet,
                      const std::vector<double>& density, const std::vector<Index>& held,
                      Looked looked = Looked::near_sheet);

}  // namespace dimple
