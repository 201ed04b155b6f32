#pragma once

#include <map>
#include <vector>

#include "preprocess/cloud/integration_grid.hpp"
#include "preprocess/cloud/node_cloud.hpp"
#include "preprocess/make_model.hpp"
#include "preprocess/scene/boundary_conditions.hpp"
#include "preprocess/stages.hpp"
#include "preprocess/surface/label_surface.hpp"

namespace dimple {

struct ModelOptions {
  Scheme scheme = converging;
  CloudOptions cloud{.grading = converging.grading};
  GridOptions grid{.ratio = converging.points_per_node};
  BoundaryOptions boundary;
};
/// With the nodes' grading and the points per node that the scheme has of itself.
inline ModelOptions options_of(const Scheme& scheme) {
  ModelOptions options;
  options.scheme = scheme;
  options.cloud.grading = scheme.grading;
  options.grid.ratio = scheme.points_per_node;
  return options;
}

/// What was built, for people: printed, and kept in summary.json. Lengths in mm.
struct ModelReport {
  double surface_volume_mm3 = 0.0, surface_area_mm2 = 0.0;
  double grid_volume_mm3 = 0.0, cell_mm = 0.0;
  Index clipped = 0, merged = 0;
  double spacing_mm = 0.0, rim_spacing_mm = 0.0;  ///< wanted far from the circle, and on its rim
  double largest_spacing_mm = 0.0;                ///< of all distances from a node to the nearest other
  Index surface_nodes = 0, circle_nodes = 0, rim_nodes = 0;
  Evenness evenness;
  Boundary boundary;  ///< in the surface's own frame
  Stages stages;
};

/// Nodes, integration points, base and circle of a body. Cells are split where `label_at` changes.
///
/// Positions become LPS metres here, rounded to a picometre, and volumes to a billionth of a mm^3:
/// a model written to a file in mm and read again is the same, bit for bit. Throws ModelError: no node on the
/// base, the circle reaches the base, more nodes than memory is there for ("memory"), the body too thin for
/// its nodes under the circle ("thin"); Stopped; and what the steps throw.
struct Discretised {
  Discretisation places;
  ModelReport report;
};
Discretised discretise(const BodySurface& body, const ModelOptions& options, const LabelAt& label_at = {});

/// Where a body rests and the tool stands on it, and how fine that asks the nodes to be: the same for every
/// number of nodes, and a good part of what a small cloud costs. `known`: see find_boundary(). `uncut`: the
/// same body before it was cut, on which base and tool find their places; none: it was not.
struct Site {
  Boundary boundary;
  Sizing sizing;    ///< with the rim that the options give
  Boundary graded;  ///< whose circle the nodes are finest around: the same, or where a round tool touches
  std::shared_ptr<const BodySurface> uncut = {};  ///< the body before it was cut; null: it was not
};
Site find_site(const BodySurface& body, const ModelOptions& options, const Boundary* known = nullptr,
               const BodySurface* uncut = nullptr);
/// The same as above, on a site that was found for the same body under options that differ in the numbers of
/// nodes and points alone.
Discretised discretise(const BodySurface& body, const ModelOptions& options, const LabelAt& label_at,
                       const Site& site);

/// Label of the image's voxel at a place in the surface's frame; outside, or on background, of the nearest
/// foreground voxel within two voxels: the smooth surface runs a little outside of the labels. `image` must
/// outlive it. `to_world`: of another frame; `labels`: that alone count, none: all.
LabelAt label_finder(const LabelImage& image, const BodySurface& body);
LabelAt label_finder(const LabelImage& image, const Eigen::Isometry3d& to_world,
                     const std::vector<int>& labels = {});

/// Which tissue each label is, from 0 (all labels that are not listed), and each tissue's density [kg/m^3].
struct TissueOptions {
  std::map<int, int> of_label = {};
  std::vector<double> density = {1000.0};
};
/// [Q] the tissue of each point.
Eigen::VectorXi tissue_of_points(const Discretisation& places, const TissueOptions& tissues);

/// The whole way from an image, or from a body's surface, to a model that a solver can take.
///
/// `labels`: of the image, those that are the body; empty: all foreground. Throws what make_body_surface(),
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
