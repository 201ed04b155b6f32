#pragma once

#include <optional>
#include <string>
#include <vector>

#include "apps/run/config.hpp"
#include "solver/march.hpp"
#include "solver/terms/touching_tool.hpp"

namespace dimple {

/// The tool that touches the body, in place of the circle; nothing: the circle. Throws
/// UsageError: config.tool.shape is neither `circle` nor a shape with lengths that a tool can have.
std::optional<ToolShape> tool_of(const Config& config);
/// The same of a shape that stands in another option.
std::optional<ToolShape> tool_of(const std::string& shape, const std::string& option);

/// The longest step of the load in equilibrium, in radii of the tool. Throws UsageError: it is too short, or
/// as tool_of() does.
double longest_step_radii(const Config& config);

/// "a sphere of 5 mm radius".
std::string in_words(const ToolShape& shape);

/// Length from which a tool is made, by its name in --tool.
struct ToolLength {
  std::string name;
  double value;        ///< [m]
  double doubt;        ///< relative uncertainty; 0: certain
  double least, most;  ///< [m] beside the other lengths
};
/// Of a mesh or a wall none.
std::vector<ToolLength> lengths_of(const ToolShape& shape);
/// The same tool, made with another of its lengths [m].
ToolShape with_length(const ToolShape& shape, std::size_t which, double length);

/// Of a punch's radius its edge is rounded by so much at least: the pressure at an edge that is nearly sharp
/// is nearly unbounded.
inline constexpr double sharpest_edge = 0.1;

/// Coulomb's coefficient under a tool that touches; infinite: `stick`. Throws UsageError:
/// config.tool.friction is neither a number from 0 to 10 nor that word.
double friction_of(const Config& config);
double friction_of(const std::string& friction, const std::string& option);
/// "without friction".
std::string friction_in_words(double friction);

/// Where a tool touches and nobody has given a depth it goes in by 0.8 of its radius at most: deeper down it
/// sinks in towards its equator, or tissue folds at its edge. Throws as tool_of().
void resolve_depth(Config& config);
/// ", as deep as 0.8 of its radius, as no depth was given"; nothing where one was.
std::string depth_of_tool_in_words(const Config& config);

/// Before anything is built: throws UsageError where a tool that touches is shorter than its way, or a step
/// of the load too short.
void check_tool(const Config& config);
/// A tool that touches and goes deeper than it is long is refused: UsageError.
void require_tool_as_long(const Config& config, double depth_mm);
/// Likewise of a tool that turns, of which so much [m] is below its first touch along its own axis; of one
/// that was drawn its distances must be known there.
void require_tool_as_long_turned(const Config& config, double below);

/// The tool where it first touches the model, and the part of the surface that it may touch; null: the
/// circle. Throws ModelError as contact_surface() does.
std::shared_ptr<const Touch> touch_of(const Config& config, const Model& model);
/// The same of another tool than the options name.
std::shared_ptr<const Touch> touch_of(const Config& config, const Model& model, const ToolShape& shape);

/// Forces [N] at depths [m] of the curve of a tool that touches: between two samples they follow a power of
/// the depth, as they do at the beginning (1.5 of a sphere, 1 of a flat end), before the first and after the
/// last that of the samples next to it. Nothing where it does not touch yet.
std::vector<double> forces_of_touch(const std::vector<ForceSample>& curve, const std::vector<double>& depth);

/// Of a punch: with 1500 nodes the surface came 0.1 mm into an edge of 1 mm at 2.7 mm, and no equilibrium was
/// found at 4 mm; with 4000 it stayed within 1 % of finite elements to there. 0: no more than of the circle.
Index fewest_nodes_under_tool(const Config& config);

/// Within so far of its axis [m] a tool that is pushed in by `depth` [m] may touch the body: the surface that
/// was beside it at first comes to lie along its side.
double reach_of_contact(const ToolShape& shape, double depth);

}  // namespace dimple
