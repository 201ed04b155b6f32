#pragma once

#include <functional>
#include <vector>

#include "io/types.hpp"

namespace dimple {

using Spacing = std::function<double(const Vec3&)>;  ///< [mm] at a place [mm]

/// Reach of a neighbour / a node's own, at most, since spacings differ.
constexpr double far_enough = 1.2;

/// Weighted sample elimination: thins candidates to `count`.
/// 1. Weight of i and j: w_ij = (1 - r_ij / (reach h_ij))^8, h_ij the mean of their spacings; 0 beyond.
/// 2. Crowding of i: sum over j of w_ij, `fixed` nodes included.
/// 3. Remove the candidate of largest crowding (heap), subtract its weights from its neighbours; repeat.
///
/// Source: Yuksel, Sample elimination for generating Poisson disk sample sets, CGF 34 (2015) 25-32. Departs:
/// radii follow the spacing, and fixed nodes crowd but remain. Throws ModelError: a candidate has far too
/// many neighbours; Stopped.
std::vector<Vec3> thin_out(const std::vector<Vec3>& candidates, const std::vector<Vec3>& fixed, Index count,
                           double reach, const Spacing& spacing);

}  // namespace dimple
