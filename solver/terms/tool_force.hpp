#pragma once

#include "solver/constraints.hpp"

namespace dimple {

/// Force of the tissue on the tool in LPS [N], then its moment [N m] about the tool's reference point: the
/// centre of the bonded patch at rest, moved along with the tool.
using Wrench = Eigen::Matrix<double, 6, 1>;

/// Sum of the holding forces on the tool's nodes, with the opposite sign. `u` [4xN] m: displacements; `f`
/// [4xN] N: internal force; `reference` [m]: the point. Nodes that slide across the press direction count
/// along it only.
Wrench wrench_on_tool(const Model& model, const Constraints& constraints, const Nodal& u, const Nodal& f,
                      const Vec3& reference);

/// Sum of the internal forces of some nodes along the press direction [N].
double along_approach(const Model& model, const std::vector<Index>& nodes, const Nodal& f);

/// Component of a force across the press direction, over its size; 0 without a force.
double lateral_fraction(const Wrench& on_tool, const Vec3& approach);

}  // namespace dimple
