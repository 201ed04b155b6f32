#pragma once

#include <optional>
#include <string>
#include <vector>

#include "solver/terms/tool_shape.hpp"

namespace dimple {

/// Shape of a contacting tool: sphere:5mm, FILE.stl. Nothing: `bonded_patch`. Throws UsageError: neither
/// `bonded_patch` nor a valid shape; InputError: a file.
std::optional<ToolShape> tool_named(const std::string& shape, const std::string& option);

/// Coulomb's coefficient; infinite for `stick`. Throws UsageError: neither that nor a number from 0 to 10.
double friction_named(const std::string& friction, const std::string& option);
/// Friction as text: "without friction".
std::string friction_in_words(double friction);

/// Shape as text: "a sphere of 5 mm radius".
std::string in_words(const ToolShape& shape);
/// Examples of --tool, as a user writes them: "sphere:5mm".
std::vector<std::string> tool_examples();
/// True if the error estimates were calibrated with tools of this kind.
bool has_error_estimate(const ToolShape& shape);

/// Length [m] or angle [rad] from which a tool is made, by its name in --tool.
struct ToolLength {
  std::string name;
  double value;
  std::string unit;    ///< in --tool: mm or deg
  double doubt;        ///< relative uncertainty; 0: certain
  double least, most;  ///< for the given other lengths

  /// Value in that unit, and as text: "5.00 mm".
  double in_unit(double of_value) const;
  std::string in_words(double of_value) const;
};
/// Lengths and angles of a tool; none for a mesh or a wall.
std::vector<ToolLength> lengths_of(const ToolShape& shape);
/// Copy of the tool with one of its lengths [m] or angles [rad] replaced.
ToolShape with_length(const ToolShape& shape, std::size_t which, double length);

/// Smallest rounding of a punch's edge, in radii of the punch: the pressure at a nearly sharp edge is nearly
/// unbounded.
inline constexpr double sharpest_edge = 0.1;

}  // namespace dimple
