#include "apps/run/view.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/output/reduce_surface.hpp"

namespace dimple {
namespace {

// Distance of the bonded patch from its plane along the press direction, interpolated between its nearest
// nodes.
class Foot {
 public:
  explicit Foot(const Discretisation& model)
      : across_(3, static_cast<Index>(model.bonded_patch.size())), along_(across_.cols()) {
    for (Index k = 0; k < along_.size(); ++k) {
      const Vec3 d = model.X.col(model.bonded_patch[static_cast<std::size_t>(k)]) - model.tool.centre;
      along_[k] = d.dot(model.tool.approach);
      across_.col(k) = d - along_[k] * model.tool.approach;
    }
    tree_.emplace(across_);
  }
  double along(const Vec3& across) const {
    double sum = 0.0, weights = 0.0;
    for (const int k : tree_->nearest(across, 4)) {
      const double weight = 1.0 / ((across_.col(k) - across).squaredNorm() + 1e-16);
      sum += weight * along_[k], weights += weight;
    }
    return weights > 0.0 ? sum / weights : 0.0;
  }

 private:
  Points across_;
  Eigen::VectorXd along_;
  std::optional<Neighbours> tree_;
};

}  // namespace

SurfaceFile tool_body(const Discretisation& model) {
  constexpr Index around = 96, rings = 6;
  const ToolPlace& tool = model.tool;
  Index least = 0;
  tool.approach.cwiseAbs().minCoeff(&least);
  const Vec3 right = tool.approach.cross(Vec3::Unit(least)).normalized(), ahead = tool.approach.cross(right);
  const Foot foot(model);

  // Vertices: centre of the foot, its rings from within, the upper ring, and its centre.
  SurfaceFile body;
  body.position_mm.resize(3, 2 + (rings + 1) * around);
  const auto put = [&](Index n, const Vec3& across, double along) {
    body.position_mm.col(n) = 1e3 * (tool.centre + across + along * tool.approach);
  };
  const double top = -3.0 * tool.radius;
  put(0, Vec3::Zero(), foot.along(Vec3::Zero()));
  for (Index ring = 0; ring <= rings; ++ring)
    for (Index k = 0; k < around; ++k) {
      const double angle = 2.0 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(around);
      const double r =
          tool.radius * static_cast<double>(std::min(ring + 1, rings)) / static_cast<double>(rings);
      const Vec3 across = r * (std::cos(angle) * right + std::sin(angle) * ahead);
      put(1 + ring * around + k, across, ring < rings ? foot.along(across) : top);
    }
  const Index last = 1 + (rings + 1) * around;
  put(last, Vec3::Zero(), top);

  body.triangles.resize(3, 2 * around * (rings + 1));
  Index t = 0;
  const auto add = [&](Index a, Index b, Index c) { body.triangles.col(t++) << a, b, c; };
  for (Index k = 0; k < around; ++k) {
    const Index next = (k + 1) % around, upper = 1 + rings * around;
    add(0, 1 + k, 1 + next);
    for (Index ring = 0; ring < rings; ++ring) {
      const Index a = 1 + ring * around + k, b = 1 + ring * around + next;
      add(a, a + around, b + around);
      add(a, b + around, b);
    }
    add(upper + k, last, upper + next);
  }
  return body;
}

namespace {

// Surface of a tool from a mesh, in as many triangles as a picture needs.
SurfaceFile drawn_body(const ToolMesh& mesh, const ToolPose& pose) {
  constexpr Index enough = 8000;
  const Surface surface{.vertex_mm = 1e3 * mesh.vertex, .triangles = mesh.triangles};
  const ReducedSurface shown = reduced_surface(
      surface, {.centre = Vec3::Zero(), .approach = -Vec3::UnitZ(), .radius = 0.5 * mesh.width}, enough);
  const Points left = mesh.vertex(Eigen::all, shown.vertex);
  return {.position_mm = 1e3 * ((pose.axes() * left).colwise() + pose.tip),
          .triangles = shown.triangles,
          .fields = {}};
}

}  // namespace

SurfaceFile tool_body(const RigidBody& indenter) {
  constexpr Index around = 96, round = 24;  // corners of a ring; rings of a quarter
  const ToolShape& shape = indenter.shape;
  if (shape.mesh) return drawn_body(*shape.mesh, indenter.pose);
  const std::vector<std::pair<double, double>> ring = shape.outline(round);
  const Vec3 up = -indenter.pose.points_at, right = up.unitOrthogonal(), ahead = up.cross(right);
  const Index rings = static_cast<Index>(ring.size()) - 1;  // without the centre of the upper end
  SurfaceFile body;
  body.position_mm.resize(3, 2 + rings * around);
  body.position_mm.col(0) = 1e3 * indenter.pose.tip;
  for (Index n = 0; n < rings; ++n)
    for (Index k = 0; k < around; ++k) {
      const double angle = 2.0 * std::numbers::pi * static_cast<double>(k) / around;
      const auto& [r, z] = ring[static_cast<std::size_t>(n)];
      const Vec3 across = r * (std::cos(angle) * right + std::sin(angle) * ahead);
      body.position_mm.col(1 + n * around + k) = 1e3 * (indenter.pose.tip + z * up + across);
    }
  const Index last = 1 + rings * around;
  body.position_mm.col(last) = 1e3 * (indenter.pose.tip + ring.back().second * up);
  body.triangles.resize(3, 2 * around * rings);
  Index t = 0;
  const auto add = [&](Index a, Index b, Index c) { body.triangles.col(t++) << a, b, c; };
  for (Index k = 0; k < around; ++k) {
    const Index next = (k + 1) % around, upper = 1 + (rings - 1) * around;
    add(0, 1 + next, 1 + k);
    for (Index n = 0; n + 1 < rings; ++n) {
      const Index a = 1 + n * around + k, b = 1 + n * around + next;
      add(a, b, b + around);
      add(a, b + around, a + around);
    }
    add(last, upper + k, upper + next);
  }
  return body;
}

}  // namespace dimple
