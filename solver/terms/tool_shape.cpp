#include "solver/terms/tool_shape.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace dimple {
Mat3 ToolPose::axes() const {
  if (turned_axes) return *turned_axes;
  const Vec3 up = -points_at, along = std::abs(up.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
  const Vec3 x = (along - along.dot(up) * up).normalized();
  return (Mat3() << x, up.cross(x), up).finished();
}

ToolDistance distance_to_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x) {
  const Vec3 d = x - pose.tip;
  if (!shape.profile) return shape.distance(pose, d);
  const double z = -d.dot(pose.points_at);
  const Vec3 across = d + z * pose.points_at;
  const double r = across.norm();
  const ProfileDistance here = shape.profile(r, z);
  const Vec3 out = r > 0.0 ? Vec3(across / r) : pose.points_at.unitOrthogonal();
  return {here.distance, here.by_r * out - here.by_z * pose.points_at};
}

double height_of_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x) {
  const Vec3 d = x - pose.tip;
  if (!shape.profile) return shape.height_over(pose, d);
  return height_of_tool(shape, (d - d.dot(pose.points_at) * pose.points_at).norm());
}

double height_of_tool(const ToolShape& shape, double r) {
  return r > shape.radius ? std::numeric_limits<double>::infinity() : shape.height(r);
}

namespace {

// Height above the tip at which a tool is taken to end; a shaft without an end counts for some radii.
double known_height(const ToolShape& shape) {
  constexpr double radii = 4.0;
  return std::isfinite(shape.length) ? shape.length : radii * shape.radius;
}

}  // namespace

std::optional<Vec3> place_in_both(const ToolShape& one, const ToolPose& at_one, const ToolShape& other,
                                  const ToolPose& at_other, double deep) {
  constexpr int rounds = 300;
  Vec3 x = at_one.tip - one.radius * at_one.points_at;
  for (int round = 0; round < rounds; ++round) {
    double outside = 0.0;
    const auto bring = [&](double off, const Vec3& normal) {
      if (off <= 0.0) return;
      x -= off * normal;
      outside = std::max(outside, off);
    };
    for (const auto& [shape, pose] : {std::pair(&one, &at_one), std::pair(&other, &at_other)}) {
      const ToolDistance here = distance_to_tool(*shape, *pose, x);
      bring(here.distance + deep, here.normal);
      bring((x - pose->tip).dot(-pose->points_at) - known_height(*shape) + deep, -pose->points_at);
    }
    if (outside <= 0.01 * deep) return x;
  }
  return std::nullopt;
}

double contact_radius(const ToolShape& shape, double depth) {
  if (!shape.contact_depth) return shape.contact_radius(depth);
  double low = shape.edge > 0.0 ? shape.radius - shape.edge : 0.0, high = shape.radius;
  for (int k = 0; k < 60; ++k) {
    const double a = 0.5 * (low + high);
    (shape.contact_depth(a) < depth ? low : high) = a;
  }
  return 0.5 * (low + high);
}

std::optional<double> half_space_force(const ToolShape& shape, double depth) {
  if (!shape.contact_force) return std::nullopt;
  if (!(depth > 0.0)) return 0.0;
  const double a = contact_radius(shape, depth);
  // Once contact reaches the side of the tool, its radius is constant: dF / d depth = 2 E* a.
  return shape.contact_force(a) + 2.0 * a * std::max(0.0, depth - shape.contact_depth(a));
}

double fraction_of_first_work(const ToolShape& shape, double depth) {
  constexpr int parts = 16;  // midpoint rule on a smooth curve
  const std::optional<double> end = half_space_force(shape, depth);
  if (!end) return 0.5;
  double sum = 0.0;
  for (int k = 0; k < parts; ++k) sum += *half_space_force(shape, depth * (k + 0.5) / parts);
  return sum / (parts * *end);
}

}  // namespace dimple
