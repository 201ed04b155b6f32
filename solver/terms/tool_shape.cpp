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
    case ToolShape::Kind::plane:
      return {-z, 0.0, -1.0};
    case ToolShape::Kind::sphere:
    case ToolShape::Kind::drawn:
    case ToolShape::Kind::field:
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

// The farthest from the axis that the profile of a tool that was drawn is lower than that: of prongs or of a
// ring there is nothing on the axis itself.
double radius_at_height(const ToolShape& shape, double height) {
  constexpr double least = 0.02;  // of the radius
  const std::vector<double>& lower = shape.mesh->lower;
  const double step = shape.radius / static_cast<double>(lower.size() - 1);
  std::size_t k = lower.size() - 1;
  while (k > 0 && !(lower[k] < height)) --k;
  double r = step * static_cast<double>(k);
  if (k + 1 < lower.size() && std::isfinite(lower[k + 1]) && lower[k] < height)
    r += step * (height - lower[k]) / (lower[k + 1] - lower[k]);
  return std::clamp(r, least * shape.radius, shape.radius);
}

}  // namespace

Mat3 ToolPose::axes() const {
  if (turned_axes) return *turned_axes;
  const Vec3 up = -points_at, along = std::abs(up.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY();
  const Vec3 x = (along - along.dot(up) * up).normalized();
  return (Mat3() << x, up.cross(x), up).finished();
}

ToolDistance distance_to_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x) {
  const Vec3 d = x - pose.tip;
  if (shape.kind == ToolShape::Kind::drawn) {
    const Mat3 axes = pose.axes();
    const Distance here = distance_in(shape.mesh->distance, axes.transpose() * d);
    return {here.distance, axes * here.gradient.normalized()};
  }
  if (shape.kind == ToolShape::Kind::field) {
    const Distance here = distance_in(*shape.field, d);
    const double steep = here.gradient.norm();  // nothing far from the surface, where nobody touches
    return {here.distance, steep > 0.0 ? Vec3(here.gradient / steep) : Vec3::UnitZ()};
  }
  const double z = -d.dot(pose.points_at);
  const Vec3 across = d + z * pose.points_at;
  const double r = across.norm();
  const InPlane here = in_plane(shape, r, z);
  const Vec3 out = r > 0.0 ? Vec3(across / r) : pose.points_at.unitOrthogonal();
  return {here.distance, here.by_r * out - here.by_z * pose.points_at};
}

double height_of_tool(const ToolShape& shape, const ToolPose& pose, const Vec3& x) {
  const Vec3 d = x - pose.tip;
  if (shape.kind != ToolShape::Kind::drawn)
    return height_of_tool(shape, (d - d.dot(pose.points_at) * pose.points_at).norm());
  const Vec3 at = pose.axes().transpose() * d;
  return height_over(shape.mesh->distance, at.x(), at.y());
}

double height_of_tool(const ToolShape& shape, double r) {
  if (r > shape.radius) return std::numeric_limits<double>::infinity();
  if (shape.kind == ToolShape::Kind::drawn) {
    const std::vector<double>& lower = shape.mesh->lower;
    const double at = r / shape.radius * static_cast<double>(lower.size() - 1);
    const std::size_t k = std::min(static_cast<std::size_t>(at), lower.size() - 2);
    return std::min(lower[k], lower[k + 1]);
  }
  const double rounded = shape.kind == ToolShape::Kind::punch ? shape.edge : shape.radius;
  const double beside = std::max(0.0, r - (shape.radius - rounded));
  return rounded - std::sqrt(std::max(0.0, rounded * rounded - beside * beside));
}

namespace {

// As far above its tip as a tool's upper end is known: of a shaft without an end, so many radii.
double known_height(const ToolShape& shape) {
  constexpr double radii = 4.0;
  const double length = length_of_tool(shape);
  return std::isfinite(length) ? length : radii * shape.radius;
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

double length_of_tool(const ToolShape& shape) {
  switch (shape.kind) {
    case ToolShape::Kind::punch:
    case ToolShape::Kind::plane:
    case ToolShape::Kind::field:
      return std::numeric_limits<double>::infinity();
    case ToolShape::Kind::capsule:
      return shape.length;
    case ToolShape::Kind::drawn:
      return shape.mesh->length;
    case ToolShape::Kind::sphere:
      break;
  }
  return 2.0 * shape.radius;
}

double contact_radius(const ToolShape& shape, double depth) {
  if (shape.kind == ToolShape::Kind::drawn) return radius_at_height(shape, 0.5 * depth);
  double low = shape.kind == ToolShape::Kind::punch ? shape.radius - shape.edge : 0.0, high = shape.radius;
  for (int k = 0; k < 60; ++k) {
    const double a = 0.5 * (low + high);
    (depth_of_contact(shape, a) < depth ? low : high) = a;
  }
  return 0.5 * (low + high);
}

std::optional<double> half_space_force(const ToolShape& shape, double depth) {
  if (shape.kind == ToolShape::Kind::drawn) return std::nullopt;
  if (!(depth > 0.0)) return 0.0;
  const double a = contact_radius(shape, depth), R = shape.radius;
  double force = 0.0;
  if (shape.kind == ToolShape::Kind::punch) {
    const double b = R - shape.edge, s = std::sqrt(a * a - b * b);
    force = (s * (4.0 * a * a - b * b) - 3.0 * b * a * a * std::acos(b / a)) / (3.0 * shape.edge);
  } else {
    force = 0.5 * (a * a + R * R) * std::log((R + a) / (R - a)) - a * R;
  }
  // Where contact has come to the tool's side it grows no more: dF / d depth = 2 E* a.
  return force + 2.0 * a * std::max(0.0, depth - depth_of_contact(shape, a));
}

double share_of_first_work(const ToolShape& shape, double depth) {
  constexpr int parts = 16;  // the middle of each, of a curve that is smooth
  const std::optional<double> end = half_space_force(shape, depth);
  if (!end) return 0.5;
  double sum = 0.0;
  for (int k = 0; k < parts; ++k) sum += *half_space_force(shape, depth * (k + 0.5) / parts);
  return sum / (parts * *end);
}

}  // namespace dimple
