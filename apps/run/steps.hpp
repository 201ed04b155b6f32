#pragma once

#include <map>
#include <string>
#include <vector>

#include "apps/run/config.hpp"

namespace dimple {

/// Before anything is built: throws UsageError where a step moves nothing, what it names is not there, or
/// the tool and the depth are given twice.
void check_steps(const Config& config);

/// A step that cuts the body once something has moved.
struct CutStep {
  std::string name, cut;
  std::size_t after;            ///< so many of the steps that move something
  double toughness_J_m2 = 0.0;  ///< 0: not known
};
/// Steps that cut what has moved before; those before anything has moved cut at rest, see cuts.hpp.
std::vector<CutStep> cuts_after_moves(const Config& config);

/// load.depth_mm of a scene of steps follows from them: the deepest that the tool is pushed, or else the
/// longest way that anything has gone. Throws UsageError: another depth was given.
void resolve_steps(Config& config);

/// x,y,z in LPS, or one number along the push.
Vec3 way_of(const std::vector<double>& move, const Vec3& push);

/// The steps for the solver, of a tool that is pushed along its push from its centre, and of others along
/// theirs.
std::vector<Step> steps_of(const Config& config, const ToolPlace& tool,
                           const std::map<std::string, Vec3>& push_of_others = {});

/// Throws UsageError: a step goes further than twenty times the size of the body, whose nodes are given [m].
void require_near(const std::vector<Step>& steps, const Points& body);

/// Whether the tool turns in any of them.
bool turns(const Config& config);

/// How far the tool, which does not turn, has come after each step [m].
std::vector<Vec3> way_of_tool(const Config& config, const Vec3& push);

/// The same of a tool that touches and may turn, first at its centre: where it turns its tip by and by, and
/// after each of these places one as far up its axis as it may touch.
std::vector<Vec3> swept(const Config& config, const ToolPlace& tool);

/// The deepest that the tool comes [m], along its push; and what of the tool is then below where it first
/// touched, along its own axis.
double deepest(const Config& config, const ToolPlace& tool);
double most_of_tool_below(const Config& config, const ToolPlace& tool);

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
