#include "apps/run/bending.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>

namespace dimple {
namespace {

constexpr double much = 0.5;  // of the tool's depth
constexpr Index few = 4;      // nearest nodes, whose mean represents a place of the surface

// Length of tissue along the press direction, from the tool's centre to the first exit [m]; 0: there is none.
// Moeller and Trumbore 1997.
double thickness_beneath(const Discretisation& places) {
  const Vec3 origin = places.tool.centre * 1e3, approach = places.tool.approach;  // mm, as the surface
  const double ahead = 0.1e3 * places.tool.radius;  // shallower exits belong to the surface under the tool
  double nearest = 0.0;
  for (const auto& corner : places.surface.triangles.colwise()) {
    const Vec3 a = places.surface.vertex_mm.col(corner[0]), ab = places.surface.vertex_mm.col(corner[1]) - a,
               ac = places.surface.vertex_mm.col(corner[2]) - a;
    const Vec3 p = approach.cross(ac);
    const double determinant = ab.dot(p);
    if (!(determinant < 0.0)) continue;  // entry, or parallel
    const Vec3 from = origin - a, q = from.cross(ab);
    const double u = from.dot(p) / determinant, v = approach.dot(q) / determinant,
                 t = ac.dot(q) / determinant;
    if (u < 0.0 || v < 0.0 || u + v > 1.0 || t < ahead) continue;
    if (nearest == 0.0 || t < nearest) nearest = t;
  }
  return 1e-3 * nearest;
}

}  // namespace

BendingOfPart::BendingOfPart(const Model& model)
    : approach_(model.tool.approach),
      thickness_(thickness_beneath(model)),
      diameter_(2.0 * model.tool.radius) {
  if (!(thickness_ > 0.0)) return;
  const Vec3 place = model.tool.centre + thickness_ * approach_;
  const Eigen::VectorXd away = (model.X.colwise() - place).colwise().squaredNorm();
  opposite_.resize(static_cast<std::size_t>(model.node_count()));
  std::iota(opposite_.begin(), opposite_.end(), Index{0});
  const auto count = static_cast<std::ptrdiff_t>(std::min(few, model.node_count()));
  std::partial_sort(opposite_.begin(), opposite_.begin() + count, opposite_.end(),
                    [&](Index a, Index b) { return away[a] < away[b]; });
  opposite_.resize(static_cast<std::size_t>(count));
}

void BendingOfPart::see(const Frame& frame) {
  if (opposite_.empty()) return;
  depth_ = frame.depth;
  moved_ = 0.0;
  for (const Index a : opposite_)
    moved_ += frame.u.col(a).head<3>().dot(approach_) / static_cast<double>(opposite_.size());
  if (frame.number == 0) preload_displacement_ = moved_;
  moved_ -= preload_displacement_;
}

std::string BendingOfPart::warning() const {
  if (!(depth_ > 0.0) || moved_ < much * depth_) return {};
  return fmt::format(
      "{:.0f} % of the indentation bends the part under the tool: at {:.2f} mm the surface on its other "
      "side, {:.1f} mm below a contact patch of {:.4g} mm, has moved {:.2f} mm along the approach direction; "
      "the force is that of bending: move the tool (`dimple places` lists places), or hold that part with "
      "--base",
      100.0 * moved_ / depth_, 1e3 * depth_, 1e3 * thickness_, 1e3 * diameter_, 1e3 * moved_);
}

}  // namespace dimple
