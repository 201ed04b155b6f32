#include "apps/run/other_tools.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "apps/run/steps.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "preprocess/surface/body_surface.hpp"
#include "solver/constraints.hpp"
#include "solver/guards.hpp"

namespace dimple {
namespace {

Report report_on(const std::string& name, const char* key, const std::string& fact, const std::string& why,
                 const std::string& remedy) {
  return {.fact = fmt::format("the tool '{}' {}", name, fact),
          .where = fmt::format("tool.{}.{}", name, key),
          .why = why,
          .remedy = remedy};
}

bool is_fixed(const Scene::FurtherTool& tool) {
  return std::all_of(tool.move_mm.begin(), tool.move_mm.end(), [](double d) { return d == 0.0; });
}

// Contact point on the surface nearest to the request [m], and the mean normal around it.
ToolPlace pose_of(const Scene::FurtherTool& tool, const BodySurface& surface) {
  const std::string& name = tool.name;
  const double radius = tool.shape.radius;
  const Vec3& requested = tool.at_mm;
  const double radius_mm = 1e3 * radius;
  const auto near = surface.closest(requested);
  const double away = (near.place - requested).norm();
  if (away > 2.0 * radius_mm)
    throw ModelError(report_on(name, "at_mm",
                               fmt::format("is to be in contact at {}, and the surface is {} away",
                                           in_words(requested), length_in_words(away)),
                               fmt::format("the nearest place of the surface is {}", in_words(near.place)),
                               "give at_mm on the surface or near to it, x,y,z in LPS mm"));
  Vec3 approach = Vec3::Zero();
  if (tool.direction) {
    approach = tool.direction->normalized();
  } else {
    for (Index t = 0; t < surface.triangles().cols(); ++t) {
      const auto corner = surface.triangles().col(t);
      const Vec3 middle = (surface.vertex().col(corner[0]) + surface.vertex().col(corner[1]) +
                           surface.vertex().col(corner[2])) /
                          3.0;
      if ((middle - near.place).norm() < radius_mm &&
          surface.normal().col(t).dot(surface.normal().col(near.triangle)) > 0.0)
        approach -= surface.triangle_area()[t] * surface.normal().col(t);
    }
    approach = approach.isZero(0.0) ? Vec3(-surface.normal().col(near.triangle)) : approach.normalized();
  }
  if (approach.dot(surface.normal().col(near.triangle)) > -0.2)
    throw ModelError(report_on(
        name, "direction", fmt::format("does not point into the body at {}", in_words(near.place)),
        fmt::format("the surface faces ({:.2f}, {:.2f}, {:.2f}) there", surface.normal()(0, near.triangle),
                    surface.normal()(1, near.triangle), surface.normal()(2, near.triangle)),
        "give a direction into the body, or leave it out"));
  return {1e-3 * near.place, approach, radius};
}

// Displacements after each of its steps, or for a load without any [m].
std::vector<Vec3> path_of(const Scene& scene, const Scene::FurtherTool& tool, const Vec3& approach) {
  std::vector<Vec3> path;
  Vec3 come = Vec3::Zero();
  for (const Scene::Step& step : scene.steps)
    if (step.moves == tool.name && !step.move_mm.empty())
      path.push_back(come += 1e-3 * displacement_of(step.move_mm, approach));
  if (scene.steps.empty() && !is_fixed(tool)) path.push_back(1e-3 * displacement_of(tool.move_mm, approach));
  return path;
}

double deepest_of(const std::vector<Vec3>& path, const Vec3& approach) {
  double depth = 0.0;
  for (const Vec3& come : path) depth = std::max(depth, come.dot(approach));
  return depth;
}

}  // namespace

std::vector<Vec3> places_of_other_tools(const Scene& scene) {
  std::vector<Vec3> places;
  for (const Scene::FurtherTool& tool : scene.further_tools) places.push_back(tool.at_mm);
  return places;
}

OtherTools other_tools_of(const Scene& scene, const Model& model, const std::vector<HeldSet>& supports) {
  OtherTools result;
  if (scene.further_tools.empty()) return result;
  if (model.surface.empty())
    throw ModelError({.fact = "a further tool needs a surface, and this model has none",
                      .where = "tool",
                      .why = "its files hold only nodes and points",
                      .remedy = "begin with the label image"});
  const BodySurface surface(model.surface.vertex_mm, model.surface.triangles);
  for (const Scene::FurtherTool& tool : scene.further_tools) {
    const std::string& name = tool.name;
    RigidBody tool_body;
    tool_body.shape = tool.shape;
    const ToolPlace at = pose_of(tool, surface);
    const std::vector<Vec3> path = path_of(scene, tool, at.approach);
    const double depth = deepest_of(path, at.approach);
    if (depth > tool_body.shape.length)
      throw UsageError(
          report_on(name, "move_mm",
                    fmt::format("is to be pressed in by {}, and is {} long", length_in_words(1e3 * depth),
                                length_in_words(1e3 * tool_body.shape.length)),
                    "the holder at its upper end is not modelled", "move it less, or give a longer tool"));
    // A tool at rest is pressed by the tissue that comes towards it.
    tool_body.surface = contact_surface(
        model, at, reach_of_contact(tool_body.shape, std::max(depth, tool_body.shape.radius)), path);
    tool_body.pose = first_contact(tool_body.shape, at, tool_body.surface);
    tool_body.friction = tool.friction;
    tool_body.name = name;
    tool_body.is_tool = true;
    require_free_under(tool_body, depth, supports, model);
    tool_body.motion = scene.steps.empty()
                           ? Vec3(1e-3 * displacement_of(tool.move_mm, at.approach) / (1e-3 * scene.depth_mm))
                           : Vec3::Zero();
    result.words.push_back(fmt::format(
        "{}: {}, {}; its tip at first contact at {}, direction ({:.2f}, {:.2f}, {:.2f}){}", name,
        in_words(tool_body.shape), friction_in_words(tool_body.friction), in_words(1e3 * tool_body.pose.tip),
        at.approach.x() + 0.0, at.approach.y() + 0.0, at.approach.z() + 0.0,
        scene.steps.empty() ? is_fixed(tool)
                                  ? "; it does not move"
                                  : fmt::format("; it moves with the tool, by ({:.4g}, {:.4g}, {:.4g}) mm",
                                                1e3 * path.back().x() + 0.0, 1e3 * path.back().y() + 0.0,
                                                1e3 * path.back().z() + 0.0)
                            : ""));
    result.rigid_body.push_back(std::move(tool_body));
  }
  return result;
}

void require_tools_apart(const Loading& loading) {
  std::vector<ToolNow> tools;
  if (loading.indenter) tools.push_back({*loading.indenter, loading.indenter->pose});
  for (const RigidBody& rigid : loading.walls)
    if (rigid.is_tool) tools.push_back({rigid, rigid.pose});
  if (std::optional<Report> report = overlap_of_tools(tools)) throw UsageError(*std::move(report));
}

std::string at_the_end_in_words(const std::string& name, const RigidContact::ContactSummary& now) {
  if (now.samples == 0) return name + ": not in contact at the end";
  const Written written = force_written(now.force.norm());
  return fmt::format("{}: the tissue's force on it is x {}, y {}, z {} {} (LPS) at the end", name,
                     written.number(now.force.x()), written.number(now.force.y()),
                     written.number(now.force.z()), written.unit);
}

}  // namespace dimple
