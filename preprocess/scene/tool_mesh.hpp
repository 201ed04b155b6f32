#pragma once

#include <string>
#include <vector>

#include "preprocess/surface/distance_grid.hpp"

namespace dimple {

/// A rigid tool that was drawn in another program, in its own frame: z away from the body, the tip (its
/// lowest point) at z = 0, and x = y = 0 in the middle of its box.
struct ToolMesh {
  std::string name;       ///< of its file
  DistanceGrid distance;  ///< around its lower part
  /// [m] least height of its lower surface above the tip at even distances from the axis, from 0 to half its
  /// width; infinite where there is none.
  std::vector<double> lower;
  Points vertex;        ///< [3xV] of its whole surface [m]
  Triangles triangles;  ///< facing outward
  double length = 0.0;  ///< from the tip to its upper end [m]
  double width = 0.0;   ///< twice the largest distance of its surface from the axis [m]
  double volume_mm3 = 0.0;
  bool turned = false;  ///< its triangles, or some of them, faced inward in the file
};

/// Description of a drawing for messages.
struct Drawing {
  std::string name;  ///< of its file
  std::string what = "tool";
  std::string where = "--tool (tool.shape)";
};

/// Makes all triangles face outward; `turned`: some did not. Throws InputError: it has a border or crosses
/// itself, each with a place; or its size cannot be in mm. Throws Stopped.
struct TriangleMesh;
TriangleMesh closed_drawing(const Drawing& of, const Points& vertex_mm, const Triangles& triangles,
                            bool& turned);

/// `vertex_mm`: z away from the body. `name`: of the file, for messages. Distances are sampled from the tip
/// to two widths above it and a quarter of the width around. Throws as closed_drawing().
ToolMesh tool_mesh(const Points& vertex_mm, const Triangles& triangles, const std::string& name);

}  // namespace dimple
