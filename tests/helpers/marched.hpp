#pragma once

#include <string>
#include <vector>

#include "preprocess/build_model.hpp"
#include "solver/solve.hpp"

namespace dimple {

/// Where a tool touches the top of a body, and nodes that are fine around there. Lengths in mm.
struct OnTop {
  Index nodes = 0;
  double contact_radius = 0.0;
  std::string at = "0,0,top";
  bool whole_circle = true;
  std::vector<Vec3> way = {};  ///< of the tool after its steps
};

/// A body that stands on its lower side.
inline Model standing(const BodySurface& body, const OnTop& wanted) {
  ModelOptions options;
  options.cloud.count = wanted.nodes;
  options.cloud.grading.whole_circle = wanted.whole_circle;
  options.boundary = {.base = "inferior",
                      .indent_at = wanted.at,
                      .contact_radius_mm = wanted.contact_radius,
                      .way_of_tool = wanted.way};
  return build_model(body, options).model;
}

/// What a quasi-static march gives.
inline History marched(const ForceSystem& tissue, const Model& model, const Loading& loading,
                       const SolverOptions& how = {.frames = 1}, const Observer& observer = {},
                       const MarchState* from = nullptr) {
  History history;
  solve(TimeMode::quasi_static, tissue, model, loading, how, observer, history, from);
  return history;
}

}  // namespace dimple
