#pragma once

#include <functional>
#include <vector>

#include "io/types.hpp"

namespace dimple {

using Spacing = std::function<double(const Vec3&)>;  ///< [mm] at a place [mm]

/// How much further than a node's own reach another one's may be, as neighbours' spacings differ.
constexpr double far_enough = 1.2;

/// Weighted sample elimination: removes the most crowded candidate until `count` are left; `fixed` ones only
/// crowd. Two crowd each other within `reach` times the mean of their spacings. Yuksel, Sample elimination
/// for generating Poisson disk sample sets, CGF 34 (2015) 25-32, with exponent 8. Throws ModelError: a
/// candidate has far too many neighbours; Stopped.
std::vector<Vec3> thin_out(const std::vector<Vec3>& candidates, const std::vector<Vec3>& fixed, Index count,
                           double reach, const Spacing& spacing);

}  // namespace dimple
