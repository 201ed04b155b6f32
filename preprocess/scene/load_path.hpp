#pragma once

#include <array>
#include <vector>

#include "preprocess/scene/boundary_conditions.hpp"

namespace dimple {

/// How much finer than beneath a circle on a half-space the nodes must stand, because the load passes through
/// less tissue: a neck, a thin layer, the place above a base.
///
/// Strains of a load that spreads fall with the distance as 1 / R^2, and the spacing may grow with it; what
/// keeps a load together is known from a scalar field that spreads the same way: div grad phi = 0, with a
/// unit flux in through the circle, phi = 0 on the base, and none through the rest of the surface. Its flux g
/// over that of the half-space, 1 / (2 pi R^2 + pi a^2), says how much larger the strains are here, and the
/// least sum of the errors h^2 |grad grad u|^2 for a number of nodes, the integral of h^-3, has h ~ |grad
/// grad u|^(-2/5).
class LoadPath {
 public:
  LoadPath() = default;  ///< 1 everywhere
  /// `rim`: places on the circle's rim; `exponent`: 0.4 as derived; `slope`: along each axis of the body by
  /// how much the result changes at most [1/mm].
  LoadPath(const BodySurface& body, const Boundary& boundary, const Points& rim, double exponent,
           double slope);
  double operator()(const Vec3& x) const;  ///< (0, 1], linear between the lattice's places
  double slope() const { return slope_; }

 private:
  std::array<Index, 3> n_{};
  Vec3 origin_ = Vec3::Zero();
  double edge_ = 0.0, slope_ = 0.0;
  std::vector<double> finer_;
};

}  // namespace dimple
