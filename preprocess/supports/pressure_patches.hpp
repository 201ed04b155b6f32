#pragma once

#include <vector>

#include "preprocess/model.hpp"

namespace dimple {

/// Fills model.patches: one patch for about `nodes_per_patch` nodes' worth of tissue. Each patch is in one
/// tissue.
///
/// 1. Point q: h_q = mean spacing of its nodes; worth_q = V_q / h_q^3, in proportion to nodes.
/// 2. Halve the points of each tissue recursively, across the longest side, into groups of equal worth.
/// 3. Centroids x_b of the groups, weighted by worth; four sweeps of Lloyd's iteration.
/// 4. Radius R_b = 1.3 (worth per patch)^(1/3) h_b, h_b the mean of h_q in the group.
/// 5. Shepard functions psi_b(x) = w(|x - x_b| / R_b) / sum_c w(|x - x_c| / R_c), w the quartic spline; all R
///    grow by steps of 10 % at points that meet fewer than two patches.
/// 6. If `folded` (near points of the body are separated): groups are divided into parts with common nodes. A
///    point then belongs only to patches with whose middle point it has a node in common.
///
/// Reason: with nu near 1/2, a volume constraint at every point exceeds the nodes' freedom (volumetric
/// locking). A coarser space of overlapping patches satisfies the inf-sup condition in practice; see
/// solver/README.md. A step of make_model(), after find_supports().
void make_pressure_patches(Model& model, bool folded = false, double nodes_per_patch = 7.0);

/// Divides patches after a cut: parts of a patch whose points have no node in common become patches of their
/// own. Parts of less than a quarter of a patch go to the patches that overlap them. `whole` [Q]: the point
/// before that each is a part of, with its weights; `changed`: the points with other nodes than before.
/// Returns the patch before that each is a part of. Needs model.patches of before and the new supports.
std::vector<Index> divide_patches(Model& model, const std::vector<Index>& whole,
                                  const std::vector<Index>& changed);

}  // namespace dimple
