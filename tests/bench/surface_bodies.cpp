#include "tests/bench/surface_bodies.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace dimple {
namespace {

using std::numbers::pi;

double square(double x) {
  return x * x;
}

// A point of a body of revolution about z: distance from the axis, and the unit vector away from it.
struct Meridian {
  double rho;
  Vec3 outward;
};
Meridian meridian(const Vec3& x) {
  const double rho = std::hypot(x.x(), x.y());
  return {rho, rho > 0.0 ? Vec3(x.x() / rho, x.y() / rho, 0.0) : Vec3(Vec3::UnitX())};
}

double sign(double x) {
  return x < 0.0 ? -1.0 : 1.0;
}

// Nearest point of an ellipsoid: foot_i = a_i^2 x_i / (t + a_i^2), where t is the largest root of
// g(t) = sum_i (a_i x_i / (t + a_i^2))^2 - 1. There g is convex and falls, so Newton's steps from the left
// ascend to the root.
Foot foot_on_ellipsoid(const Vec3& a, const Vec3& x) {
  const Vec3 a2 = a.cwiseAbs2(), ax = a.cwiseProduct(x);
  double t = (ax.cwiseAbs() - a2).maxCoeff();
  for (int step = 0; step < 100; ++step) {
    const Vec3 denominator = a2.array() + t;
    const Vec3 ratio = ax.cwiseQuotient(denominator);
    const double g = ratio.squaredNorm() - 1.0;
    const double slope = -2.0 * ratio.cwiseAbs2().cwiseQuotient(denominator).sum();
    const double change = -g / slope;
    t += change;
    if (!(change > 1e-14 * a2.maxCoeff())) break;
  }
  const Vec3 place = a2.cwiseProduct(x).cwiseQuotient(Vec3(a2.array() + t));
  const Vec3 gradient = place.cwiseQuotient(a2);  // of (sum_i (x_i / a_i)^2) / 2
  const Vec3 second = a2.cwiseInverse();
  const double length = gradient.norm();
  Foot foot;
  foot.normal = gradient / length;
  foot.distance = sign(t) * (x - place).norm();
  foot.curvature = (second.sum() - foot.normal.cwiseAbs2().dot(second)) / (2.0 * length);
  return foot;
}

std::function<bool(const Vec3&)> inside(const std::function<Foot(const Vec3&)>& foot) {
  return [foot](const Vec3& x) { return foot(x).distance < 0.0; };
}

Foot foot_on_half_ball(double radius, const Vec3& x) {
  const auto [rho, outward] = meridian(x);
  Foot foot;
  foot.to_edge = std::hypot(rho - radius, x.z());
  if (x.z() <= 0.0 && rho > radius) {
    foot.distance = foot.to_edge;
    foot.normal = ((rho - radius) * outward + x.z() * Vec3::UnitZ()) / foot.to_edge;
    return foot;
  }
  const double length = x.norm(), round = length - radius, flat = -x.z();
  foot.distance = std::max(round, flat);
  foot.normal = round > flat ? Vec3(x / length) : Vec3(-Vec3::UnitZ());
  foot.curvature = round > flat ? 1.0 / radius : 0.0;
  return foot;
}

Foot foot_on_box(const Vec3& half, const Vec3& x) {
  const Vec3 beyond = x.cwiseAbs() - half, outside = beyond.cwiseMax(0.0);
  Foot foot;
  for (int along = 0; along < 3; ++along) {
    const double across = beyond.squaredNorm() - square(beyond[along]);
    foot.to_edge = std::min(foot.to_edge, std::sqrt(across + square(outside[along])));
  }
  int axis = 0;
  foot.distance = beyond.maxCoeff(&axis);
  foot.normal = sign(x[axis]) * Vec3::Unit(axis);
  if (foot.distance > 0.0) {
    foot.distance = outside.norm();
    foot.normal = outside / foot.distance;
    for (int d = 0; d < 3; ++d) foot.normal[d] *= sign(x[d]);
  }
  return foot;
}

Foot foot_on_cylinder(double radius, double half_height, const Vec3& x) {
  const auto [rho, outward] = meridian(x);
  const double side = rho - radius, end = std::abs(x.z()) - half_height;
  const Vec3 up = sign(x.z()) * Vec3::UnitZ();
  Foot foot;
  foot.to_edge = std::hypot(side, end);
  if (side > 0.0 && end > 0.0) {
    foot.distance = foot.to_edge;
    foot.normal = (side * outward + end * up) / foot.to_edge;
    return foot;
  }
  foot.distance = std::max(side, end);
  foot.normal = side > end ? outward : up;
  foot.curvature = side > end ? 0.5 / radius : 0.0;
  return foot;
}

Foot foot_on_torus(double major, double minor, const Vec3& x) {
  const auto [rho, outward] = meridian(x);
  const double across = rho - major, length = std::hypot(across, x.z()), cosine = across / length;
  Foot foot;
  foot.distance = length - minor;
  foot.normal = (across * outward + x.z() * Vec3::UnitZ()) / length;
  foot.curvature = 0.5 * (1.0 / minor + cosine / (major + minor * cosine));
  return foot;
}

}  // namespace

ExactBody exact_ball(double radius) {
  const auto foot = [radius](const Vec3& x) {
    Foot result;
    result.distance = x.norm() - radius;
    result.normal = x.normalized();
    result.curvature = 1.0 / radius;
    return result;
  };
  return {.name = fmt::format("ball {:g}", radius),
          .radius = radius,
          .volume = 4.0 / 3.0 * pi * radius * radius * radius,
          .smooth = true,
          .contains = [radius](const Vec3& x) { return x.squaredNorm() < radius * radius; },
          .foot = foot,
          .reach = [radius](const Vec3&) { return radius; }};
}

ExactBody exact_ellipsoid(double radius) {
  const Vec3 half = radius * Vec3(1.0, 0.8, 0.6);
  return {.name = fmt::format("ellipsoid {:g}", radius),
          .radius = radius,
          .volume = 4.0 / 3.0 * pi * half.prod(),
          .smooth = true,
          .contains = [half](const Vec3& x) { return x.cwiseQuotient(half).squaredNorm() < 1.0; },
          .foot = [half](const Vec3& x) { return foot_on_ellipsoid(half, x); },
          .reach = [half](const Vec3& direction) { return half.cwiseProduct(direction).norm(); }};
}

ExactBody exact_half_ball(double radius) {
  const auto foot = [radius](const Vec3& x) { return foot_on_half_ball(radius, x); };
  const auto reach = [radius](const Vec3& direction) {
    return direction.z() >= 0.0 ? radius : radius * std::hypot(direction.x(), direction.y());
  };
  return {.name = fmt::format("half ball {:g}", radius),
          .radius = radius,
          .volume = 2.0 / 3.0 * pi * radius * radius * radius,
          .smooth = false,
          .contains = inside(foot),
          .foot = foot,
          .reach = reach};
}

ExactBody exact_box(const std::string& name, const Vec3& size) {
  const Vec3 half = 0.5 * size;
  const auto foot = [half](const Vec3& x) { return foot_on_box(half, x); };
  return {.name = name,
          .radius = half.maxCoeff(),
          .volume = size.prod(),
          .smooth = false,
          .contains = inside(foot),
          .foot = foot,
          .reach = [half](const Vec3& direction) { return half.dot(direction.cwiseAbs()); }};
}

ExactBody exact_cylinder(double radius, double height) {
  const auto foot = [=](const Vec3& x) { return foot_on_cylinder(radius, 0.5 * height, x); };
  const auto reach = [=](const Vec3& direction) {
    return radius * std::hypot(direction.x(), direction.y()) + 0.5 * height * std::abs(direction.z());
  };
  return {.name = fmt::format("cylinder {:g}", radius),
          .radius = radius,
          .volume = pi * radius * radius * height,
          .smooth = false,
          .contains = inside(foot),
          .foot = foot,
          .reach = reach};
}

ExactBody exact_torus(double major, double minor) {
  const auto foot = [=](const Vec3& x) { return foot_on_torus(major, minor, x); };
  const auto reach = [=](const Vec3& direction) {
    return major * std::hypot(direction.x(), direction.y()) + minor;
  };
  return {.name = fmt::format("torus {:g} {:g}", major, minor),
          .radius = minor,
          .volume = 2.0 * pi * pi * major * minor * minor,
          .smooth = true,
          .contains = inside(foot),
          .foot = foot,
          .reach = reach};
}

std::vector<Study> surface_studies() {
  constexpr int all = grid_offsets, every_turn = grid_turns;
  return {{exact_ball(6.0), all, 1, true},
          {exact_ball(10.0), all, 1, true},
          {exact_ball(15.0), all, 1, false},
          {exact_ball(25.0), all, 1, true},
          {exact_ball(40.0), 8, 1, false},
          {exact_ball(60.0), 4, 1, false},
          {exact_ellipsoid(10.0), all, every_turn, true},
          {exact_ellipsoid(25.0), 8, every_turn, true},
          {exact_ellipsoid(50.0), 4, 2, false},
          {exact_half_ball(10.0), all, every_turn, false},
          {exact_half_ball(25.0), 8, every_turn, true},
          {exact_box("box 30x30x12", {30.0, 30.0, 12.0}), all, every_turn, true},
          {exact_cylinder(6.0, 20.0), all, every_turn, false},
          {exact_cylinder(12.0, 24.0), all, every_turn, true},
          {exact_cylinder(25.0, 30.0), 8, every_turn, false},
          {exact_torus(25.0, 8.0), 8, every_turn, true},
          {exact_box("plate 40x40x3.5", {40.0, 40.0, 3.5}), all, every_turn, true}};
}

Vec3 grid_offset(int number) {
  constexpr double g = 1.2207440846057595;  // g^4 = g + 1
  Vec3 offset;
  double power = 1.0;
  for (double& part : offset) {
    power /= g;
    const double at = 0.5 + power * static_cast<double>(number);
    part = at - std::floor(at);
  }
  return offset;
}

Mat3 grid_turn(int number) {
  struct Turn {
    double degrees;
    Vec3 axis;
  };
  static const std::array<Turn, grid_turns> turns = {{{0.0, Vec3::UnitX()},
                                                      {4.0, Vec3(2.0, 1.0, 0.0)},
                                                      {18.0, Vec3(1.0, -2.0, 1.0)},
                                                      {45.0, Vec3(1.0, 0.0, 0.0)},
                                                      {63.0, Vec3(1.0, 2.0, 3.0)}}};
  const Turn& turn = turns[static_cast<std::size_t>(number)];
  return Eigen::AngleAxisd(turn.degrees * pi / 180.0, turn.axis.normalized()).toRotationMatrix();
}

}  // namespace dimple
