#include "apps/run/rocking.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "io/digits.hpp"

namespace dimple {
namespace {

// A heart on a bed rocks by 22 to 28 % of the tool's depth, and by 6 % on a 1.5 times higher bed. Blocks, a
// brain and a half ellipsoid on a flat face have 3 to 16 %, and nearly as much motion that is not rigid.
constexpr double rocks_much = 0.1;     // of the tool's depth
constexpr double mostly_rigid = 0.5;   // the rest is less than this part of the rigid motion
constexpr double far_from_tool = 3.0;  // radii of the contact
constexpr double far_from_base = 0.5;  // of the largest distance from the base
constexpr Index most_looked_at = 2000, most_of_base = 200, fewest_far = 12;  // nodes

// At most this many indices, evenly spaced.
std::vector<Index> some_of(Index count, Index most) {
  const Index stride = std::max<Index>(1, (count + most - 1) / most);
  std::vector<Index> chosen;
  for (Index k = 0; k < count; k += stride) chosen.push_back(k);
  return chosen;
}

// Distance from the nearest of some nodes of the base.
double from_base(const Model& model, const std::vector<Index>& base, const Vec3& x) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const Index k : base)
    nearest = std::min(nearest, (model.X.col(model.base[static_cast<std::size_t>(k)]) - x).norm());
  return nearest;
}

double root_mean_square(const Points& v) {
  return std::sqrt(v.squaredNorm() / static_cast<double>(v.cols()));
}

// Small rotation and translation nearest to the displacements u of places x.
Points rigid_part(const Points& x, const Points& u) {
  const Vec3 middle = x.rowwise().mean(), translation = u.rowwise().mean();
  Mat3 inertia = Mat3::Zero();
  Vec3 moment = Vec3::Zero();
  for (Index k = 0; k < x.cols(); ++k) {
    const Vec3 r = x.col(k) - middle;
    inertia += r.squaredNorm() * Mat3::Identity() - r * r.transpose();
    moment += r.cross(Vec3(u.col(k) - translation));
  }
  const Vec3 rotation = inertia.ldlt().solve(moment);
  Points rigid(3, x.cols());
  for (Index k = 0; k < x.cols(); ++k) rigid.col(k) = translation + rotation.cross(Vec3(x.col(k) - middle));
  return rigid;
}

}  // namespace

RockingOfBody::RockingOfBody(const Model& model) {
  if (model.base.empty()) return;
  const std::vector<Index> base = some_of(static_cast<Index>(model.base.size()), most_of_base);
  std::vector<Index> nodes;
  std::vector<double> away;
  double furthest = 0.0;
  for (const Index a : some_of(model.node_count(), most_looked_at)) {
    const Vec3 x = model.X.col(a);
    const double distance = from_base(model, base, x);
    furthest = std::max(furthest, distance);
    if ((x - model.tool.centre).norm() < far_from_tool * model.tool.radius) continue;
    nodes.push_back(a);
    away.push_back(distance);
  }
  for (std::size_t k = 0; k < nodes.size(); ++k)
    if (away[k] > far_from_base * furthest) far_.push_back(nodes[k]);
  if (static_cast<Index>(far_.size()) < fewest_far) far_.clear();
  x_.resize(3, static_cast<Index>(far_.size()));
  for (Index k = 0; k < x_.cols(); ++k) x_.col(k) = model.X.col(far_[static_cast<std::size_t>(k)]);
  preload_displacement_ = Points::Zero(3, x_.cols());
}

void RockingOfBody::see(const Frame& frame) {
  if (far_.empty()) return;
  Points u(3, x_.cols());
  for (Index k = 0; k < u.cols(); ++k)
    u.col(k) = frame.u.col(far_[static_cast<std::size_t>(k)]).head<3>() - preload_displacement_.col(k);
  if (frame.number == 0) preload_displacement_ = u;
  if (!(frame.depth > depth_)) return;
  depth_ = frame.depth;
  const Points rigid = rigid_part(x_, u);
  rigid_ = root_mean_square(rigid);
  undeformed_ = root_mean_square(u - rigid);
}

std::string RockingOfBody::warning() const {
  if (!(depth_ > 0.0) || rigid_ < rocks_much * depth_ || undeformed_ > mostly_rigid * rigid_) return {};
  return fmt::format(
      "far from the tool the organ moves as a rigid body, by {} of the tool's {} ({:.0f} %): it rocks or "
      "yields on its base, and the force depends on the base; compare other values of --base-depth and "
      "--base",
      length_in_words(1e3 * rigid_), length_in_words(1e3 * depth_), 100.0 * rigid_ / depth_);
}

}  // namespace dimple
