#include "preprocess/build_model.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "io/error.hpp"
#include "io/memory.hpp"
#include "io/stop.hpp"
#include "io/triangle_strips.hpp"
#include "io/units.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/nodes/spatial_order.hpp"
#include "preprocess/side_by_side.hpp"

namespace dimple {

namespace {

Points world_metres(const BodySurface& body, const Points& local) {
  Points world = (body.to_world() * local.colwise().homogeneous()).eval();
  return world.unaryExpr(&metres);
}

// Positions rounded to a power of two near a four-millionth of the body's size: a thousandth of the voxels'
// accuracy, and half the digits in a file.
Points rounded_for_files(const BodySurface& body, const Points& mm) {
  const double step = std::exp2(std::floor(std::log2((body.upper() - body.lower()).maxCoeff())) - 22.0);
  return (mm.array() / step).round() * step;
}

// Mean thickness of the body under the contact patch / mean spacing of the patch's nodes.
double layers_under_patch(const BodySurface& body, const Boundary& boundary, const NodeSet& node_set) {
  double thickness = 0.0, spacing = 0.0;
  const double before = 1e-3 * boundary.radius;
  for (Index a = 0; a < node_set.patch_node_count; ++a) {
    const std::vector<double> cut =
        body.crossings(node_set.X.col(a) - before * boundary.approach, boundary.approach);  // pairs: in, out
    const double h = node_set.spacing[a];
    for (std::size_t pair = 0; pair + 1 < cut.size(); pair += 2)
      if (cut[pair + 1] > 2.0 * before) {
        thickness += (cut[pair + 1] - std::max(cut[pair], 0.0)) * h * h;  // a node represents an area of h^2
        spacing += h * h * h;
        break;
      }
  }
  return spacing > 0.0 ? thickness / spacing : 0.0;
}

// Layers of 1 to 10 mm under a disc of 10 mm, compared with finer nodes. Below 2 spacings the force was 2 to
// 6 times as large. From 2.2 to 2.3 it was 1.1 to 1.8 times, from 2.4 to 3.1 within 1.3 times. The scheme of
// Horton et al. (2007): 3.4 to 6 times up to 2.2, within 6 % from 2.8. Bodies thicker than the disc have more
// than five.
constexpr double fewest_layers = 2.5, enough_layers = 2.7;

void refuse_too_thin(double layers, Index nodes) {
  if (layers >= fewest_layers) return;
  // The number of layers grew with the nodes to the power of 0.36 to 0.38; rounded up to hundreds.
  const double requested = 100.0 * std::ceil(0.01 * static_cast<double>(nodes) *
                                             std::pow(enough_layers / std::max(layers, 0.1), 2.7));
  throw ModelError(
      {.fact = fmt::format("the body is {:.2f} node spacings thick under the contact patch", layers),
       .where = "nodes beneath the contact patch",
       .why = fmt::format("{} nodes are too few for a body this thin: the force may be wrong by 50 % or more",
                          nodes),
       .remedy = fmt::format("use about {:.0f} nodes (--nodes), or a finer --rim", requested),
       .code = "thin"});
}

// Largest distance from a node to its nearest neighbour.
double largest_gap(const Points& X) {
  const Neighbours tree(X);
  Eigen::ArrayXd gap(X.cols());
  tbb::parallel_for(Index{0}, X.cols(), [&](Index a) {
    if (a % 256 == 0) stop_if_requested();
    gap[a] = tree.distance_to_nearest(X.col(a), static_cast<int>(a));
  });
  return gap.maxCoeff();
}

// A run with 100,000 nodes and 700,000 points used 1.91 GB, smaller ones more per point.
constexpr double bytes_per_point = 2500.0;

void refuse_beyond_memory(const ModelOptions& options, Index nodes) {
  const double points = options.grid.count > 0 ? static_cast<double>(options.grid.count)
                                               : options.grid.ratio * static_cast<double>(nodes);
  const double needed = bytes_per_point * points, there = memory_at_hand();
  if (needed > there)
    throw ModelError(
        {.fact = fmt::format("{} nodes with {:.0f} integration points need at least {:.1f} GB of "
                             "memory, and {:.1f} GB are available",
                             nodes, points, needed / 1e9, there / 1e9),
         .where = options.grid.count > 0 ? "nodes and integration grid; --nodes and --points"
                                         : "nodes and integration grid; --nodes",
         .why = fmt::format("each point needs about {:.1f} kB during the search for supports",
                            bytes_per_point / 1e3),
         .remedy = "use fewer nodes (--nodes, or a larger --spacing) or points (--points), or use a machine "
                   "with more memory",
         .code = "memory"});
}

// Flags of the triangles of a cut body that were not on its surface before the cut.
std::vector<char> cut_faces(const BodySurface& body, const Triangles& triangles, const BodySurface* uncut) {
  if (!uncut) return {};
  const double rounding = 1e-6 * (body.upper() - body.lower()).norm();
  std::vector<char> result(static_cast<std::size_t>(triangles.cols()));
  tbb::parallel_for(Index{0}, triangles.cols(), [&](Index t) {
    if (t % 1024 == 0) stop_if_requested();
    const Vec3 middle = body.vertex()(Eigen::all, triangles.col(t)).rowwise().mean();
    result[static_cast<std::size_t>(t)] = uncut->closest(middle).distance > rounding;
  });
  return result;
}

// Discretisation in metres and world coordinates; nodes and points in the order of a space-filling curve.
Discretisation places_of(const BodySurface& body, const Site& site, const NodeSet& node_set,
                         const IntegrationGrid& grid, bool holds_patch) {
  const Boundary& boundary = site.boundary;
  Discretisation places;
  const std::vector<Index> nodes = spatial_order(node_set.X), points = spatial_order(grid.point);
  places.X = world_metres(body, node_set.X(Eigen::all, nodes));
  places.spacing = node_set.spacing(nodes).unaryExpr(&metres);
  places.point = world_metres(body, grid.point(Eigen::all, points));
  places.volume = grid.volume(points).unaryExpr(&cubic_metres);
  places.label = grid.label(points);
  places.axes = body.to_world().linear();
  places.surface.vertex_mm = rounded_for_files(body, body.to_world() * body.vertex().colwise().homogeneous());
  places.surface.triangles = in_strips(body.triangles());  // strips compress better in files
  places.surface.cut_face = cut_faces(body, places.surface.triangles, site.uncut.get());
  if (grid.second_moments.cols() > 0) {
    const SecondMoments in_order = grid.second_moments(Eigen::all, points);
    places.second_moments = turned(in_order, places.axes).unaryExpr(&square_metres);
  }
  places.tool.centre = world_metres(body, boundary.centre);
  places.tool.approach = body.to_world().linear() * boundary.approach + Vec3::Zero();  // no minus zeros
  places.tool.radius = metres(boundary.radius);
  for (Index a = 0; a < places.node_count(); ++a) {
    const Index in_node_set = nodes[static_cast<std::size_t>(a)];
    if (holds_patch && in_node_set < node_set.patch_node_count) places.bonded_patch.push_back(a);
    if (node_set.base[static_cast<std::size_t>(in_node_set)]) places.base.push_back(a);
  }
  return places;
}

void report_node_set(const Boundary& boundary, const NodeSet& node_set, const IntegrationGrid& grid,
                     double patch_edge, ModelReport& report) {
  report.spacing_mm = node_set.far_spacing;
  report.patch_edge_spacing_mm = node_set.far_spacing * patch_edge;
  report.largest_spacing_mm = largest_gap(node_set.X);
  report.cell_mm = grid.cell;
  report.grid_volume_mm3 = grid.volume.sum();
  report.clipped = grid.clipped;
  report.merged = grid.merged;
  report.surface_nodes = node_set.surface_count;
  report.patch_nodes = node_set.patch_node_count;
  for (Index a = 0; a < node_set.patch_node_count; ++a) {
    const Vec3 d = node_set.X.col(a) - boundary.centre;
    if ((d - d.dot(boundary.approach) * boundary.approach).norm() > boundary.radius * (1.0 - 1e-6))
      ++report.patch_edge_nodes;
  }
  report.evenness = measure_evenness(node_set, grid.point);
}

void refuse_without_base_or_on_it(const Boundary& boundary, const NodeSet& node_set,
                                  const Discretisation& places) {
  if (places.base.empty())
    throw ModelError(
        {.fact = "no node is on the base",
         .where = "fixed base",
         .why = fmt::format("there is no surface node within {:.2f} mm of the base's lowest point",
                            boundary.base_depth),
         .remedy = "give a larger --base-depth, more --nodes or another --base"});
  for (Index a = 0; a < node_set.patch_node_count; ++a) {
    const Vec3 x = node_set.X.col(a);
    if (boundary.lowest - x.dot(boundary.down) <= boundary.base_depth)
      throw ModelError(
          {.fact = "the contact patch overlaps the fixed base",
           .where = "fixed base and contact patch",
           .why = fmt::format("a node of the contact patch is within {:.2f} mm of the base's lowest point{}",
                              boundary.base_depth,
                              boundary.approach.dot(boundary.down) < 0.0
                                  ? ", and the tool moves away from the base: its direction may have the "
                                    "wrong sign"
                                  : ""),
           .remedy = "choose another place (--indent-at), another --base or a smaller --base-depth"});
  }
}

// Grading for a contact that is small compared with its body. Spacing that grows in proportion to the
// distance, out to the body's size, costs nodes only with its logarithm. So steep a growth was too much for
// 1500 nodes within 12 radii of a contact of a fortieth of the body: the force was a quarter too low.
GradingOptions to_the_size_of(const BodySurface& body, double contact_radius, GradingOptions grading) {
  const double size = std::cbrt(body.volume()) / contact_radius;
  if (grading.patch_edge >= 1.0 || size <= grading.reach) return grading;
  grading.patch_edge *= grading.reach / size;
  grading.reach = size;
  return grading;
}

// Vectors from the middle of the graded patch to surface points along the tool's path, at most a radius
// apart. Those to the contacts of further tools follow.
std::vector<Vec3> along_path(const BodySurface& body, const Boundary& graded,
                             const BoundaryOptions& options) {
  std::vector<Vec3> along;
  const Vec3& approach = graded.approach;
  const double far = (body.upper() - body.lower()).norm();
  Vec3 last = Vec3::Zero();
  const std::vector<Vec3> path =
      options.path_of_turning_tool
          ? options.path_of_turning_tool(body.to_world().linear() * approach, body.to_world() * graded.centre)
          : options.path_of_tool;
  for (const Vec3& world : path) {
    const Vec3 next = body.to_world().linear().transpose() * world,
               across = next - last - (next - last).dot(approach) * approach;
    const int pieces = std::min(1000, static_cast<int>(std::ceil(across.norm() / graded.radius)));
    for (int k = 1; k <= pieces; ++k) {
      const Vec3 come = last + static_cast<double>(k) / pieces * across,
                 aside = come - come.dot(approach) * approach;
      const std::vector<double> met = body.crossings(graded.centre + aside - far * approach, approach);
      if (!met.empty()) along.push_back(aside + (met.front() - far) * approach);
    }
    last = next;
  }
  for (const Vec3& world : options.other_tools)
    along.push_back(body.closest(body.to_world().inverse() * world).place - graded.centre);
  return along;
}

}  // namespace

Site find_site(const BodySurface& body, const ModelOptions& options, const Boundary* known,
               const BodySurface* uncut) {
  const BodySurface& before = uncut ? *uncut : body;
  Site site{find_boundary(before, options.boundary, known), {}, {}};
  GradingOptions grading = options.node_set.grading;
  if (options.boundary.contact_radius_mm > 0.0) {
    site.boundary.radius = options.boundary.contact_radius_mm;
    grading = to_the_size_of(body, site.boundary.radius, grading);
  }
  site.boundary.over_cut = uncut && options.boundary.contact_radius_mm > 0.0;
  site.graded = site.boundary;
  if (const auto& height = options.boundary.height_of_tool)
    site.graded.centre =
        place_of_contact(before, site.boundary, 0.5 * options.boundary.indenter_diameter_mm, height);
  site.sizing =
      Sizing(body, site.graded, grading, along_path(before, site.graded, options.boundary), &before);
  return site;
}

Discretised discretise(const BodySurface& body, const ModelOptions& options, const LabelAt& label_at) {
  if (!(options.node_set.spacing_mm > 0.0)) refuse_beyond_memory(options, options.node_set.count);
  StageTimes finding;
  const Site site = find_site(body, options);
  finding.done("boundary");
  Discretised result = discretise(body, options, label_at, site);
  finding.add(result.report.stages);
  result.report.stages = std::move(finding);
  return result;
}

Discretised discretise(const BodySurface& body, const ModelOptions& given, const LabelAt& label_at,
                       const Site& site) {
  ModelOptions options = given;
  Discretised result;
  ModelReport& report = result.report;
  report.surface_volume_mm3 = body.volume();
  report.surface_area_mm2 = body.area();

  if (!(options.node_set.spacing_mm > 0.0)) refuse_beyond_memory(options, options.node_set.count);
  const Boundary& boundary = report.boundary = site.boundary;
  options.node_set.base_outline = options.scheme.base_outline;
  GradingOptions& grading = options.node_set.grading;
  const NodeSetSize size =
      node_set_size(body, site.sizing, options.node_set, grading.least * boundary.radius);
  grading.patch_edge = size.patch_edge;
  const Sizing sizing = site.sizing.with_edge_spacing(size.patch_edge);
  refuse_beyond_memory(options, size.count);
  // Computed side by side: each needs only the number of nodes from the other.
  NodeSet node_set;
  IntegrationGrid grid;
  side_by_side([&] { node_set = make_node_set(body, site.graded, sizing, options.node_set, size); },
               [&] {
                 grid = options.scheme.averaged_gradients
                            ? make_graded_grid(body, options.grid, size.count, sizing, size.far_spacing,
                                               label_at)
                            : make_integration_grid(body, options.grid, size.count, label_at);
               });
  give_back_memory();
  refuse_too_thin(layers_under_patch(body, site.graded, node_set), node_set.X.cols());
  report.stages.done("cloud, grid");

  stop_if_requested();
  result.places = places_of(body, site, node_set, grid, !(options.boundary.contact_radius_mm > 0.0));
  report_node_set(site.graded, node_set, grid, sizing.even() ? 1.0 : options.node_set.grading.patch_edge,
                  report);
  report.stages.done("other");
  refuse_without_base_or_on_it(boundary, node_set, result.places);
  return result;
}

LabelAt label_finder(const LabelImage& image, const Eigen::Isometry3d& to_world,
                     const std::vector<int>& labels) {
  const Eigen::Affine3d to_voxel = image.to_world.inverse() * to_world;
  return [&image, to_voxel, labels](const Vec3& x) {
    const Vec3 v = to_voxel * x;
    const Eigen::Matrix<Index, 3, 1> at = v.array().round().cast<Index>();
    int best = 0;
    double nearest = std::numeric_limits<double>::infinity();
    for (Index reach = 0; reach <= 2 && best == 0; ++reach)
      for (Index k = at[2] - reach; k <= at[2] + reach; ++k)
        for (Index j = at[1] - reach; j <= at[1] + reach; ++j)
          for (Index i = at[0] - reach; i <= at[0] + reach; ++i) {
            if (i < 0 || j < 0 || k < 0 || i >= image.size[0] || j >= image.size[1] || k >= image.size[2])
              continue;
            const int label = image.at(i, j, k);
            const double away =
                (Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)) - v)
                    .squaredNorm();
            if (label == 0 || away >= nearest) continue;
            if (!labels.empty() && std::find(labels.begin(), labels.end(), label) == labels.end()) continue;
            nearest = away;
            best = label;
          }
    return best;
  };
}

LabelAt label_finder(const LabelImage& image, const BodySurface& body) {
  return label_finder(image, body.to_world());
}

Eigen::VectorXi tissue_of_points(const Discretisation& places, const TissueOptions& tissues) {
  Eigen::VectorXi tissue(places.point_count());
  for (Index q = 0; q < tissue.size(); ++q) {
    const auto own = tissues.of_label.find(places.label[q]);
    tissue[q] = own == tissues.of_label.end() ? 0 : own->second;
  }
  return tissue;
}

BuiltModel build_model(const BodySurface& body, const ModelOptions& options, const TissueOptions& tissues,
                       const LabelAt& label_at) {
  auto [places, report] = discretise(body, options, label_at);
  Eigen::VectorXi tissue = tissue_of_points(places, tissues);
  StageTimes& stages = report.stages;
  return {make_model(std::move(places), options.scheme, std::move(tissue), tissues.density, &stages),
          std::move(report),
          {}};
}

BuiltModel build_model(const LabelImage& image, const std::vector<int>& labels, const ModelOptions& options,
                       const TissueOptions& tissues) {
  SegmentedBody body =
      make_body_surface(image, labels, {.indenter_diameter_mm = options.boundary.indenter_diameter_mm});
  ModelOptions here = options;
  here.boundary.voxel_mm = image.spacing().maxCoeff();
  // Cells are split where tissues meet; borders of labels within one tissue do not count.
  BuiltModel built = build_model(body.surface, here, tissues,
                                 tissues.of_label.empty() ? LabelAt{} : label_finder(image, body.surface));
  built.segment = std::move(body.report);
  return built;
}

}  // namespace dimple
