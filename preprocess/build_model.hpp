#pragma once

#include <map>
#include <vector>

#include "preprocess/make_model.hpp"
#include "preprocess/nodes/integration_grid.hpp"
#include "preprocess/nodes/node_set.hpp"
#include "preprocess/scene/boundary_conditions.hpp"
#include "preprocess/stages.hpp"
#include "preprocess/surface/label_surface.hpp"

namespace dimple {

struct ModelOptions {
  Scheme scheme = converging;
  NodeSetOptions node_set{.grading = converging.grading};
  GridOptions grid{.ratio = converging.points_per_node};
  BoundaryOptions boundary;
};
/// Options with the scheme's own grading and points per node.
inline ModelOptions options_of(const Scheme& scheme) {
  ModelOptions options;
  options.scheme = scheme;
  options.node_set.grading = scheme.grading;
  options.grid.ratio = scheme.points_per_node;
  return options;
}

/// Report on what was built, for people: printed, and kept in summary.json. Lengths in mm.
struct ModelReport {
  double surface_volume_mm3 = 0.0, surface_area_mm2 = 0.0;
  double grid_volume_mm3 = 0.0, cell_mm = 0.0;
  Index clipped = 0, merged = 0;
  double spacing_mm = 0.0,
         patch_edge_spacing_mm = 0.0;  ///< requested far from the contact patch, and on its edge
  double largest_spacing_mm = 0.0;     ///< of all distances from a node to the nearest other
  Index surface_nodes = 0, patch_nodes = 0, patch_edge_nodes = 0;
  Evenness evenness;
  Boundary boundary;  ///< in the surface's own frame
  StageTimes stages;
};

/// Nodes, integration points, base and contact patch of a body. Cells are split where `label_at` changes.
///
/// Positions become LPS metres here, rounded to a picometre, and volumes to a billionth of a mm^3: a model
/// written to a file in mm and read again is the same, bit for bit. Throws ModelError: no node on the base,
/// the patch reaches the base, too many nodes for the memory ("memory"), too few layers of nodes under the
/// patch ("thin"). Throws Stopped, and what the steps throw.
struct Discretised {
  Discretisation places;
  ModelReport report;
};
Discretised discretise(const BodySurface& body, const ModelOptions& options, const LabelAt& label_at = {});

/// Base and tool position of a body, and the sizing of its nodes: independent of the number of nodes, and
/// much of the time of a small model. `known`: see find_boundary(). `uncut`: the same body before it was cut,
/// on which base and tool are found; none: it was not.
struct Site {
  Boundary boundary;
  Sizing sizing;    ///< with the spacing at the edge of the patch that the options give
  Boundary graded;  ///< the patch with the finest nodes around it: the same, or a round tool's contact
  std::shared_ptr<const BodySurface> uncut = {};  ///< the body before it was cut; null: it was not
};
Site find_site(const BodySurface& body, const ModelOptions& options, const Boundary* known = nullptr,
               const BodySurface* uncut = nullptr);
/// Overload for a site found for the same body under options with other numbers of nodes and points only.
Discretised discretise(const BodySurface& body, const ModelOptions& options, const LabelAt& label_at,
                       const Site& site);

/// Label of the image's voxel at a place in the surface's frame. Outside, or on background: of the nearest
/// foreground voxel within two voxels, since the smooth surface is partly outside of the labels. `image` must
/// outlive it. `to_world`: of another frame; `labels`: the only ones that count, none: all.
LabelAt label_finder(const LabelImage& image, const BodySurface& body);
LabelAt label_finder(const LabelImage& image, const Eigen::Isometry3d& to_world,
                     const std::vector<int>& labels = {});

/// Tissue of each label, from 0 (all labels that are not listed), and density of each tissue [kg/m^3].
struct TissueOptions {
  std::map<int, int> of_label = {};
  std::vector<double> density = {1000.0};
};
/// [Q] the tissue of each point.
Eigen::VectorXi tissue_of_points(const Discretisation& places, const TissueOptions& tissues);

/// Model ready for a solver, from an image or from a body's surface, with the reports of all steps.
///
/// `labels`: those of the image that form the body; empty: all foreground. Throws what make_body_surface(),
/// discretise() and make_model() throw.
struct BuiltModel {
  Model model;
  ModelReport report;
  SegmentReport segment;
};
BuiltModel build_model(const LabelImage& image, const std::vector<int>& labels = {},
                       const ModelOptions& options = {}, const TissueOptions& tissues = {});
BuiltModel build_model(const BodySurface& body, const ModelOptions& options = {},
                       const TissueOptions& tissues = {}, const LabelAt& label_at = {});

}  // namespace dimple
