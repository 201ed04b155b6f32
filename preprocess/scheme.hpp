#pragma once

#include <string_view>

namespace dimple {

/// Dependence of the node spacing on the load. The effect of each number halved and doubled is in
/// tests/verification/README.md.
struct GradingOptions {
  double patch_edge =
      1.0;             ///< spacing at the edge of the contact patch / spacing far away; 1: even everywhere
  double reach = 3.0;  ///< distance from the edge at which the far spacing is reached [radii of the patch]
  bool whole_patch = false;  ///< the spacing of the edge in all of the patch
  double least = 0.0;        ///< lower bound of the spacing at the edge [radii of the patch]
  /// Exponent of the load factor (LoadPath): (flux in the body / in a half-space)^-this. 0: no factor.
  double load_exponent = 0.0;
  double load_slope = 2.0;  ///< largest slope of that factor [per reach]
};

/// Integration points per node, in proportion.
struct PointDensity {
  double patch_edge = 16.0, far = 3.0;
};

/// Size and form of the support domains.
struct SupportOptions {
  double radius_factor = 1.8;  ///< a node's support radius / the node spacing there
  /// Interpolating weights at prescribed nodes: multiplied by (1 + e) / (s^2 + e), s = distance / radius, so
  /// that the field nearly takes their values. e = this; 0: ordinary weights everywhere. Most & Bucher 2005.
  double interpolation = 0.0;
  /// Visibility criterion: a node belongs only to places that it sees through the tissue (sight.hpp). False:
  /// distance alone decides.
  bool through_tissue = false;
};

/// Quadrature of the integral over the body by its nodes and points: every choice in which discretisations
/// differ. No other code depends on a scheme's name.
struct Scheme {
  std::string_view name;  ///< the name that scheme_named() accepts
  /// Gradients are means over each point's cell, whose size follows the nodes. False: gradients at the points
  /// of an even grid.
  bool averaged_gradients;
  /// Gradients are corrected so that the divergence theorem holds for every shape function (make_consistent).
  bool consistent_gradients;
  /// The change of volume is in a coarser space of patches (make_pressure_patches). False: at every point.
  bool pressure_patches;
  /// Nodes are placed along the outline of the base. False: they fall on and within it by chance.
  bool base_outline;
  GradingOptions grading;  ///< unless another spacing at the edge is requested
  double points_per_node;  ///< unless requested
  SupportOptions support;
};

/// Scheme whose force is independent of the positions of nodes and points: solver/README.md. Evidence of
/// `least`: with 0.12 radii the block's force is 1.2 % too low. With 0.1, two of three node sets of the
/// phantom brain (4250 nodes) pass a limit point at the edge of the patch at 8 mm. Without `load_exponent` a
/// heart of 2000 nodes is 3.3 % too soft, with it 0.8 %.
inline constexpr Scheme converging = {
    .name = "converging",
    .averaged_gradients = true,
    .consistent_gradients = true,
    .pressure_patches = true,
    .base_outline = true,
    .grading = {.patch_edge = 0.02, .reach = 12.0, .least = 0.11, .load_exponent = 0.4},
    .points_per_node = 7.0,
    .support = {.radius_factor = 1.6, .interpolation = 0.01, .through_tissue = true}};

/// Scheme of Horton et al. (2007): even nodes, an even grid of single points, one neo-Hookean tissue, and
/// central differences.
inline constexpr Scheme horton2007 = {.name = "horton2007",
                                      .averaged_gradients = false,
                                      .consistent_gradients = false,
                                      .pressure_patches = false,
                                      .base_outline = false,
                                      .grading = {},
                                      .points_per_node = 1.499,
                                      .support = {}};

/// Scheme of that name, or nullptr.
constexpr const Scheme* scheme_named(std::string_view name) {
  for (const Scheme* scheme : {&converging, &horton2007})
    if (scheme->name == name) return scheme;
  return nullptr;
}

}  // namespace dimple
