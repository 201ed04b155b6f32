#pragma once

#include <cstdint>

#include "preprocess/model.hpp"

namespace dimple {

/// Layouts of the hot loops. Four nodes of a point, their gradients and twice their numbers (in single
/// precision a line of the cache, and eight times what it holds is the node's place in bytes); a matrix at
/// each of eight points; three columns, padded; a weighted member.
template <class Real>
struct alignas(sizeof(Real) == 4 ? 64 : 8) ProjectedQuad {
  Real d[4][3];
  std::uint16_t twice[4];
};
template <class Real>
struct alignas(32) ProjectedOctet {
  Real column[3][3][8];
};
template <class Real>
struct alignas(4 * sizeof(Real)) ProjectedColumns {
  Real column[3][4];
};
template <class Real>
struct ProjectedFraction {
  std::int32_t number;
  Real weight;
};

/// The loops over the points [first, last) of one block, or over its octets; Real is float or double. Lists
/// of members begin at offset[k] and end at offset[k + 1].
template <class Real>
struct ProjectedLoops {
  using Quad = ProjectedQuad<Real>;
  using Octet = ProjectedOctet<Real>;
  using Columns = ProjectedColumns<Real>;
  using Fraction = ProjectedFraction<Real>;

  /// F - I and J - 1 of each point, `first` a multiple of eight; the last octet is filled up with zeros.
  static void gradients(const Quad* quad, const std::int32_t* offset, const Real* u, Octet* gradient,
                        Real* dilation, Index first, Index last);

  /// V P of neo-Hookean points, into `stress` from its beginning; `pressure` [Q] is the coefficient of cof F
  /// apart from that of W_dist, which is multiplied by `fraction`: 0 for the paper's printed stress. Below
  /// `least_J` powers of J are Taylor polynomials.
  static void neo_hookean_stresses(const Octet* gradient, const Real* dilation, const Real* pressure,
                                   const Real* mu, const Real* volume, Columns* stress, Index first,
                                   Index last, Real least_J, Real fraction);

  /// Adds to the forces f at the nodes; `stress` begins with that of point `first`.
  static void scatter(const Quad* quad, const std::int32_t* offset, const Columns* stress, Real* f,
                      Index first, Index last);

  /// Adds `scale` times the weighted sums of u over each node's members to f [4xN]; of nodes [first, last).
  static void variance_forces(const Fraction* fraction, const std::int32_t* offset, const Real* u,
                              double scale, double* f, Index first, Index last);

  /// Eight consecutive points have most of their patches in common: one list serves them. The first computes
  /// the mean over each point's patches; the second adds `value` x volume x weight to each patch, in eight
  /// sums.
  static void means_of_patches(const std::int32_t* number, const Real* weight, const std::int32_t* offset,
                               const Real* patch, Real* mean, Index first, Index last);
  static void spread_to_patches(const std::int32_t* number, const Real* weight, const std::int32_t* offset,
                                const Real* value, const Real* volume, Real* patch, Index first, Index last);

  /// Smallest J - 1 in each of eight lanes; true if all values are finite.
  static bool least_dilations(const Real* dilation, Real* least, Index first, Index last);
};

}  // namespace dimple
