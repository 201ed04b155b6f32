#pragma once

#include <map>
#include <string>
#include <vector>

#include "apps/scene/scene.hpp"

namespace dimple {

/// x,y,z in LPS, or one number along the push.
Vec3 way_of(const std::vector<double>& move, const Vec3& push);

/// The steps for the solver, of a tool that is pushed along its push from its centre, and of others along
/// theirs.
std::vector<Step> steps_of(const Scene& scene, const ToolPlace& tool,
                           const std::map<std::string, Vec3>& push_of_others = {});

/// Throws UsageError: a step goes further than twenty times the size of the body, whose nodes are given [m].
void require_near(const std::vector<Step>& steps, const Points& body);

/// How far the tool, which does not turn, has come after each step [m].
std::vector<Vec3> way_of_tool(const Scene& scene, const Vec3& push);

/// The same of a tool that touches and may turn, first at its centre: where it turns its tip by and by, and
/// after each of these places one as far up its axis as it may touch.
std::vector<Vec3> swept(const Scene& scene, const ToolPlace& tool);

/// The deepest that the tool comes [m], along its push; and what of the tool is then below where it first
/// touched, along its own axis.
double deepest(const Scene& scene, const ToolPlace& tool);
double most_of_tool_below(const Scene& scene, const ToolPlace& tool);

/// "press: the tool moves (0, 0, -4) mm".
std::string in_words(const Step& step);

/// The sample with the largest force along the push, in size, and the step that it is in. `force` has one at
/// least.
struct LargestForce {
  ForceSample sample = {};
  std::string step;
};
LargestForce largest_force(const Loading& loading, const std::vector<ForceSample>& force);

/// The force on the tool across its push [N].
double lateral_force(const ForceSample& sample, const Vec3& push);

}  // namespace dimple
