#pragma once

#include <vector>

#include "preprocess/model.hpp"

namespace dimple {

/// Fills model.patches: one patch for about `nodes_per_patch` nodes' worth of tissue.
///
/// The points are halved into groups of equal worth (worth: volume / spacing^3), the groups' centroids evened
/// by a few sweeps of Lloyd's iteration, and each point shared among the patches around it by Shepard
/// functions
///
///     psi_b(x) = w(|x - x_b| / R_b) / sum_c w(|x - x_c| / R_c),   R_b = 1.3 patch spacings, w the quartic
///     spline.
///
/// Why: at nu near 1/2 a volume constraint at every point is more than the nodes can satisfy (the body
/// locks). A coarser space of overlapping patches satisfies the inf-sup condition in practice; see
/// solver/README.md. `folded`: something lies between points of the body that are near each other; a patch
/// then holds only points that nodes connect, and each bank of a gap has its own. A step of make_model(),
/// after find_supports(). A patch lies in one tissue.
void make_pressure_patches(Model& model, bool folded = false, double nodes_per_patch = 7.0);

/// After a cut: a patch of which points that share no node any more are parts of its own. `whole` [Q]: the
/// point before that each is a part of, whose shares it has; `changed`: the points with other nodes than
/// before. Parts of less than a quarter of a patch go to the patches that overlap them there. Returns the
/// patch before that each is a part of. model.patches are those before; supports are those of now.
std::vector<Index> divide_patches(Model& model, const std::vector<Index>& whole,
                                  const std::vector<Index>& changed);

}  // namespace dimple
