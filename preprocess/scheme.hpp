#pragma once

#include <string_view>

namespace dimple {

/// How the node spacing follows the load. Each number's effect, halved and doubled:
/// tests/verification/README.md.
struct GradingOptions {
  double rim = 1.0;    ///< spacing at the rim of the tool's circle / spacing far away; 1: even everywhere
  double reach = 3.0;  ///< distance from the rim at which the far spacing is reached [radii of the circle]
  bool whole_circle = false;  ///< and in all of the circle as at its rim
  double least = 0.0;         ///< spacing at the rim that a cloud does not go below [radii of the circle]
  /// Where tissue keeps the load together, (its flux there / a half-space's)^-this is a factor (LoadPath).
  /// 0: 1.
  double load_exponent = 0.0;
  double load_slope = 2.0;  ///< of that factor at most [per reach]
};

/// Integration points per node, in proportion.
struct PointDensity {
  double rim = 16.0, far = 3.0;
};

/// Size and form of the support domains.
struct SupportOptions {
  double radius_factor = 1.8;  ///< a node's support radius / the cloud's spacing at that node
  /// At prescribed nodes the weight is multiplied by (1 + e) / (s^2 + e), s = distance / radius, so that the
  /// field nearly takes their values there; e = this. 0: ordinary weights everywhere. Most & Bucher 2005.
  double interpolation = 0.0;
  /// A node belongs to a place only if it sees it through the tissue (sight.hpp). False: distance alone
  /// decides.
  bool through_tissue = false;
};

/// How the integral over the body becomes sums over its nodes and points: every choice in which one
/// discretisation differs from another, and nothing else in the code asks for a scheme by its name.
struct Scheme {
  std::string_view name;  ///< as scheme_named() takes it
  /// Each point stands for a cell with a spread that follows the nodes, and its gradients are means over that
  /// cell. False: gradients at the points of an even grid.
  bool averaged_gradients;
  /// Gradients are changed so that the divergence theorem holds for every shape function (make_consistent).
  bool consistent_gradients;
  /// The change of volume lives in a coarser space of patches (make_pressure_patches). False: at every point.
  bool pressure_patches;
  /// Nodes stand along the outline of the base. False: on it and within it only as they fall.
  bool base_outline;
  GradingOptions grading;  ///< unless another rim is asked for
  double points_per_node;  ///< unless asked for
  SupportOptions support;
};

/// Makes the force independent of where nodes and points lie: solver/README.md. Evidence of `least`: with
/// 0.12 radii the block's force is 1.2 % too low; with 0.1 two of three node sets of the phantom brain (4250
/// nodes) pass a limit point at the edge of the circle at 8 mm. Without `load_exponent` a heart of 2000 nodes
/// is 3.3 % too soft, with it 0.8 %.
inline constexpr Scheme converging = {
    .name = "converging",
    .averaged_gradients = true,
    .consistent_gradients = true,
    .pressure_patches = true,
    .base_outline = true,
    .grading = {.rim = 0.02, .reach = 12.0, .least = 0.11, .load_exponent = 0.4},
    .points_per_node = 7.0,
    .support = {.radius_factor = 1.6, .interpolation = 0.01, .through_tissue = true}};

/// As the paper has it: an even cloud, an even grid of single points, one neo-Hookean tissue, and central
/// differences. Horton et al. 2007.
inline constexpr Scheme horton2007 = {.name = "horton2007",
                                      .averaged_gradients = false,
                                      .consistent_gradients = false,
                                      .pressure_patches = false,
                                      .base_outline = false,
                                      .grading = {},
                                      .points_per_node = 1.499,
                                      .support = {}};

/// The one of that name, or nullptr.
constexpr const Scheme* scheme_named(std::string_view name) {
  for (const Scheme* scheme : {&converging, &horton2007})
    if (scheme->name == name) return scheme;
  return nullptr;
}

}  // namespace dimple
