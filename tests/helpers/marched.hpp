#pragma once

#include <string>
#include <vector>

#include "preprocess/build_model.hpp"
#include "solver/solve.hpp"

namespace dimple {

/// Contact of a tool with the top of a body, and the refinement of nodes around it. Lengths in mm.
struct OnTop {
  Index nodes = 0;
  double contact_radius = 0.0;
  std::string at = "0,0,top";
  bool whole_patch = true;
  std::vector<Vec3> displacement = {};  ///< displacement of the tool after each step
};

/// Body on its lower side as the base.
inline Model model_with_tool(const BodySurface& body, const OnTop& requested) {
  ModelOptions options;
  options.node_set.count = requested.nodes;
  options.node_set.grading.whole_patch = requested.whole_patch;
  options.boundary = {.base = "inferior",
                      .indent_at = requested.at,
                      .contact_radius_mm = requested.contact_radius,
                      .path_of_tool = requested.displacement};
  return build_model(body, options).model;
}

/// Triangles of a model's surface that face a direction.
inline std::vector<Index> triangles_facing(const Model& model, const Vec3& direction) {
  std::vector<Index> chosen;
  const Surface& surface = model.surface;
  for (Index t = 0; t < surface.triangles.cols(); ++t) {
    const auto corner = [&](int i) { return Vec3(surface.vertex_mm.col(surface.triangles(i, t))); };
    if ((corner(1) - corner(0)).cross(corner(2) - corner(0)).normalized().dot(direction) > 0.9)
      chosen.push_back(t);
  }
  return chosen;
}

/// Results of a quasi-static march.
inline History marched(const ForceSystem& tissue, const Model& model, const Loading& loading,
                       const SolverOptions& how = {.frames = 1}, const Observer& observer = {},
                       const MarchState* from = nullptr) {
  History history;
  solve(TimeMode::quasi_static, tissue, model, loading, how, observer, history, from);
  return history;
}

}  // namespace dimple
