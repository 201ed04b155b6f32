#include "apps/run/tool.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "apps/run/steps.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/option_word.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

constexpr double power_of_a_round_tip = 1.5;  // Hertz

}  // namespace

std::string depth_of_tool_in_words(const Scene& scene) {
  if (!scene.given.depth_is_of_tool) return {};
  return fmt::format(
      ", pressed in by {}{}, as no --depth was given", length_in_words(scene.depth_mm),
      scene.depth_mm < Scene{}.depth_mm ? fmt::format(", {:g} of its radius", usual_depth_in_radii) : "");
}

void require_tool_as_long_turned(const Scene& scene, double below) {
  const ToolShape tool = scene.tool.value();
  const double known = tool.mesh ? std::min(2.0 * tool.mesh->width, tool.mesh->length) : tool.length;
  if (below <= known) return;
  throw UsageError({.fact = fmt::format("the tool turns until {} of it, along its axis, is below first "
                                        "contact, and its surface is defined to {} above its tip",
                                        length_in_words(1e3 * below), length_in_words(1e3 * known)),
                    .where = "step",
                    .why = tool.mesh ? "a mesh is sampled to two widths above its tip"
                                     : "the holder at its upper end is not modelled",
                    .remedy = "turn it less, press it less deep, or give a longer tool"});
}

Index fewest_nodes_under_tool(const Scene& scene) {
  const std::optional<ToolShape> tool = scene.tool;
  return tool && (tool->edge > 0.0 || tool->mesh) ? 4000 : 0;
}

std::vector<double> contact_forces(const std::vector<ForceSample>& curve, const std::vector<double>& depth) {
  std::vector<double> log_depth, log_force;
  for (const ForceSample& sample : curve)
    if (sample.depth > 0.0 && sample.force > 0.0) {
      log_depth.push_back(std::log(sample.depth));
      log_force.push_back(std::log(sample.force));
    }
  std::vector<double> force;
  for (const double d : depth) {
    if (!(d > 0.0) || log_depth.empty()) {
      force.push_back(0.0);
      continue;
    }
    const double x = std::log(d);
    const auto found = std::lower_bound(log_depth.begin(), log_depth.end(), x) - log_depth.begin();
    const std::size_t after = std::clamp<std::size_t>(static_cast<std::size_t>(found), 1,
                                                      std::max<std::size_t>(log_depth.size() - 1, 1));
    const double power = log_depth.size() < 2 ? power_of_a_round_tip
                                              : (log_force[after] - log_force[after - 1]) /
                                                    (log_depth[after] - log_depth[after - 1]);
    force.push_back(std::exp(log_force[after - 1] + power * (x - log_depth[after - 1])));
  }
  return force;
}

double reach_of_contact(const ToolShape& shape, double depth) {
  return shape.radius + std::max(0.5 * shape.radius, depth);
}

std::shared_ptr<const RigidBody> indenter_of(const Scene& scene, const Model& model) {
  const std::optional<ToolShape> shape = scene.tool;
  return shape ? indenter_of(scene, model, *shape) : nullptr;
}

std::shared_ptr<const RigidBody> indenter_of(const Scene& scene, const Model& model, const ToolShape& shape) {
  auto indenter = std::make_shared<RigidBody>();
  indenter->shape = shape;
  indenter->surface =
      contact_surface(model, reach_of_contact(shape, 1e-3 * scene.depth_mm),
                      turns(scene) ? swept(scene, model.tool) : path_of_tool(scene, model.tool.approach));
  indenter->pose = first_contact(shape, model.tool, indenter->surface);
  indenter->friction = scene.friction;
  return indenter;
}

}  // namespace dimple
