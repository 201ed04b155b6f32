#pragma once

#include <cstdint>

#include "preprocess/cloud/sizing.hpp"
#include "preprocess/scene/boundary_conditions.hpp"
#include "preprocess/surface/body_surface.hpp"

namespace dimple {

struct CloudOptions {
  Index count = 4250;  ///< nodes, surface and circle included; ignored if a spacing is given
  double spacing_mm =
      0.0;  ///< edge of the cube that one inner node far from the circle stands for; 0: from count
  std::uint64_t seed = 1;  ///< of the random candidates
  GradingOptions grading = {};
  bool base_outline = true;  ///< nodes along the outline of the base
  double jitter =
      0.0;  ///< every inner node is moved by up to this part of its spacing: for tests of robustness
};

/// How even a cloud is. Distances in units of the wanted spacing at the place.
struct Evenness {
  double mean = 0.0;     ///< distance to the nearest other node, mean
  double spread = 0.0;   ///< its standard deviation over its mean
  double minimum = 0.0;  ///< its minimum
  double fill = 0.0;     ///< radius of the largest empty ball: from any place inside to the nearest node
};

/// Nodes filling a body as densely as wanted, on its surface and inside; mm, in the surface's own frame.
struct NodeCloud {
  Points X;  ///< [3xN]: the circle's nodes, then the rest of the surface's, then the inner ones
  Index circle_count = 0;
  Index fixed_count = 0;     ///< the circle's and those on the outline of the base
  Index surface_count = 0;   ///< the circle's included
  double far_spacing = 0.0;  ///< wanted far from the circle [mm]
  Eigen::VectorXd spacing;   ///< [N] wanted at each node [mm]
  std::vector<bool> base;    ///< [N] held fixed
};

/// The far spacing at which `count` nodes fill the body: each inner node has a cube of its spacing's edge,
/// each surface node half of one; and back.
double spacing_for_count(const BodySurface& body, Index count, const Sizing& sizing = {});
Index count_for_spacing(const BodySurface& body, double spacing_mm, const Sizing& sizing = {});

struct CloudSize {
  Index count = 0;           ///< nodes
  double far_spacing = 0.0;  ///< [mm]
  double rim = 1.0;          ///< spacing at the rim over that
};
/// Of the cloud that the options ask for. Many nodes would make the rim finer than the equilibrium at a sharp
/// rim bears: below `least_mm` at the rim they go elsewhere.
CloudSize cloud_size(const BodySurface& body, const Sizing& sizing, const CloudOptions& options,
                     double least_mm = 0.0);

/// Fills the body. The circle's nodes are given and stay; the surface's nodes keep half a spacing away from
/// the rim.
///
/// Random candidates are thinned to the count by weighted sample elimination (Yuksel 2015), then moved apart
/// by a few dozen sweeps of repulsion, on the surface along it. Deterministic: the same body, options and
/// seed give the same bits. No packaged library fills a volume with a given number of spaced points.
/// Throws ModelError: fewer nodes asked for than the circle needs, or too few to have any inside.
NodeCloud make_node_cloud(const BodySurface& body, const Boundary& boundary, const Sizing& sizing,
                          const CloudOptions& options, const CloudSize& size);
inline NodeCloud make_node_cloud(const BodySurface& body, const Boundary& boundary, const Sizing& sizing,
                                 const CloudOptions& options) {
  return make_node_cloud(body, boundary, sizing, options, cloud_size(body, sizing, options));
}

/// `places`: a dense sample of the inside, for the fill distance.
Evenness measure_evenness(const NodeCloud& cloud, const Points& places);

}  // namespace dimple
