#include "preprocess/build_model.hpp"

#include <fmt/format.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include <cmath>

#include "io/error.hpp"
#include "io/memory.hpp"
#include "io/stop.hpp"
#include "preprocess/pressure_patches.hpp"
#include "preprocess/side_by_side.hpp"
#include "preprocess/spatial_order.hpp"

namespace dimple {

namespace {

Points world_metres(const BodySurface& body, const Points& local) {
  Points world = (body.to_world() * local.colwise().homogeneous()).eval();
  return world.unaryExpr(&metres);
}

// Mean thickness of the body under the circle over the mean spacing of its nodes.
double layers_under_circle(const BodySurface& body, const Boundary& boundary, const NodeCloud& cloud) {
  double thickness = 0.0, spacing = 0.0;
  const double before = 1e-3 * boundary.radius;
  for (Index a = 0; a < cloud.circle_count; ++a) {
    const std::vector<double> cut =
        body.crossings(cloud.X.col(a) - before * boundary.push, boundary.push);  // pairs: in, out
    const double h = cloud.spacing[a];
    for (std::size_t pair = 0; pair + 1 < cut.size(); pair += 2)
      if (cut[pair + 1] > 2.0 * before) {
        thickness += (cut[pair + 1] - std::max(cut[pair], 0.0)) * h * h;  // a node stands for h^2 of it
        spacing += h * h * h;
        break;
      }
  }
  return spacing > 0.0 ? thickness / spacing : 0.0;
}

// Layers of 1 to 10 mm under a disc of 10 mm, against a finer cloud: below 2 the force was 2 to 6 times as
// large, from 2.2 to 2.3 it was 1.1 to 1.8 times, from 2.4 to 3.1 within 1.2 or 1.3 times; in the paper's
// scheme, 2.2 and less 3.4 to 6 times, 2.8 and more within 6 %. Bodies thicker than the disc have more than
// five.
constexpr double fewest_layers = 2.5, enough_layers = 2.7;

// Where supports of the usual size are too small at so many of the points, the cloud does not fill the body.
constexpr double most_grown = 0.1;

void refuse_too_many_grown(const Model& model, const SupportReport& support, const SupportOptions& options) {
  constexpr double usual = 1.5;
  const double share = static_cast<double>(support.grown) / static_cast<double>(model.point_count());
  if (options.effective_radius_factor() < usual || share <= most_grown) return;
  const Vec3 x = model.point.col(std::max<Index>(support.fewest_at, 0)) * 1e3;
  throw ModelError(
      {.fact = fmt::format("{} of {} supports ({:.0f} %) had to be enlarged, by up to {:.2f}, to have "
                           "nodes enough",
                           support.grown, model.point_count(), 100.0 * share, support.largest_growth),
       .where = fmt::format("support domains; fewest nodes, {}, at ({:.2f}, {:.2f}, {:.2f}) mm",
                            support.fewest, x.x(), x.y(), x.z()),
       .why = "the body is thinner than the nodes are apart, or its nodes lie nearly in a plane",
       .remedy = "ask for more nodes (--nodes) or a smaller --spacing",
       .code = "supports"});
}

void refuse_too_thin(double layers, Index nodes) {
  if (layers >= fewest_layers) return;
  // The layers grew with the nodes to the power of 0.36 to 0.38; in hundreds.
  const double wanted = 100.0 * std::ceil(0.01 * static_cast<double>(nodes) *
                                          std::pow(enough_layers / std::max(layers, 0.1), 2.7));
  throw ModelError(
      {.fact = fmt::format("the body is {:.2f} node spacings thick under the circle", layers),
       .where = "node cloud beneath the indenter's circle",
       .why = fmt::format("{} nodes are too few to follow how so thin a body is squeezed: the force "
                          "may be off by a half or more",
                          nodes),
       .remedy = fmt::format("ask for about {:.0f} nodes (--nodes), or a finer --rim", wanted),
       .code = "thin"});
}

// A run with 100,000 nodes and 700,000 points was seen to take 1.91 GB, smaller ones more per point.
constexpr double bytes_per_point = 2500.0;

void refuse_beyond_memory(const ModelOptions& options, Index nodes) {
  const double points = options.grid.count > 0 ? static_cast<double>(options.grid.count)
                                               : options.grid.ratio * static_cast<double>(nodes);
  const double needed = bytes_per_point * points, there = memory_at_hand();
  if (needed > there)
    throw ModelError(
        {.fact = fmt::format("{} nodes with {:.0f} integration points need at least {:.1f} GB of "
                             "memory, and {:.1f} GB are there",
                             nodes, points, needed / 1e9, there / 1e9),
         .where = options.grid.count > 0 ? "node cloud and integration grid; --nodes and --points"
                                         : "node cloud and integration grid; --nodes",
         .why =
             fmt::format("each point needs about {:.1f} kB while supports are found", bytes_per_point / 1e3),
         .remedy = "ask for fewer nodes (--nodes, or a larger --spacing) or points (--points), or "
                   "take a larger machine",
         .code = "memory"});
}

}  // namespace

void give_back_memory() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

BuiltModel build_model(const BodySurface& body, const ModelOptions& options, const LabelAt& label_at) {
  BuiltModel built;
  Model& model = built.model;
  ModelReport& report = built.report;
  report.surface_volume_mm3 = body.volume();
  report.surface_area_mm2 = body.area();

  if (!(options.cloud.spacing_mm > 0.0)) refuse_beyond_memory(options, options.cloud.count);
  const Boundary boundary = report.boundary = find_boundary(body, options.boundary);
  const Sizing sizing(body, boundary, options.cloud.grading);
  report.stages.done("boundary");
  // Side by side: neither needs more of the other than how many nodes there will be.
  const CloudSize size = cloud_size(body, sizing, options.cloud);
  refuse_beyond_memory(options, size.count);
  NodeCloud cloud;
  IntegrationGrid grid;
  side_by_side([&] { cloud = make_node_cloud(body, boundary, sizing, options.cloud, size); },
               [&] {
                 grid = options.averaged_cells
                            ? make_graded_grid(body, options.grid, size.count, sizing, size.far_spacing,
                                               label_at)
                            : make_integration_grid(body, options.grid, size.count, label_at);
               });
  give_back_memory();
  refuse_too_thin(layers_under_circle(body, boundary, cloud), cloud.X.cols());
  report.stages.done("cloud, grid");

  stop_if_asked();
  const std::vector<Index> nodes = spatial_order(cloud.X), points = spatial_order(grid.point);
  model.X = world_metres(body, cloud.X(Eigen::all, nodes));
  model.spacing = cloud.spacing(nodes).unaryExpr(&metres);
  model.point = world_metres(body, grid.point(Eigen::all, points));
  model.volume = grid.volume(points).unaryExpr(&cubic_metres);
  model.label = grid.label(points);
  model.axes = body.to_world().linear();
  if (grid.spread.cols() > 0) {
    model.spread.resize(6, grid.spread.cols());
    for (Index q = 0; q < grid.spread.cols(); ++q) {
      const auto s = grid.spread.col(points[static_cast<std::size_t>(q)]);
      Mat3 about;
      about << s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2];
      about = model.axes * about * model.axes.transpose();
      model.spread.col(q) << about(0, 0), about(1, 1), about(2, 2), about(0, 1), about(1, 2), about(2, 0);
    }
    model.spread = model.spread.unaryExpr(&square_metres).eval();
  }
  model.tool.centre = world_metres(body, boundary.centre);
  model.tool.push = body.to_world().linear() * boundary.push + Vec3::Zero();  // no minus zeros
  model.tool.radius = metres(boundary.radius);
  for (Index a = 0; a < model.node_count(); ++a) {
    const Index in_cloud = nodes[static_cast<std::size_t>(a)];
    if (in_cloud < cloud.circle_count) model.indenter.push_back(a);
    if (cloud.base[static_cast<std::size_t>(in_cloud)]) model.base.push_back(a);
  }

  report.spacing_mm = cloud.far_spacing;
  report.rim_spacing_mm = cloud.far_spacing * (sizing.even() ? 1.0 : options.cloud.grading.rim);
  report.cell_mm = grid.cell;
  report.grid_volume_mm3 = grid.volume.sum();
  report.clipped = grid.clipped;
  report.merged = grid.merged;
  report.surface_nodes = cloud.surface_count;
  report.circle_nodes = cloud.circle_count;
  for (Index a = 0; a < cloud.circle_count; ++a) {
    const Vec3 d = cloud.X.col(a) - boundary.centre;
    if ((d - d.dot(boundary.push) * boundary.push).norm() > boundary.radius * (1.0 - 1e-6))
      ++report.rim_nodes;
  }
  report.evenness = measure_evenness(cloud, grid.point);
  report.stages.done("other");

  if (model.base.empty())
    throw ModelError(
        {.fact = "no node lies on the base",
         .where = "fixed base",
         .why = fmt::format("no surface node within {:.2f} mm of the lowest place", boundary.base_depth),
         .remedy = "give more depth with boundary.base_depth_mm, more nodes, or another --base"});
  for (Index a = 0; a < cloud.circle_count; ++a) {
    const Vec3 x = cloud.X.col(a);
    if (boundary.lowest - x.dot(boundary.down) <= boundary.base_depth)
      throw ModelError(
          {.fact = "the indenter's circle lies on the fixed base",
           .where = "fixed base and indenter circle",
           .why = fmt::format("a node of the circle is within {:.2f} mm of the lowest place",
                              boundary.base_depth),
           .remedy = "choose another place (--indent-at), another --base, or less boundary.base_depth_mm"});
  }
  return built;
}

Completion complete_model(Model& model, const SupportOptions& options, const Eigen::VectorXi& tissue,
                          const Eigen::VectorXd& density, const SurfacePieces& surface) {
  Completion report;
  const bool averaged = model.spread.cols() > 0, consistent = averaged && surface.place.cols() > 0;
  Points wanted;
  side_by_side([&] { report.support = find_supports(model, options, tissue); },
               [&] {
                 if (consistent) wanted = surface_integrals(model, options, surface);
               });
  give_back_memory();
  stop_if_asked();
  refuse_too_many_grown(model, report.support, options);
  report.stages.done("support");
  side_by_side(
      [&] {
        if (consistent) report.consistency = make_consistent(model, wanted);
      },
      [&] {
        if (averaged) make_pressure_patches(model, tissue);
        model.mass = lumped_mass(model, density);
      });
  give_back_memory();
  report.stages.done("consistency, patches");
  return report;
}

}  // namespace dimple
