#include "solver/terms/touching_tool.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

namespace dimple {

ToolPose first_touch(const ToolShape& shape, const Indenter& at, const ContactSurface& surface) {
  double way = std::numeric_limits<double>::infinity();
  const auto meet = [&](const Points& places) {
    for (const auto& x : places.colwise()) {
      const Vec3 d = x - at.centre;
      const double along = d.dot(at.push);
      way = std::min(way, along + height_of_tool(shape, {at.centre, at.push}, x));
    }
  };
  meet(surface.place);
  meet(surface.between);
  return {at.centre + way * at.push, at.push};
}

ToolPose TouchingTool::pose_at(double depth) const {
  return {touch_.pose.tip + depth * touch_.pose.points_at, touch_.pose.points_at};
}

void TouchingTool::add_force(const Nodal& u, const Instant& now, Nodal& f) {
  const ContactSurface& surface = touch_.surface;
  const ToolPose pose = pose_at(now.depth);
  place_ = surface.place + surface.at_place(u.topRows<3>());
  gap_.resize(count());
  normal_.resize(3, count());
  for (Index s = 0; s < count(); ++s) {
    const ToolDistance here = distance_to_tool(touch_.shape, pose, place_.col(s));
    gap_[s] = here.distance;
    normal_.col(s) = here.normal;
  }
  spread(force_, f);
}

void TouchingTool::spread(const Eigen::VectorXd& force, Nodal& f) const {
  const auto& [rows, weight] = touch_.surface.at_place;
  for (Index s = 0; s < count(); ++s) {
    if (force[s] == 0.0) continue;
    for (int k = rows.offset[s]; k < rows.offset[s + 1]; ++k)
      f.col(rows.member[k]).head<3>() -= (weight[k] * force[s]) * normal_.col(s);
  }
}

Wrench TouchingTool::on_tool(const Instant& now) const {
  const Vec3 tip = pose_at(now.depth).tip;
  Wrench sum = Wrench::Zero();
  for (Index s = 0; s < count(); ++s) {
    const Vec3 on_body = force_[s] * normal_.col(s);
    sum.head<3>() -= on_body;
    sum.tail<3>() -= (place_.col(s) - tip).cross(on_body);
  }
  return sum;
}

TouchingTool::Audit TouchingTool::audit(const Nodal& u, const Instant& now) const {
  const ContactSurface& surface = touch_.surface;
  const ToolPose pose = pose_at(now.depth);
  Audit result;
  const Points between = surface.between + surface.at_between(u.topRows<3>()),
               beyond = surface.beyond + surface.at_beyond(u.topRows<3>());
  for (const auto& x : between.colwise())
    result.penetration = std::max(result.penetration, -distance_to_tool(touch_.shape, pose, x).distance);
  for (const auto& x : place_.colwise())
    result.penetration = std::max(result.penetration, -distance_to_tool(touch_.shape, pose, x).distance);
  for (Index v = 0; v < beyond.cols(); ++v)
    if (const double in = -distance_to_tool(touch_.shape, pose, beyond.col(v)).distance; in > result.beyond) {
      result.beyond = in;
      result.beyond_at = v;
    }
  return result;
}

}  // namespace dimple
