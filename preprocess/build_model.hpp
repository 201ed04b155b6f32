#pragma once

#include <cmath>

#include "preprocess/boundary_conditions.hpp"
#include "preprocess/consistency.hpp"
#include "preprocess/integration_grid.hpp"
#include "preprocess/lumped_mass.hpp"
#include "preprocess/node_cloud.hpp"
#include "preprocess/stages.hpp"
#include "preprocess/support.hpp"

namespace dimple {

struct ModelOptions {
  CloudOptions cloud;
  GridOptions grid;
  BoundaryOptions boundary;
  /// Cells that follow the nodes and have a spread, instead of the paper's even grid of single points.
  bool averaged_cells = false;
};

/// What was built, for people: printed, and kept in summary.json. Lengths in mm.
struct ModelReport {
  double surface_volume_mm3 = 0.0, surface_area_mm2 = 0.0;
  double grid_volume_mm3 = 0.0, cell_mm = 0.0;
  Index clipped = 0, merged = 0;
  double spacing_mm = 0.0, rim_spacing_mm = 0.0;  ///< far from the circle, and on its rim
  Index surface_nodes = 0, circle_nodes = 0, rim_nodes = 0;
  Evenness evenness;
  Boundary boundary;  ///< in the surface's own frame
  Stages stages;
};

/// Nodes, integration points, base and circle of a body: everything of a Model but supports, dphi and masses.
///
/// Positions become LPS metres here, rounded to a picometre, and volumes to a billionth of a mm^3:
/// a model written to a file in mm and read again is the same, bit for bit. Throws ModelError: no node on the
/// base, the circle reaches the base, more nodes than memory is there for ("memory"), the body too thin for
/// its nodes under the circle ("thin"); Stopped; and what the steps throw.
struct BuiltModel {
  Model model;
  ModelReport report;
};
BuiltModel build_model(const BodySurface& body, const ModelOptions& options, const LabelAt& label_at = {});

/// Adds what follows from the places alone: supports, gradients, masses, and where there is a spread the
/// patches and, if the `surface` is known, gradients that are consistent with it. Per point: `tissue`, its
/// number, and `density` [kg/m^3]. Throws ModelError where a tenth of the supports had to be enlarged.
struct Completion {
  SupportReport support;
  ConsistencyReport consistency;
  Stages stages;
};
Completion complete_model(Model& model, const SupportOptions& options, const Eigen::VectorXi& tissue,
                          const Eigen::VectorXd& density, const SurfacePieces& surface = {});

/// Lengths and volumes on the grid that survives a file in mm. [mm] -> [m], [mm^3] -> [m^3], and back.
inline double metres(double mm) {
  return std::round(mm * 1e9) / 1e12;
}
inline double millimetres(double m) {
  return std::round(m * 1e12) / 1e9;
}
inline double square_metres(double mm2) {
  return std::round(mm2 * 1e9) / 1e15;
}
inline double square_millimetres(double m2) {
  return std::round(m2 * 1e15) / 1e9;
}
inline double cubic_metres(double mm3) {
  return std::round(mm3 * 1e9) / 1e18;
}
inline double cubic_millimetres(double m3) {
  return std::round(m3 * 1e18) / 1e9;
}

/// What was freed goes back to the system. The C library keeps it else: of millions of small lists, or of the
/// texts of large files, half a gigabyte at a hundred thousand nodes.
void give_back_memory();

}  // namespace dimple
