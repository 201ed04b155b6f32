// One maker for each shape of a tool or a wall.

#include <algorithm>
#include <cmath>
#include <numbers>

#include "solver/terms/tool_shape.hpp"

namespace dimple {
namespace {

using Outline = std::vector<std::pair<double, double>>;  // radius and height above the tip

// Rings of a quarter arc around a flat end. Without a flat part the tip is left out.
Outline rounded_end(double radius, double rounded, Index rings) {
  Outline ring;
  const double flat = radius - rounded;
  for (Index k = flat > 0.0 ? 0 : 1; k <= rings; ++k) {
    const double angle = 0.5 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(rings);
    ring.emplace_back(flat + rounded * std::sin(angle), rounded * (1.0 - std::cos(angle)));
  }
  return ring;
}

// Height of the lower surface of an end that is rounded around its flat part.
double height_of_end(double r, double radius, double rounded) {
  const double outside = std::max(0.0, r - (radius - rounded));
  return rounded - std::sqrt(std::max(0.0, rounded * rounded - outside * outside));
}

ProfileDistance to_ball(double r, double z, double radius, double centre) {
  const double away = std::hypot(r, z - centre);
  if (!(away > 0.0)) return {-radius, 0.0, -1.0};
  return {away - radius, r / away, (z - centre) / away};
}

// Rod with round ends; a sphere is one of two radii.
ToolShape round_ended(double R, double length) {
  ToolShape shape{.radius = R, .length = length};
  shape.profile = [=](double r, double z) {
    return to_ball(r, z, R, std::clamp(z, R, std::max(R, length - R)));
  };
  shape.height = [=](double r) { return height_of_end(r, R, R); };
  shape.contact_depth = [=](double a) { return 0.5 * a * std::log((R + a) / (R - a)); };
  shape.contact_force = [=](double a) { return 0.5 * (a * a + R * R) * std::log((R + a) / (R - a)) - a * R; };
  shape.outline = [=](Index rings) {
    Outline whole = rounded_end(R, R, rings);
    for (std::size_t k = whole.size(); k-- > 0;) whole.emplace_back(whole[k].first, length - whole[k].second);
    whole.emplace_back(0.0, length);
    return whole;
  };
  return shape;
}

// Rounded quarter plane: all within `radius` of the axis and above the tip.
ProfileDistance to_punch(double r, double z, double radius, double edge) {
  const double outside = r - (radius - edge), below = edge - z;
  if (outside > 0.0 && below > 0.0) {
    const double away = std::hypot(outside, below);
    return {away - edge, outside / away, -below / away};
  }
  return outside > below ? ProfileDistance{outside - edge, 1.0, 0.0}
                         : ProfileDistance{below - edge, 0.0, -1.0};
}

// A sphere tangent to a cone, both without an end: a sharp cone from the sphere's centre on, enlarged by the
// sphere's radius.
ProfileDistance to_blunted_cone(double r, double z, double angle, double tip) {
  const double up = z - tip, sine = std::sin(angle), cosine = std::cos(angle);
  if (r * sine + up * cosine < 0.0) return to_ball(r, z, tip, tip);
  return {r * cosine - up * sine - tip, cosine, -sine};
}

double height_of_cone(double r, double angle, double tip) {
  const double junction = tip * std::cos(angle);
  if (r <= junction) return height_of_end(r, tip, tip);
  return height_of_end(junction, tip, tip) + (r - junction) / std::tan(angle);
}

// Angle of the profile's tangent to the plane across the axis, where the shaft of that radius begins.
double slope_at_shaft(double angle, double tip, double radius) {
  return std::min(0.5 * std::numbers::pi - angle, std::asin(std::min(1.0, radius / tip)));
}

// Blunted cone within the shaft. Near the edge between them the edge is the nearest place.
ProfileDistance to_cone(double r, double z, double angle, double tip, double radius) {
  const double slope = slope_at_shaft(angle, tip, radius);
  const double outside = r - radius, above = z - height_of_cone(radius, angle, tip);
  if (above < 0.0 && outside * std::cos(slope) + above * std::sin(slope) > 0.0) {
    const double away = std::hypot(outside, above);
    return {away, outside / away, above / away};
  }
  const ProfileDistance lower = to_blunted_cone(r, z, angle, tip);
  return lower.distance > outside ? lower : ProfileDistance{outside, 1.0, 0.0};
}

// Largest radius at which the profile of a mesh is below a height: prongs and rings have nothing on the axis.
double radius_at_height(const std::vector<double>& lower, double radius, double height) {
  constexpr double least = 0.02;  // of the radius
  const double step = radius / static_cast<double>(lower.size() - 1);
  std::size_t k = lower.size() - 1;
  while (k > 0 && !(lower[k] < height)) --k;
  double r = step * static_cast<double>(k);
  if (k + 1 < lower.size() && std::isfinite(lower[k + 1]) && lower[k] < height)
    r += step * (height - lower[k]) / (lower[k + 1] - lower[k]);
  return std::clamp(r, least * radius, radius);
}

double height_of_mesh(const std::vector<double>& lower, double radius, double r) {
  const double at = r / radius * static_cast<double>(lower.size() - 1);
  const std::size_t k = std::min(static_cast<std::size_t>(at), lower.size() - 2);
  return std::min(lower[k], lower[k + 1]);
}

}  // namespace

ToolShape sphere_shape(double radius) {
  ToolShape shape = round_ended(radius, 2.0 * radius);
  shape.kind = "sphere", shape.numbers = {radius};
  return shape;
}

ToolShape capsule_shape(double radius, double length) {
  ToolShape shape = round_ended(radius, length);
  shape.kind = "capsule", shape.numbers = {radius, length};
  return shape;
}

ToolShape punch_shape(double radius, double edge) {
  const double b = radius - edge;  // of the flat part
  ToolShape shape{.kind = "punch", .numbers = {radius, edge}, .radius = radius, .edge = edge};
  shape.profile = [=](double r, double z) { return to_punch(r, z, radius, edge); };
  shape.height = [=](double r) { return height_of_end(r, radius, edge); };
  shape.contact_depth = [=](double a) {
    return a / edge * (std::sqrt(a * a - b * b) - b * std::acos(b / a));
  };
  shape.contact_force = [=](double a) {
    const double s = std::sqrt(a * a - b * b);
    return (s * (4.0 * a * a - b * b) - 3.0 * b * a * a * std::acos(b / a)) / (3.0 * edge);
  };
  shape.outline = [=](Index rings) {
    Outline drawn = rounded_end(radius, edge, rings);
    drawn.emplace_back(radius, 3.0 * radius);
    drawn.emplace_back(0.0, 3.0 * radius);
    return drawn;
  };
  return shape;
}

ToolShape cone_shape(double angle, double tip, double radius) {
  const double flank = 1.0 / std::tan(angle), junction = tip * std::cos(angle);
  ToolShape shape{.kind = "cone", .numbers = {angle, tip, radius}, .radius = radius};
  shape.profile = [=](double r, double z) { return to_cone(r, z, angle, tip, radius); };
  shape.height = [=](double r) { return height_of_cone(r, angle, tip); };
  // Sneddon's integrals over the sphere to b and over the flank from there to a.
  shape.contact_depth = [=](double a) {
    const double b = std::min(a, junction), to_b = std::sqrt(tip * tip - b * b),
                 from_b = std::sqrt(a * a - b * b);
    return a * (std::log((tip + a) / (to_b + from_b)) + flank * std::acos(b / a));
  };
  shape.contact_force = [=](double a) {
    const double b = std::min(a, junction), to_b = std::sqrt(tip * tip - b * b),
                 from_b = std::sqrt(a * a - b * b);
    const double sphere =
        (tip * tip + a * a) * std::log((tip + a) / (to_b + from_b)) + to_b * from_b - tip * a;
    return sphere + flank * (b * from_b + a * a * std::acos(b / a));
  };
  shape.outline = [=](Index rings) {
    Outline drawn;
    const double last = slope_at_shaft(angle, tip, radius), patch_edge = height_of_cone(radius, angle, tip);
    for (Index k = 1; k <= rings; ++k) {
      const double slope = last * static_cast<double>(k) / static_cast<double>(rings);
      drawn.emplace_back(tip * std::sin(slope), tip * (1.0 - std::cos(slope)));
    }
    if (junction < radius) drawn.emplace_back(radius, patch_edge);
    drawn.emplace_back(radius, patch_edge + radius);
    drawn.emplace_back(0.0, patch_edge + radius);
    return drawn;
  };
  return shape;
}

ToolShape drawn_shape(std::shared_ptr<const ToolMesh> mesh) {
  const double radius = 0.5 * mesh->width;
  ToolShape shape{.kind = "drawn", .radius = radius, .length = mesh->length, .mesh = mesh};
  shape.distance = [mesh](const ToolPose& pose, const Vec3& d) -> ToolDistance {
    const Mat3 axes = pose.axes();
    const Distance here = distance_in(mesh->distance, axes.transpose() * d);
    return {here.distance, axes * here.gradient.normalized()};
  };
  shape.height = [mesh, radius](double r) { return height_of_mesh(mesh->lower, radius, r); };
  shape.height_over = [mesh](const ToolPose& pose, const Vec3& d) {
    const Vec3 at = pose.axes().transpose() * d;
    return height_over(mesh->distance, at.x(), at.y());
  };
  shape.contact_radius = [mesh, radius](double depth) {
    return radius_at_height(mesh->lower, radius, 0.5 * depth);
  };
  return shape;
}

ToolShape plane_shape(double size) {
  ToolShape shape{.kind = "plane", .radius = size};
  shape.profile = [](double, double z) { return ProfileDistance{-z, 0.0, -1.0}; };
  return shape;
}

ToolShape field_shape(std::shared_ptr<const DistanceGrid> field, double size) {
  ToolShape shape{.kind = "field", .radius = size, .field = field};
  shape.distance = [field](const ToolPose&, const Vec3& d) -> ToolDistance {
    const Distance here = distance_in(*field, d);
    const double steep = here.gradient.norm();  // 0 far from the surface, where there is no contact
    return {here.distance, steep > 0.0 ? Vec3(here.gradient / steep) : Vec3::UnitZ()};
  };
  return shape;
}

}  // namespace dimple
