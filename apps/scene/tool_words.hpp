#pragma once

#include <optional>
#include <string>
#include <vector>

#include "solver/terms/tool_shape.hpp"

namespace dimple {

/// Shape of a tool that touches, by its word in an option: sphere:5mm, FILE.stl. Nothing: the circle. Throws
/// UsageError: neither `circle` nor a shape with lengths that a tool can have; InputError of a file.
std::optional<ToolShape> tool_named(const std::string& shape, const std::string& option);

/// Coulomb's coefficient by its word; infinite: `stick`. Throws UsageError: neither a number from 0 to 10 nor
/// that word.
double friction_named(const std::string& friction, const std::string& option);
/// "without friction".
std::string friction_in_words(double friction);

/// "a sphere of 5 mm radius".
std::string in_words(const ToolShape& shape);
/// Shapes that have a word in --tool, as a user writes them: "sphere:5mm".
std::vector<std::string> tool_examples();
/// Whether the error estimates were calibrated with tools of its kind.
bool has_error_estimate(const ToolShape& shape);

/// Length [m] or angle [rad] from which a tool is made, by its name in --tool.
struct ToolLength {
  std::string name;
  double value;
  std::string unit;    ///< as it is written: mm or deg
  double doubt;        ///< relative uncertainty; 0: certain
  double least, most;  ///< beside the other lengths

  /// A value of it in its unit, and as text: "5.00 mm".
  double in_unit(double of_value) const;
  std::string in_words(double of_value) const;
};
/// Of a mesh or a wall none.
std::vector<ToolLength> lengths_of(const ToolShape& shape);
/// The same tool, made with another of its lengths [m] or angles [rad].
ToolShape with_length(const ToolShape& shape, std::size_t which, double length);

/// Of a punch's radius its edge is rounded by so much at least: the pressure at an edge that is nearly sharp
/// is nearly unbounded.
inline constexpr double sharpest_edge = 0.1;

}  // namespace dimple
