#pragma once

#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "io/draw/zero_pieces.hpp"
#include "io/types.hpp"

namespace dimple {

/// Content of overview.png. Positions in LPS mm.
struct Overview {
  std::string title;                       ///< one line, e.g. "brain.nrrd: 71.2 mN at 8.00 mm"
  std::vector<std::string> warnings = {};  ///< below the title, as many as there is room for
  std::vector<std::string> lines;  ///< a few facts: counts, spacing, base and patch with their reasons
  Points nodes_mm;                 ///< [3xN] at rest
  Points displacement_mm;          ///< [3xN] at the end
  std::vector<int> node_flags;     ///< [N] bit 1 base, bit 2 contact patch
  Points points_mm;                ///< [3xQ] integration points, shown as + in a thin slab through the patch
  Points surface_mm;               ///< [3xM] the organ's surface at rest
  Points surface_displacement_mm;  ///< [3xM] at the end
  Triangles surface_triangles;     ///< [3xT]
  Points tool_mm = {};             ///< [3xP] the tool's closed surface at rest; none: it is not drawn
  Triangles tool_triangles = {};   ///< [3xU]
  Vec3 centre_mm;                  ///< of the contact patch
  Vec3 approach;                   ///< unit vector: press direction
  double radius_mm = 0.0;          ///< of the contact patch
  std::string tool = {};           ///< words for a contacting tool; empty: the patch is bonded
  Vec3 carried_mm = Vec3::Zero();  ///< displacement of the patch under loads alone: the tool is there
  Vec3 aside_mm = Vec3::Zero();    ///< displacement of the tool across the press direction
  /// A place on the tool's axis at the end, through which the section is drawn; not a number: centre_mm.
  Vec3 axis_mm = Vec3::Constant(std::numeric_limits<double>::quiet_NaN());
  std::vector<double> depth_mm;  ///< force curve
  std::vector<double> force_N;
  std::vector<double> time_s = {};     ///< of a scene of steps, whose forces are shown over time; else empty
  std::string moment = "at the end";   ///< time of the state of body and tool: "at 1.5 s"
  std::vector<double> lateral_N = {};  ///< likewise: the force across the press direction
  std::vector<double> half_N, low_N;   ///< half-width of the error bounds, lower bound; empty: none
  double image_half_N = -1.0;  ///< half-width at the end by the image's resolution; negative: not available
  std::vector<double> compared_depth_mm, compared_force_N;  ///< another curve, as dots; empty: none
  std::string compared;                                     ///< its word in the legend
  GapAt walls = {};          ///< distance from rigid walls; empty: there are none
  bool two_threads = false;  ///< draw with a second one; the same picture
};

/// Text at the end of the force curve: "75.4 mN at 8.00 mm, +- 8.03 %, voxels +- 1.60 %"; over time "75.4 mN
/// largest, 0 N at the end".
std::string end_of_curve(const Overview& overview);

/// Draws the overview, 1600 x 1200 pixels, PNG: the nodes, a section, the deformed surface, the force curve.
/// If the tool would be tiny in the section, only its surroundings are shown. Up is against the press
/// direction; the body's longest direction across it is horizontal. Draws what is available: the nodes if
/// there are no triangles, a note if there is no curve. Needs no display; the same input gives the same
/// bytes. Throws OutputError, and std::invalid_argument for triangles of points that do not exist.
void write_overview(const std::filesystem::path& file, const Overview& overview);

/// The body at the end alone, with the tool: the bytes of a PNG, 1040 x 640 pixels. Throws as
/// write_overview().
std::string body_png(const Overview& overview);

}  // namespace dimple
