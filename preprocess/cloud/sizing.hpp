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

/// Spacing at a place as a part of the spacing far away,
///
///     s(x) = max(rim, f(x) min(1, rim + (1 - rim) d(x) / (reach a))),   d = distance to the rim, a = its
///     radius, or to the whole circle where a tool touches it: its pressure has no rim,
///
/// f <= 1 where tissue keeps the load together (LoadPath). Linear in d, so that neighbouring spacings differ
/// by a fixed share; everything scales with the circle, so that no length of one scene is built in.
class Sizing {
 public:
  Sizing() = default;  ///< even: 1 everywhere
  /// `along` [mm]: as fine besides around the circle moved by each of these. `uncut`: the body as it was
  /// before cuts, on which the rim lies.
  Sizing(const BodySurface& body, const Boundary& boundary, const GradingOptions& options,
         std::vector<Vec3> along = {}, const BodySurface* uncut = nullptr);
  double operator()(const Vec3& x) const { return at(distance(x), finer(x)); }
  double distance(const Vec3& x) const;  ///< to the rim [mm]; where the far spacing holds, infinite
  double finer(const Vec3& x) const { return path_ ? (*path_)(x) : 1.0; }  ///< f
  double at(double distance, double finer) const {
    return even() ? 1.0 : std::max(share_, finer * std::min(1.0, share_ + slope_ * distance));
  }
  /// The same with another spacing at the rim.
  Sizing with_rim(double rim) const;
  bool even() const { return rim_.cols() == 0; }
  double least() const { return share_; }  ///< on the rim
  double rim_length() const;               ///< [mm]; 0 if even

  struct Bounds {
    double here, least;
  };
  /// At x, and what it is nowhere less than within the radius [mm].
  Bounds around(const Vec3& x, double radius) const;

 private:
  // Exact up to `farthest`, larger beyond: of the circle as it stands, and of the nearest along the way.
  double distance_to_one(const Vec3& x, double farthest) const;
  double distance_to_rim(const Vec3& x, double farthest) const;
  bool above_circle(const Vec3& x, double& away) const;

  std::shared_ptr<const LoadPath> path_;
  std::vector<Vec3> along_;                          // [mm]
  Points rim_;                                       // [3xK] closed polygon on the surface [mm]
  Eigen::Matrix<double, Eigen::Dynamic, 3> corner_;  // the same, a coordinate a column
  Vec3 lower_, upper_;                               // of the polygon's box
  bool whole_circle_ = false;
  Vec3 centre_ = Vec3::Zero(), push_ = Vec3::Zero();
  double radius_ = 0.0;
  double longest_edge_ = 0.0, share_ = 1.0, slope_ = 0.0, reach_ = 0.0;  // reach in mm
};

/// Part of a body: a box of the background grid.
struct Leaf {
  Vec3 centre, half;  ///< [mm]
  bool cut = false;   ///< the surface may pass through it; otherwise it lies inside
  double volume() const { return 8.0 * half.prod(); }
};

/// A regular grid of cells no longer than `edge` [mm] over the body's box, each halved along its longest edge
/// until it is as small as `wanted(s)` [mm^3] asks, within about a third, s the sizing in it; `wanted` grows
/// with s. Those outside of the body are left out. In a fixed order. Nothing, if it would take more than
/// `most` of them.
std::optional<std::vector<Leaf>> bisect(const BodySurface& body, double edge, const Sizing& sizing,
                                        const std::function<double(double)>& wanted, std::size_t most);

}  // namespace dimple
