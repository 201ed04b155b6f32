#pragma once

#include <map>
#include <string>
#include <vector>

#include "apps/scene/scene.hpp"

namespace dimple {

/// Displacement from x,y,z in LPS, or from one number along the press direction.
Vec3 displacement_of(const std::vector<double>& move, const Vec3& approach);

/// Steps for the solver. The tool moves along its press direction from its centre, others along theirs.
std::vector<Step> steps_of(const Scene& scene, const ToolPlace& tool,
                           const std::map<std::string, Vec3>& approach_of_others = {});

/// Throws UsageError: a step is longer than twenty times the size of the body, whose nodes are given [m].
void require_near(const std::vector<Step>& steps, const Points& body);

/// Displacement of a tool that does not turn, after each step [m].
std::vector<Vec3> path_of_tool(const Scene& scene, const Vec3& approach);

/// Displacements of a contacting tool that may turn, first at its centre: those of its tip along each turn.
/// After a turn each is followed by the highest point of its axis that may be in contact.
std::vector<Vec3> swept(const Scene& scene, const ToolPlace& tool);

/// Largest depth of the tool along its press direction [m]. The second is the largest length of the tool
/// below its first contact, along its own axis [m].
double deepest(const Scene& scene, const ToolPlace& tool);
double most_of_tool_below(const Scene& scene, const ToolPlace& tool);

/// "press: the tool moves by (0, 0, -4) mm".
std::string in_words(const Step& step);

/// Sample with the largest force along the press direction, in size, and its step. `force` has at least one
/// sample.
struct LargestForce {
  ForceSample sample = {};
  std::string step;
};
LargestForce largest_force(const Loading& loading, const std::vector<ForceSample>& force);

/// Lateral force on the tool, normal to its press direction [N].
double lateral_force(const ForceSample& sample, const Vec3& approach);

}  // namespace dimple
