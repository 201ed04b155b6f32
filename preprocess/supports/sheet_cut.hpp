#pragma once

#include <memory>
#include <vector>

#include "preprocess/supports/interpolation.hpp"
#include "preprocess/surface/sheet.hpp"

namespace dimple {

/// A model that a sheet has cut while its nodes stay where they are: what live cuts are made of.
struct SheetCut {
  Model model;
  Interpolation added;  ///< of the nodes behind those that were there, in the field of the model before
  /// [patches] the patch of the model before that each is a part of.
  std::vector<Index> of_patch;
  Index divided = 0;  ///< cells that the sheet passes through, now two each
  Index changed = 0;  ///< points with other nodes than before, the new ones among them
  double area = 0.0;  ///< of the sheet's triangles whose middles lie in cells [m^2]
};

/// Displacements u [3xN] m of the model before, of all nodes of the cut one.
Points carried(const SheetCut& cut, const Points& u);

/// Where a cut looks for what changes: the same result, bit for bit.
enum class Looked {
  near_sheet,  ///< only there: in a time that grows with the sheet, but for packed lists that are copied
               ///< whole
  everywhere   ///< at every point and node
};

/// Puts a sheet at rest [m, LPS] between a model's nodes.
///
/// No node belongs to a point that it sees through the sheet alone. A cell that the sheet passes through is
/// two, each with its own volume, middle and second moments, if the smaller part is at least an eighth of it;
/// second parts stand behind all points. Both banks get nodes, about as far apart as those around, behind all
/// nodes: without them gradients at the banks, from nodes that lie up to a spacing inside, were ten times as
/// large as elsewhere, and of a block no equilibrium was found. Supports, gradients, variance and patches are
/// found again where nodes were lost or won; a patch of which the sheet leaves parts without a common node is
/// as many, but parts of less than a quarter of it, less than two nodes' worth, go to the patches that
/// overlap them. All else keeps its bits: where gradients were made consistent (make_consistent()), they stay
/// so away from the sheet.
///
/// Where it goes along a sheet that has cut the model before, within a quarter of a spacing, it cuts nothing.
///
/// The surface stays that of the body before: the sheet's banks are for whoever draws them. So does the
/// report on supports, but for what is unseen and unconnected.
///
/// `density`: of each tissue [kg/m^3]. `held`: nodes that anything holds. Throws ModelError ("cut"): the
/// sheet changes nothing, or it parts nodes from all that are held; and what find_supports() throws; Stopped.
SheetCut cut_by_sheet(const Model& model, const std::shared_ptr<const Sheet>& sheet,
                      const std::vector<double>& density, const std::vector<Index>& held,
                      Looked looked = Looked::near_sheet);

}  // namespace dimple
