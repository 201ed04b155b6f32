#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/scene/scene.hpp"
#include "apps/scene/tool_words.hpp"
#include "solver/march.hpp"
#include "solver/terms/touching_tool.hpp"

namespace dimple {

/// ", as deep as 0.8 of its radius, as no depth was given"; nothing where one was.
std::string depth_of_tool_in_words(const Scene& scene);

/// Throws UsageError: so much [m] of a tool that turns lies below its first touch, along its own axis, and it
/// is shorter; of one that was drawn distances are known for a part of its length.
void require_tool_as_long_turned(const Scene& scene, double below);

/// The tool where it first touches the model, and the part of the surface that it may touch; null: the
/// circle. Throws ModelError as contact_surface() does.
std::shared_ptr<const Touch> touch_of(const Scene& scene, const Model& model);
/// The same of another tool than the options name.
std::shared_ptr<const Touch> touch_of(const Scene& scene, const Model& model, const ToolShape& shape);

/// Forces [N] at depths [m] of the curve of a tool that touches: between two samples they follow a power of
/// the depth, as they do at the beginning (1.5 of a sphere, 1 of a flat end), before the first and after the
/// last that of the samples next to it. Nothing where it does not touch yet.
std::vector<double> forces_of_touch(const std::vector<ForceSample>& curve, const std::vector<double>& depth);

/// Of a punch: with 1500 nodes the surface came 0.1 mm into an edge of 1 mm at 2.7 mm, and no equilibrium was
/// found at 4 mm; with 4000 it stayed within 1 % of finite elements to there. 0: no more than of the circle.
Index fewest_nodes_under_tool(const Scene& scene);

/// Within so far of its axis [m] a tool that is pushed in by `depth` [m] may touch the body: the surface that
/// was beside it at first comes to lie along its side.
double reach_of_contact(const ToolShape& shape, double depth);

}  // namespace dimple
