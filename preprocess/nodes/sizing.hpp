#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "preprocess/scene/boundary_conditions.hpp"
#include "preprocess/scene/load_path.hpp"
#include "preprocess/scheme.hpp"

namespace dimple {

/// Spacing at a place / spacing far away.
/// 1. d(x): distance to the edge of the contact patch; with `whole_patch` (contacting tools, whose pressure
///    has no singular edge) to the whole patch. The least over the tool's path (`along`).
/// 2. f(x) <= 1: refinement where tissue confines the load (LoadPath).
/// 3. `s(x) = max(patch_edge, f(x) min(1, patch_edge + (1 - patch_edge) d(x) / (reach a)))`, a the radius of
/// the patch.
///
/// Linear in d, so that neighbouring spacings have a fixed ratio; all lengths scale with the patch. A method
/// of this project; Horton et al. (2007) use even nodes.
class Sizing {
 public:
  Sizing() = default;  ///< even: 1 everywhere
  /// `along` [mm]: displacements of the patch around which nodes are as fine. `uncut`: the body before cuts,
  /// on which the patch's edge is.
  Sizing(const BodySurface& body, const Boundary& boundary, const GradingOptions& options,
         std::vector<Vec3> along = {}, const BodySurface* uncut = nullptr);
  double operator()(const Vec3& x) const { return at(distance(x), finer(x)); }
  double distance(const Vec3& x) const;  ///< to the patch's edge [mm]; where the far spacing holds, infinite
  double finer(const Vec3& x) const { return path_ ? (*path_)(x) : 1.0; }  ///< f
  double at(double distance, double finer) const {
    return even() ? 1.0 : std::max(fraction_, finer * std::min(1.0, fraction_ + slope_ * distance));
  }
  /// Copy with another spacing at the edge.
  Sizing with_edge_spacing(double patch_edge) const;
  bool even() const { return patch_edge_.cols() == 0; }
  double least() const { return fraction_; }  ///< at the edge of the patch
  double patch_edge_length() const;           ///< [mm]; 0 if even

  /// Largest change per length [1/mm]; infinite if unknown.
  double steepest() const;

  struct Bounds {
    double here, least, distance, finer;
  };
  /// Value at x, a lower bound within the radius [mm], and what the value at x is made of.
  Bounds around(const Vec3& x, double radius) const;

 private:
  // Exact up to `farthest`, larger beyond: for the patch as it is, and for the nearest along the path.
  double distance_to_one(const Vec3& x, double farthest) const;
  double distance_to_patch_edge(const Vec3& x, double farthest) const;
  bool above_patch(const Vec3& x, double& away) const;

  std::shared_ptr<const LoadPath> path_;
  std::vector<Vec3> along_;                          // [mm]
  Points patch_edge_;                                // [3xK] closed polygon on the surface [mm]
  Eigen::Matrix<double, Eigen::Dynamic, 3> corner_;  // the same, one column per coordinate
  Vec3 lower_, upper_;                               // of the polygon's box
  bool whole_patch_ = false;
  Vec3 centre_ = Vec3::Zero(), approach_ = Vec3::Zero();
  double radius_ = 0.0;
  double longest_edge_ = 0.0, fraction_ = 1.0, slope_ = 0.0, reach_ = 0.0;  // reach in mm
};

/// Part of a body: a box of the background grid.
struct Leaf {
  Vec3 centre, half;                   ///< [mm]
  bool cut = false;                    ///< the surface may pass through it; otherwise it is inside
  double distance = 0.0, finer = 1.0;  ///< of the sizing, in the centre
  double volume() const { return 8.0 * half.prod(); }
};

/// Boxes of a body that follow the sizing s: a regular grid over its box with cells no longer than `edge`
/// [mm]. Each is halved along its longest edge until it has at most `requested(s)` [mm^3], within about a
/// third; `requested` grows with s. Boxes outside of the body are left out. In a fixed order. Nothing if more
/// than `most` are necessary.
std::optional<std::vector<Leaf>> bisect(const BodySurface& body, double edge, const Sizing& sizing,
                                        const std::function<double(double)>& requested, std::size_t most);

}  // namespace dimple
