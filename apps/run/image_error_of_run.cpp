#include "apps/run/image_error_of_run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "apps/run/organ.hpp"
#include "apps/scene/tool_words.hpp"

namespace dimple {

const double shape_voxels = 1.5;
const double bumps = 3.0;
const double most_shape_voxels = 0.5;
const double thickness_voxels = 1.0;
const double exponent_of_bending = 1.5;

double shape_error(const UnderTool& under) {
  const double per_radius = under.voxel * under.curvature;
  return std::min(most_shape_voxels * under.voxel,
                  std::hypot(shape_voxels * under.voxel * per_radius * per_radius, bumps * under.roughness));
}

double thickness_exponent(double x) {
  const double a = 1.133 * x, b = 1.283 * x * x, c = 0.769 * x * x * x, d = 0.0975 * x * x * x * x;
  return (a + 2.0 * b + 3.0 * c + 4.0 * d) / (1.0 + a + b + c + d);
}

namespace {

// d ln F / d ln depth at a sample, from the one before or after it. For a contacting tool it is between that
// of a flat punch and that of a cone, or above if the body stiffens.
double exponent_at(const std::vector<ForceSample>& force, std::size_t k) {
  constexpr double of_sphere = 1.5, least = 1.0, most = 3.0;
  const auto usable = [&](std::size_t n) {
    return n < force.size() && force[n].depth > 0.0 && force[n].force > 0.0;
  };
  const std::size_t from = k > 0 && usable(k - 1) ? k - 1 : k, to = from < k ? k : k + 1;
  if (!usable(from) || !usable(to) || !(force[to].depth > force[from].depth)) return of_sphere;
  return std::clamp(
      std::log(force[to].force / force[from].force) / std::log(force[to].depth / force[from].depth), least,
      most);
}

double shape_part(const std::vector<ForceSample>& force, std::size_t k, const UnderTool& under) {
  if (!under.has_contact) return 0.0;
  const double off = shape_error(under) / force[k].depth;
  return std::abs(force[k].force) * (std::pow(1.0 + off, exponent_at(force, k)) - 1.0);
}

double thickness_part(double force, const UnderTool& under) {
  if (!(under.thickness > 0.0)) return 0.0;
  const double of_layer = thickness_exponent(under.contact / under.thickness),
               exponent = under.is_free_below ? std::max(of_layer, exponent_of_bending) : of_layer;
  return std::abs(force) * exponent * thickness_voxels * under.voxel / under.thickness;
}

}  // namespace

ImageError image_error(const std::vector<ForceSample>& force, const UnderTool& under) {
  ImageError error{.unknown = "", .voxel = under.voxel};
  if (!(under.voxel > 0.0)) error.unknown = "there is no image";
  if (force.empty()) error.unknown = "there is no force";
  if (!error.known()) return error;
  for (std::size_t k = 0; k < force.size(); ++k) {
    const bool pressed = force[k].depth > 0.0;
    error.shape = pressed ? shape_part(force, k, under) : 0.0;
    error.thickness = pressed ? thickness_part(force[k].force, under) : 0.0;
    error.half.push_back(std::hypot(error.shape, error.thickness));
  }
  return error;
}

namespace {

// Overlap of a tool with the surface: centres of small triangles that divide each triangle, and their areas
// normal to the press direction [m, m^2].
struct Overlap {
  std::vector<Vec3> place;
  std::vector<double> area;
};

void add_overlapped(const ToolShape& shape, const ToolPose& pose, const Mat3& corner, double area,
                    Overlap& found) {
  constexpr int cuts = 4;
  for (int i = 0; i < cuts; ++i)
    for (int j = 0; i + j < cuts; ++j)
      for (const bool turned : {false, true}) {
        if (turned && i + j + 1 == cuts) continue;
        const double third = turned ? 2.0 / 3.0 : 1.0 / 3.0, a = (i + third) / cuts, b = (j + third) / cuts;
        const Vec3 x =
            corner.col(0) + a * (corner.col(1) - corner.col(0)) + b * (corner.col(2) - corner.col(0));
        if (distance_to_tool(shape, pose, x).distance >= 0.0) continue;
        found.place.push_back(x);
        found.area.push_back(area / (cuts * cuts));
      }
}

Overlap overlap_of(const RigidBody& indenter, const Surface& surface, const Vec3& approach, double depth) {
  ToolPose pose = indenter.pose;
  pose.tip += depth * approach;
  const double reach = 2.0 * indenter.shape.radius;
  Overlap found;
  for (Index t = 0; t < surface.triangles.cols(); ++t) {
    const Mat3 corner = 1e-3 * surface.vertex_mm(Eigen::all, surface.triangles.col(t));
    const Vec3 middle = corner.rowwise().mean();
    if ((middle - indenter.pose.tip).norm() > reach + (corner.col(0) - middle).norm()) continue;
    const double across =
        -0.5 * (corner.col(1) - corner.col(0)).cross(corner.col(2) - corner.col(0)).dot(approach);
    if (across > 0.0) add_overlapped(indenter.shape, pose, corner, across, found);  // it faces the tool
  }
  return found;
}

// Root mean square distance, along the press direction, from the best-fitting quadric in scaled coordinates.
double roughness_of(const Overlap& overlap, const Vec3& tip, const Vec3& approach, double radius) {
  using Quadric = Eigen::Matrix<double, 6, 1>;
  const Vec3 right = approach.unitOrthogonal(), ahead = approach.cross(right);
  const auto terms = [&](const Vec3& x) {
    const double u = right.dot(x - tip) / radius, v = ahead.dot(x - tip) / radius;
    return Quadric(1.0, u, v, u * u, u * v, v * v);
  };
  Eigen::Matrix<double, 6, 6> normal = 1e-9 * Eigen::Matrix<double, 6, 6>::Identity();
  Quadric right_side = Quadric::Zero();
  const double all = std::accumulate(overlap.area.begin(), overlap.area.end(), 0.0);
  for (std::size_t k = 0; k < overlap.place.size(); ++k) {
    const Quadric term = terms(overlap.place[k]);
    normal += overlap.area[k] / all * term * term.transpose();
    right_side += overlap.area[k] / all * approach.dot(overlap.place[k] - tip) * term;
  }
  const Quadric fitted = normal.ldlt().solve(right_side);
  double sum = 0.0;
  for (std::size_t k = 0; k < overlap.place.size(); ++k) {
    const double off = approach.dot(overlap.place[k] - tip) - fitted.dot(terms(overlap.place[k]));
    sum += overlap.area[k] / all * off * off;
  }
  return std::sqrt(sum);
}

// Radius at which a tool's lower surface is at this height above its tip [m].
double radius_at(const ToolShape& shape, double height) {
  double low = 0.0, high = shape.radius;
  for (int k = 0; k < 60; ++k) {
    const double r = 0.5 * (low + high);
    (height_of_tool(shape, r) < height ? low : high) = r;
  }
  return high;
}

}  // namespace

void look_under(const RigidBody& indenter, const Surface& surface, const Vec3& approach, double depth,
                UnderTool& under) {
  const Overlap overlap = overlap_of(indenter, surface, approach, depth);
  const double area = std::accumulate(overlap.area.begin(), overlap.area.end(), 0.0);
  if (!(area > 0.0)) return;
  const double r = std::min(std::sqrt(area / std::numbers::pi), radius_at(indenter.shape, depth));
  under.curvature = std::max(0.0, 2.0 * (depth - height_of_tool(indenter.shape, r)) / (r * r));
  under.roughness = roughness_of(overlap, indenter.pose.tip, approach, r);
}

namespace {

std::string why_no_image_error(const Scene& scene, const LoadedModel& result) {
  if (!result.origin || result.voxel_edges_mm.isZero(0.0)) return "the model was made without its image";
  if (result.time != TimeMode::quasi_static) return "it was calibrated for equilibrium, not for dynamics";
  if (!scene.walls.empty() || !scene.steps.empty() || !has_tool_alone(scene))
    return "it was calibrated for one tool, pressed straight in once";
  if (result.loading.indenter && !has_error_estimate(result.loading.indenter->shape))
    return fmt::format("it was not calibrated for {}", in_words(result.loading.indenter->shape));
  return {};
}

// Finds the thickness along the press direction, and whether the base is at its end.
void look_through(const BodySurface& body, const Boundary& boundary, UnderTool& under) {
  const double mm = boundary.radius * body_under_patch(body, boundary, 0.0).thickness;
  const BodySurface::Closest leaves = body.closest(boundary.centre + mm * boundary.approach);
  under.thickness = 1e-3 * mm;
  under.is_free_below = !on_base(boundary, leaves.place, body.normal().col(leaves.triangle));
}

}  // namespace

ImageError image_error_of(const Scene& scene, const Result& result) {
  if (std::string none = why_no_image_error(scene, result); !none.empty())
    return {.unknown = std::move(none)};
  const ToolPlace& tool = result.model.tool;
  const std::vector<ForceSample>& force = result.history.force;
  UnderTool under{.voxel = 1e-3 * (result.voxel_edges_mm.transpose() * tool.approach).norm(),
                  .contact = tool.radius,
                  .has_contact = result.loading.indenter != nullptr};
  look_through(result.origin->organ.body->surface, result.origin->boundary, under);
  if (under.has_contact && !force.empty() && force.back().depth > 0.0) {
    const RigidBody& indenter = *result.loading.indenter;
    under.contact = contact_radius(indenter.shape, force.back().depth);
    look_under(indenter, result.model.surface, tool.approach, force.back().depth, under);
  }
  return image_error(force, under);
}

}  // namespace dimple
