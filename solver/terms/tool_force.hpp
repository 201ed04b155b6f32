#pragma once

#include "solver/constraints.hpp"

namespace dimple {

/// What the tissue does to the tool, in LPS: a force [N], then its moment [N m] about the tool's reference
/// point, which is the middle of the circle at rest, moved along with the tool.
using Wrench = Eigen::Matrix<double, 6, 1>;

/// The sum over the tool's nodes of what holds them, turned round. `u` [4xN] m: displacements; `f` [4xN] N:
/// the internal force there; `reference` [m]: the point. Where nodes slide across the push only what holds
/// them along it counts.
Wrench wrench_on_tool(const Model& model, const Constraints& constraints, const Nodal& u, const Nodal& f,
                      const Vec3& reference);

/// The sum of the internal forces of some nodes along the push [N].
double along_push(const Model& model, const std::vector<Index>& nodes, const Nodal& f);

/// The part of a force that is across the push over the whole of it; 0 of no force.
double lateral_share(const Wrench& on_tool, const Vec3& push);

}  // namespace dimple
