#pragma once

#include <array>
#include <vector>

#include "preprocess/scene/boundary_conditions.hpp"

namespace dimple {

/// Refinement of nodes where the load passes through less tissue than in a half-space: a neck, a thin layer,
/// tissue above a base. Strains of a spreading load fall as 1 / R^2, and the spacing may grow with R. A
/// scalar field that spreads alike shows where tissue confines the load. A method of this project.
/// 1. Cubic cells, about 15,000 in the body; neighbours conduct if tissue connects their centres.
/// 2. Solve div grad phi = 0: unit flux in through the contact patch, phi = 0 on the base, no flux elsewhere.
/// 3. g = |flux| in a cell. Half-space: g0 = 1 / (2 pi R^2 + pi a^2), R from the patch's centre, a its
///    radius.
/// 4. f = max(1, min(30, g / g0))^(-exponent), and 1 near the patch. Minimising the sum of the errors h^2
///    |grad grad u|^2 for a number of nodes, the integral of h^-3, gives h ~ |grad grad u|^(-2/5): exponent
///    0.4.
/// 5. The slope of f along each axis is limited.
class LoadPath {
 public:
  LoadPath() = default;  ///< 1 everywhere
  /// `patch_edge`: places on the edge of the patch; `exponent`: 0.4 as derived; `slope`: largest change of
  /// the result along each axis of the body [1/mm].
  LoadPath(const BodySurface& body, const Boundary& boundary, const Points& patch_edge, double exponent,
           double slope);
  double operator()(const Vec3& x) const;  ///< (0, 1], linear between the lattice's points
  double slope() const { return slope_; }

 private:
  std::array<Index, 3> n_{};
  Vec3 origin_ = Vec3::Zero();
  double edge_ = 0.0, slope_ = 0.0;
  std::vector<double> finer_;
};

}  // namespace dimple
