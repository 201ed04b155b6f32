#pragma once

#include <cstdint>

#include "preprocess/nodes/sizing.hpp"
#include "preprocess/scene/boundary_conditions.hpp"
#include "preprocess/surface/body_surface.hpp"

namespace dimple {

struct NodeSetOptions {
  Index count = 4250;  ///< nodes, with surface and contact patch; ignored if a spacing is given
  double spacing_mm =
      0.0;  ///< edge of the cube that one inner node far from the patch represents; 0: from count
  std::uint64_t seed = 1;  ///< of the random candidates
  GradingOptions grading = {};
  bool base_outline = true;  ///< nodes along the outline of the base
  double jitter = 0.0;       ///< largest random motion of inner nodes [spacings], for tests of robustness
};

/// Evenness of the nodes. Distances in units of the requested spacing at the place.
struct Evenness {
  double mean = 0.0;     ///< distance to the nearest other node, mean
  double spread = 0.0;   ///< its standard deviation over its mean
  double minimum = 0.0;  ///< its minimum
  double fill = 0.0;     ///< radius of the largest empty ball: from any place inside to the nearest node
};

/// Nodes of a body with the requested density, on its surface and inside; mm, in the surface's own frame.
struct NodeSet {
  Points X;  ///< [3xN]: the patch's nodes, then the rest of the surface's, then the inner ones
  Index patch_node_count = 0;
  Index fixed_count = 0;     ///< the patch's and those on the outline of the base
  Index surface_count = 0;   ///< the patch's included
  double far_spacing = 0.0;  ///< requested far from the patch [mm]
  Eigen::VectorXd spacing;   ///< [N] requested at each node [mm]
  std::vector<bool> base;    ///< [N] held fixed
};

/// The far spacing at which `count` nodes fill the body, and the inverse: each inner node has a cube of its
/// spacing's edge, each surface node half of one.
double spacing_for_count(const BodySurface& body, Index count, const Sizing& sizing = {});
Index count_for_spacing(const BodySurface& body, double spacing_mm, const Sizing& sizing = {});

struct NodeSetSize {
  Index count = 0;           ///< nodes
  double far_spacing = 0.0;  ///< [mm]
  double patch_edge = 1.0;   ///< spacing at the edge of the patch / far spacing
};
/// Number and spacings of the nodes for these options. At a sharp edge of the patch, a finer spacing than
/// `least_mm` exceeds what the equilibrium bears: further nodes are used elsewhere.
NodeSetSize node_set_size(const BodySurface& body, const Sizing& sizing, const NodeSetOptions& options,
                          double least_mm = 0.0);

/// Fills the body with nodes.
/// 1. Far spacing h from the number of nodes: N = V / h^3 + A / (2 h^2), volume and area weighted with s^-3
///    and s^-2, s the sizing (node_set_size()).
/// 2. Given nodes: rings of the contact patch, and the outline of the base, 0.95 spacings apart.
/// 3. Surface: five random candidates per node with density (h s)^-2, half a spacing from the patch, thinned
///    by sample elimination with reach 1.07.
/// 4. Inside: likewise with density (h s)^-3 and reach 1.12, at least 0.4 spacings from the surface.
/// 5. 40 Jacobi sweeps: node a moves by 0.35 h_a sum_b e_ab (1 - r_ab / (1.7 h_ab))^3, at most 0.2 h_a; by
///    0.175 h_a in the second half. Surface nodes are projected onto the surface.
/// 6. Base: nodes of its outline, and surface nodes on it.
///
/// Deterministic: the same body, options and seed give the same bits. Source: step 3 Yuksel 2015
/// (sample_elimination.hpp), the rest is of this project; Horton et al. (2007) use even nodes. Throws
/// ModelError: fewer nodes than the patch needs, or too few to have any inside.
NodeSet make_node_set(const BodySurface& body, const Boundary& boundary, const Sizing& sizing,
                      const NodeSetOptions& options, const NodeSetSize& size);
inline NodeSet make_node_set(const BodySurface& body, const Boundary& boundary, const Sizing& sizing,
                             const NodeSetOptions& options) {
  return make_node_set(body, boundary, sizing, options, node_set_size(body, sizing, options));
}

/// `places`: a dense sample of the inside, for the fill distance.
Evenness measure_evenness(const NodeSet& node_set, const Points& places);

}  // namespace dimple
