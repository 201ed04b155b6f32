#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/scene/scene.hpp"
#include "apps/scene/tool_words.hpp"
#include "solver/march.hpp"
#include "solver/terms/rigid_contact.hpp"

namespace dimple {

/// Depth that was chosen from the tool's radius, for a sentence; empty if a depth was given.
std::string depth_of_tool_in_words(const Scene& scene);

/// Throws UsageError: `below` [m], the part of a turning tool below its first contact along its axis, exceeds
/// its length. A drawn tool has distances for a part of its length only.
void require_tool_as_long_turned(const Scene& scene, double below);

/// Tool at first contact with the model, and the surface it may contact; null: the bonded patch. Throws
/// ModelError as contact_surface() does.
std::shared_ptr<const RigidBody> indenter_of(const Scene& scene, const Model& model);
/// The contact of another tool than that of the options.
std::shared_ptr<const RigidBody> indenter_of(const Scene& scene, const Model& model, const ToolShape& shape);

/// Forces [N] at depths [m] of a contacting tool's curve. Between samples they follow a power of the depth,
/// as at first contact: 1.5 for a sphere, 1 for a flat end. Outside, the nearest samples give the power. Zero
/// before contact.
std::vector<double> contact_forces(const std::vector<ForceSample>& curve, const std::vector<double>& depth);

/// Least number of nodes; 0: no minimum. With 1500 nodes an edge of 1 mm of a punch penetrated by 0.1 mm at
/// 2.7 mm, without equilibrium at 4 mm. 4000 nodes were within 1 % of finite elements there.
Index fewest_nodes_under_tool(const Scene& scene);

/// Distance from its axis [m] within which a tool at `depth` [m] may be in contact: the surface around it
/// moves to its side.
double reach_of_contact(const ToolShape& shape, double depth);

}  // namespace dimple
