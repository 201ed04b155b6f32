#pragma once

#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "io/draw/zero_pieces.hpp"
#include "io/types.hpp"

namespace dimple {

/// What overview.png shows. Positions in LPS mm.
struct Overview {
  std::string title;                       ///< one line, e.g. "brain.nrrd: 71.2 mN at 8.00 mm"
  std::vector<std::string> warnings = {};  ///< below the title, as many as there is room for
  std::vector<std::string> lines;  ///< a few facts: counts, spacing, base and circle with their reasons
  Points nodes_mm;                 ///< [3xN] at rest
  Points displacement_mm;          ///< [3xN] at the end
  std::vector<int> node_set;       ///< [N] bit 1 base, bit 2 tool circle
  Points points_mm;                ///< [3xQ] integration points, shown as + in a thin slab through the circle
  Points surface_mm;               ///< [3xM] the organ's surface at rest
  Points surface_displacement_mm;  ///< [3xM] at the end
  Triangles surface_triangles;     ///< [3xT]
  Points tool_mm = {};             ///< [3xP] the tool's closed surface at rest; none: it is not drawn
  Triangles tool_triangles = {};   ///< [3xU]
  Vec3 centre_mm;                  ///< of the circle
  Vec3 push;                       ///< unit direction in which the circle moves
  double radius_mm = 0.0;          ///< of the circle
  std::string tool = {};           ///< words for a tool that touches; empty: it is the circle
  Vec3 carried_mm = Vec3::Zero();  ///< displacement of the circle under loads alone: the tool is there
  Vec3 aside_mm = Vec3::Zero();    ///< how far the tool has come across its push
  /// A place on the tool's axis at the end, through which the section shows what is there at the end; not a
  /// number: centre_mm.
  Vec3 axis_mm = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
  std::vector<double> depth_mm;  ///< force curve
  std::vector<double> force_N;
  std::vector<double> time_s = {};     ///< of a scene of steps, whose forces are shown over time; else empty
  std::string moment = "at the end";   ///< when the body and the tool are so: "at 1.5 s"
  std::vector<double> lateral_N = {};  ///< likewise: the force across the push
  std::vector<double> half_N;          ///< half the width of the band about it; empty: not known
  double image_half_N = -1.0;  ///< half-width at the end by the image's resolution; negative: not known
  std::vector<double> beside_depth_mm, beside_force_N;  ///< another curve, as dots; empty: none
  std::string beside;                                   ///< its word in the legend
  GapAt walls = {};                                     ///< what is rigid beside the body; empty: nothing
  bool two_threads = false;                             ///< draw with a second one; the same picture
};

/// What stands at the end of the force curve: "75.4 mN at 8.00 mm, +- 8.03 %, voxels +- 1.60 %"; over time
/// "75.4 mN largest, 0 N at the end".
std::string end_of_curve(const Overview& overview);

/// Draws the overview, 1600 x 1200 pixels, PNG: the node cloud, a section (of a body in which the tool would
/// be tiny, what is near the tool), the deformed surface, the force curve. Up in the picture is against the
/// push; the body's longest direction across the push lies along the picture. Draws what is there: without
/// triangles the nodes, without a curve a note. Needs no display; the same input gives the same bytes. Throws
/// OutputError, and std::invalid_argument for triangles of points that do not exist.
void write_overview(const std::filesystem::path& file, const Overview& overview);

/// The body at the end alone, with the tool: the bytes of a PNG, 1040 x 640 pixels. Throws as
/// write_overview().
std::string body_png(const Overview& overview);

}  // namespace dimple
