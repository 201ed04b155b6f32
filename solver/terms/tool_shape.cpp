#include "solver/terms/tool_shape.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace dimple {
namespace {

// In the half-plane through the axis: distance, and its derivatives by r and by the height z above the tip.
struct InPlane {
  double distance, by_r, by_z;
};

InPlane to_ball(double r, double z, double radius, double centre) {
  const double away = std::hypot(r, z - centre);
  if (!(away > 0.0)) return {-radius, 0.0, -1.0};
  return {away - radius, r / away, (z - centre) / away};
}

// A quarter plane, rounded: what lies within `radius` of the axis and above the tip.
InPlane to_punch(double r, double z, const ToolShape& shape) {
  const double beside = r - (shape.radius - shape.edge), below = shape.edge - z;
  if (beside > 0.0 && below > 0.0) {
    const double away = std::hypot(beside, below);
    return {away - shape.edge, beside / away, -below / away};
  }
  return beside > below ? InPlane{beside - shape.edge, 1.0, 0.0} : InPlane{below - shape.edge, 0.0, -1.0};
}

InPlane in_plane(const ToolShape& shape, double r, double z) {
  switch (shape.kind) {
    case ToolShape::Kind::punch:
      return to_punch(r, z, shape);
    case ToolShape::Kind::capsule:
      return to_ball(r, z, shape.radius, std::clamp(z, shape.radius, shape.length - shape.radius));
    case ToolShape::Kind::sphere:
      break;
  }
  return to_ball(r, z, shape.radius, shape.radius);
}

// The depth at which a tool touches within the radius a, of a punch larger than its flat part's.
double depth_of_contact(const ToolShape& shape, double a) {
  if (shape.kind != ToolShape::Kind::punch)
    return 0.5 * a * std::log((shape.radius + a) / (shape.radius - a));
  const double b = shape.radius - shape.edge;
  return a / shape.edge * (std::sqrt(a * a - b * b) - b * std::acos(b / a));
}

}  // namespace

ToolDistance distance_to_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x) {
  const Vec3 d = x - pose.tip;
  const double z = -d.dot(pose.points_at);
  const Vec3 across = d + z * pose.points_at;
  const double r = across.norm();
  const InPlane here = in_plane(shape, r, z);
  const Vec3 out = r > 0.0 ? Vec3(across / r) : pose.points_at.unitOrthogonal();
  return {here.distance, here.by_r * out - here.by_z * pose.points_at};
}

double height_of_tool(const ToolShape& shape, double r) {
  if (r > shape.radius) return std::numeric_limits<double>::infinity();
  const double rounded = shape.kind == ToolShape::Kind::punch ? shape.edge : shape.radius;
  const double beside = std::max(0.0, r - (shape.radius - rounded));
  return rounded - std::sqrt(std::max(0.0, rounded * rounded - beside * beside));
}

double length_of_tool(const ToolShape& shape) {
  switch (shape.kind) {
    case ToolShape::Kind::punch:
      return std::numeric_limits<double>::infinity();
    case ToolShape::Kind::capsule:
      return shape.length;
    case ToolShape::Kind::sphere:
      break;
  }
  return 2.0 * shape.radius;
}

double contact_radius(const ToolShape& shape, double depth) {
  double low = shape.kind == ToolShape::Kind::punch ? shape.radius - shape.edge : 0.0, high = shape.radius;
  for (int k = 0; k < 60; ++k) {
    const double a = 0.5 * (low + high);
    (depth_of_contact(shape, a) < depth ? low : high) = a;
  }
  return 0.5 * (low + high);
}

}  // namespace dimple
