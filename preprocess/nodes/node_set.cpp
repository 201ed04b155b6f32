#include "preprocess/nodes/node_set.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <random>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/nodes/graded_parts.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/nodes/sample_elimination.hpp"

namespace dimple {
namespace {

// Least distance of an inner node from the surface [spacings]. A free node that gets between the surface's
// nodes of the base has hardly any stiffness: the force was up to 3 % too small.
constexpr double least_depth = 0.4;
constexpr int candidates_per_node = 5;
constexpr int sweeps = 40;

// Bounds. The largest numbers observed with successful node sets are a fifth of them: facets of a fan of
// slivers.
constexpr std::size_t boxes_per_node = 40, facets_per_node = 200;
constexpr std::size_t fewest_bound = 20000, most_to_measure = 2'500'000;
// Fraction of a body's box: sparser bodies are searched box by box.
constexpr double sparse = 0.2;
// Trials for a good place: thousands where the body is mostly thinner than a spacing.
constexpr Index tries_per_place = 100;
// Limit of --nodes; beyond five times that the lists of the supports would overflow.
constexpr double most_nodes = 1e6;

std::size_t bound(std::size_t per_node, double nodes) {
  return std::max(fewest_bound, per_node * static_cast<std::size_t>(std::min(nodes, most_nodes)));
}

// Uniform numbers with the same bits everywhere: std::uniform_real_distribution may differ between libraries.
double uniform(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1.0p-53;
}

double lateral_distance(const Boundary& boundary, const Vec3& x) {
  const Vec3 d = x - boundary.centre;
  return (d - d.dot(boundary.approach) * boundary.approach).norm();
}

// True on the part of the surface under the tool: not on a wall beneath the patch's edge, nor on the far side
// of a thin body.
bool near_patch(const BodySurface& body, const Boundary& boundary, const Vec3& x, const Vec3& normal,
                double margin) {
  const bool is_near = lateral_distance(boundary, x) < boundary.radius + margin &&
                       normal.dot(boundary.approach) < 0.0 &&
                       std::abs((x - boundary.centre).dot(boundary.approach)) < 2.0 * boundary.radius;
  if (!is_near || !boundary.over_cut) return is_near;
  // False on a face of a cut beneath the other one.
  const std::vector<double> before =
      body.crossings(x - 1e-3 * boundary.radius * boundary.approach, -boundary.approach);
  return std::none_of(before.begin(), before.end(), [](double t) { return t > 0.0; });
}

// Number of nodes: volume / h^3 + area / (2 h^2), both weighted with the powers of the sizing.
struct Contents {
  double volume = 0.0, area = 0.0;
  double count(double h) const { return volume / (h * h * h) + 0.5 * area / (h * h); }
  double spacing(double requested) const {
    double low = 0.0, high = std::cbrt(volume) + std::sqrt(area);
    for (int k = 0; k < 100; ++k) {
      const double h = 0.5 * (low + high);
      (count(h) > requested ? low : high) = h;
    }
    return 0.5 * (low + high);
  }
};

// Parts of a body with their distances from the patch's edge: numbers of nodes are then sums.
struct Measured {
  struct Piece {
    double size, distance, finer;  // [mm^3] or [mm^2], [mm], of Sizing
  };
  std::vector<Piece> boxes, facets;
  Contents contents(const Sizing& sizing) const {
    Contents result;
    for (const Piece& box : boxes) {
      const double s = sizing.at(box.distance, box.finer);
      result.volume += box.size / (s * s * s);
    }
    for (const Piece& facet : facets) {
      const double s = sizing.at(facet.distance, facet.finer);
      result.area += facet.size / (s * s);
    }
    return result;
  }
};

ModelError patch_edge_too_fine(const Sizing& sizing) {
  return ModelError({.fact = fmt::format("a node spacing at the edge of the contact patch of {:.3g} times "
                                         "that far away needs more nodes than requested",
                                         sizing.least()),
                     .where = "nodes",
                     .why = fmt::format("the edge is {:.3g} mm long", sizing.patch_edge_length()),
                     .remedy = "give a coarser --rim, more --nodes or a smaller --indenter-diameter"});
}

Measured measure(const BodySurface& body, const Sizing& sizing, double rough_spacing) {
  constexpr double nowhere_near = std::numeric_limits<double>::infinity();
  if (sizing.even()) return {{{body.volume(), nowhere_near, 1.0}}, {{body.area(), nowhere_near, 1.0}}};
  const std::size_t most =
      std::min(most_to_measure, 5 * bound(boxes_per_node, body.volume() / std::pow(rough_spacing, 3)));
  // A graded far spacing is about twice an even one; with very steep grading, more.
  for (int attempt = 0; attempt < 6; ++attempt) {
    rough_spacing *= 2.0;
    const auto boxes = boxes_of(body, sizing, rough_spacing, most);
    if (!boxes) continue;
    const auto facets = facets_of(body, sizing, rough_spacing, most);
    if (!facets) continue;
    Measured result;
    for (std::size_t k = 0; k < boxes->leaf.size(); ++k)
      result.boxes.push_back({boxes->size[k], boxes->leaf[k].distance, boxes->leaf[k].finer});
    for (const GradedFacets::Facet& facet : facets->facet)
      result.facets.push_back({facet.area, facet.distance, facet.finer});
    return result;
  }
  throw patch_edge_too_fine(sizing);
}

std::vector<Vec3> surface_candidates(const BodySurface& body, const GradedFacets& facets,
                                     const Boundary& boundary, Index count, const Sizing& sizing,
                                     double far_spacing, std::mt19937_64& random) {
  std::vector<Vec3> result;
  std::vector<double> cumulated;
  double area = 0.0;
  for (const GradedFacets::Facet& facet : facets.facet)
    cumulated.push_back(area += facet.area / (facet.sizing * facet.sizing));
  for (Index k = 0; k < count; ++k) {
    if (k % 4096 == 0) stop_if_requested();
    const double at = (static_cast<double>(k) + uniform(random)) / static_cast<double>(count) * area;
    const auto found = std::upper_bound(cumulated.begin(), cumulated.end(), at) - cumulated.begin();
    const SmallTriangle t =
        triangle_of(body, facets, std::min(static_cast<std::size_t>(found), cumulated.size() - 1));
    double u = uniform(random), v = uniform(random);
    if (u + v > 1.0) u = 1.0 - u, v = 1.0 - v;
    const Vec3 x = t.a + u * (t.b - t.a) + v * (t.c - t.a);
    if (!near_patch(body, boundary, x, t.normal, 0.5 * far_spacing * sizing(x))) result.push_back(x);
  }
  return result;
}

std::vector<Vec3> inner_candidates(const BodySurface& body, Index count, const Sizing& sizing,
                                   double far_spacing, std::mt19937_64& random) {
  const Vec3 lower = body.lower(), size = body.upper() - lower;
  const auto in_unit_box = [&] {
    const double z = uniform(random), y = uniform(random);
    return Vec3(uniform(random), y, z);
  };
  const bool in_boxes = !sizing.even() || body.volume() < sparse * size.prod();
  GradedBoxes boxes;
  std::vector<double> worth;  // cumulative, in nodes at far spacing 1
  if (in_boxes) {
    auto found = boxes_of(body, sizing, far_spacing, bound(boxes_per_node, static_cast<double>(count)));
    if (!found) throw patch_edge_too_fine(sizing);
    boxes = std::move(*found);
    double sum = 0.0;
    for (std::size_t k = 0; k < boxes.leaf.size(); ++k)
      worth.push_back(sum +=
                      boxes.size[k] / std::pow(sizing.at(boxes.leaf[k].distance, boxes.leaf[k].finer), 3));
  }
  const auto anywhere = [&]() -> Vec3 {
    if (!in_boxes) return lower + in_unit_box().cwiseProduct(size);
    const double at = uniform(random) * worth.back();
    const auto k = static_cast<std::size_t>(std::upper_bound(worth.begin(), worth.end(), at) - worth.begin());
    const Leaf& box = boxes.leaf[std::min(k, boxes.leaf.size() - 1)];
    return box.centre + (2.0 * in_unit_box() - Vec3::Ones()).cwiseProduct(box.half);
  };
  std::vector<Vec3> result;
  // Limit of trials: a body that fills less than a hundredth of its boxes, half a spacing away from its
  // surface, is refused below.
  constexpr Index enough_tries = 100000;
  for (Index tried = 0; static_cast<Index>(result.size()) < count; tried += 4096) {
    if (tried > enough_tries && tried > tries_per_place * static_cast<Index>(result.size())) break;
    stop_if_requested();
    std::vector<Vec3> place(4096);
    for (Vec3& x : place) x = anywhere();
    std::vector<char> good(place.size());
    tbb::parallel_for(std::size_t{0}, place.size(), [&](std::size_t k) {
      good[k] =
          body.contains(place[k]) && body.farther(place[k], least_depth * (far_spacing * sizing(place[k])));
    });
    for (std::size_t k = 0; k < place.size() && static_cast<Index>(result.size()) < count; ++k)
      if (good[k]) result.push_back(place[k]);
  }
  return result;
}

// Neighbour lists of the nodes, valid as long as no node has moved far.
class Company {
 public:
  // `steepest`: largest change of the spacing per length.
  Company(double reach, double steepest) : reach_(reach), steepest_(steepest) {}

  void follow(const NodeSet& node_set) {
    if (around_.size() == static_cast<std::size_t>(node_set.X.cols())) {
      const auto moved = (node_set.X - X_).colwise().norm().transpose().eval();
      const double most = moved.maxCoeff(),
                   most_spacings = (moved.array() / node_set.spacing.array()).maxCoeff();
      bool close = true;  // false: two within reach may be missing in the list
      for (Index a = node_set.fixed_count; a < node_set.X.cols() && close; ++a) {
        const double within = reach_ * node_set.spacing[a];
        // Another node that is within reach has hardly a larger spacing, and has moved no farther than this.
        const double other =
            std::min(most, 1.000001 * most_spacings * (node_set.spacing[a] + steepest_ * within));
        close = within + moved[a] + other < radius_[a];
      }
      if (close) return;
    }
    X_ = node_set.X;
    radius_ = (reach_ + margin) * node_set.spacing;
    around_.resize(static_cast<std::size_t>(node_set.X.cols()));
    const Neighbours tree(X_);
    tbb::parallel_for(node_set.fixed_count, node_set.X.cols(), [&](Index a) {
      stop_if_requested();
      std::vector<int>& list = around_[static_cast<std::size_t>(a)];
      tree.within(X_.col(a), radius_[a], list);
      if (a < node_set.surface_count)
        list.erase(std::lower_bound(list.begin(), list.end(), node_set.surface_count), list.end());
    });
  }
  // Ascending; for a surface node, those on the surface.
  const std::vector<int>& of(Index a) const { return around_[static_cast<std::size_t>(a)]; }

 private:
  static constexpr double margin = 0.5;  // spacings
  double reach_, steepest_;
  Points X_;
  Eigen::VectorXd radius_;
  std::vector<std::vector<int>> around_;
};

// Jacobi sweeps of a soft repulsion that ends at 1.7 spacings; surface nodes are projected onto the surface.
// `steepest`: largest change of the spacing per length.
void spread_out(const BodySurface& body, const Boundary& boundary, const Spacing& spacing, double steepest,
                NodeSet& node_set) {
  constexpr double reach = 1.7;
  Eigen::VectorXd& h = node_set.spacing;
  Company company(far_enough * reach, steepest);
  Eigen::VectorXd depth =
      Eigen::VectorXd::Zero(node_set.X.cols());  // of inner nodes: lower bound of the distance to the surface
  // Position after the part of `move` that keeps the node inside, or x.
  const auto kept_inside = [&](Index a, const Vec3& x, const Vec3& move) -> Vec3 {
    const double least = least_depth * h[a], length = move.norm();
    depth[a] -= length;
    if (depth[a] >= least) return x + move;
    const auto from = body.closest(x);
    depth[a] = from.distance - length;
    if (depth[a] >= least) return x + move;
    const Vec3 inwards = (x - from.place) / std::max(from.distance, 1e-9 * h[a]);
    const Vec3 there = x + move - std::min(move.dot(inwards), 0.0) * inwards;
    const double left = body.closest(there).distance;
    const bool good = body.contains(there) && left >= std::min(least, from.distance);
    depth[a] = good ? left : from.distance;
    return good ? there : x;
  };
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    company.follow(node_set);
    const double stride = 0.35 * (sweep < sweeps / 2 ? 1.0 : 0.5);
    Points next = node_set.X;
    tbb::parallel_for(node_set.fixed_count, node_set.X.cols(), [&](Index a) {
      stop_if_requested();
      const Vec3 x = node_set.X.col(a);
      const bool on_surface = a < node_set.surface_count;
      const double farthest2 = std::pow(far_enough * reach * h[a], 2);
      Vec3 approach = Vec3::Zero();
      // Inner nodes are left out for surface nodes: uneven ones beneath would move them along the surface.
      for (const int b : company.of(a)) {
        const Vec3 d = x - node_set.X.col(b);
        const double distance2 = d.squaredNorm();
        const double apart = 0.5 * (h[a] + h[b]), within = reach * apart;
        if (distance2 >= farthest2 || distance2 > 1.000001 * within * within || b == a) continue;
        const double distance = std::max(std::sqrt(distance2), 1e-6 * apart), s = 1.0 - distance / within;
        if (s <= 0.0) continue;
        approach += d / distance * (s * s * s);
      }
      Vec3 move = stride * h[a] * approach;
      if (const double length = move.norm(); length > 0.2 * h[a]) move *= 0.2 * h[a] / length;
      if (on_surface) {
        const auto there = body.closest(x + move);
        if (!near_patch(body, boundary, there.place, body.normal().col(there.triangle), 0.5 * h[a]))
          next.col(a) = there.place;
      } else {
        next.col(a) = kept_inside(a, x, move);
      }
    });
    node_set.X = next;
    tbb::parallel_for(Index{0}, node_set.X.cols(), [&](Index a) { h[a] = spacing(node_set.X.col(a)); });
  }
}

void shake(const BodySurface& body, double part, std::mt19937_64& random, NodeSet& node_set) {
  for (Index a = node_set.surface_count; a < node_set.X.cols(); ++a) {
    const double x = uniform(random), y = uniform(random), z = uniform(random);
    const Vec3 there = node_set.X.col(a) + part * node_set.spacing[a] * (2.0 * Vec3(x, y, z) - Vec3::Ones());
    if (body.contains(there)) node_set.X.col(a) = there;
  }
}

// Nodes along the outline of the base, since others are only near it. A free strip of half a spacing next to
// it made a block's force up to a tenth too small.
std::vector<Vec3> outline_of_base(const BodySurface& body, const Boundary& boundary, const Spacing& spacing) {
  // In spacings: along a loop, of any two, and length of a loop.
  constexpr double apart = 0.95, at_least = 0.6, shortest = 4.0;
  const Triangles& triangles = body.triangles();
  const auto corner = [&](Index v) -> Vec3 { return body.vertex().col(v); };
  std::vector<std::pair<Index, Index>> edges;  // of the base's triangles, as they turn
  for (Index t = 0; t < triangles.cols(); ++t) {
    if (t % 65536 == 0) stop_if_requested();
    if (!on_base(boundary, body.middle_of(t), body.normal().col(t))) continue;
    for (int k = 0; k < 3; ++k) edges.emplace_back(triangles(k, t), triangles((k + 1) % 3, t));
  }
  std::sort(edges.begin(), edges.end());
  std::multimap<Index, Index> next;
  for (const auto& [from, to] : edges)
    if (!std::binary_search(edges.begin(), edges.end(), std::pair(to, from))) next.insert({from, to});
  std::vector<Vec3> nodes;
  while (!next.empty()) {
    std::vector<Vec3> loop = {corner(next.begin()->first)};
    double length = 0.0;  // in spacings
    for (auto step = next.begin(); step != next.end();) {
      const Index to = step->second;
      next.erase(step);
      length += (corner(to) - loop.back()).norm() / spacing(0.5 * (corner(to) + loop.back()));
      loop.push_back(corner(to));
      step = next.find(to);
    }
    if (length < shortest) continue;
    Vec3 last = Vec3::Constant(std::numeric_limits<double>::infinity());
    for (std::size_t k = 1; k < loop.size(); ++k) {
      stop_if_requested();
      const Vec3 from = loop[k - 1], direction = loop[k] - from;
      const int parts = std::max(1, static_cast<int>(std::ceil(10.0 * direction.norm() / spacing(from))));
      for (int i = 0; i < parts; ++i) {
        const Vec3 x = from + direction * i / parts;
        const double h = spacing(x);
        if ((x - last).norm() < apart * h) continue;
        if (std::any_of(nodes.begin(), nodes.end(),
                        [&](const Vec3& other) { return (x - other).norm() < at_least * h; }))
          continue;
        nodes.push_back(x);
        last = x;
      }
    }
  }
  return nodes;
}

// Area of the surface outside of the contact patch, weighted with the sizing [mm^2].
double free_area_of(const BodySurface& body, const Boundary& boundary, const Sizing& sizing,
                    const GradedFacets& facets, double h) {
  if (sizing.even())
    return std::max(body.area() - std::numbers::pi * std::pow(boundary.radius + 0.5 * h, 2), 0.0);
  double area = 0.0;
  for (std::size_t k = 0; k < facets.facet.size(); ++k) {
    const SmallTriangle t = triangle_of(body, facets, k);
    const double s = facets.facet[k].sizing;
    if (!near_patch(body, boundary, (t.a + t.b + t.c) / 3.0, t.normal, 0.5 * h * s)) area += t.area / (s * s);
  }
  return area;
}

void mark_base(const BodySurface& body, const Boundary& boundary, NodeSet& node_set) {
  node_set.base.assign(static_cast<std::size_t>(node_set.X.cols()), false);
  for (Index a = node_set.patch_node_count; a < node_set.fixed_count; ++a)
    node_set.base[static_cast<std::size_t>(a)] = true;
  for (Index a = node_set.fixed_count; a < node_set.surface_count; ++a) {
    if (a % 1024 == 0) stop_if_requested();
    const auto closest = body.closest(node_set.X.col(a));
    node_set.base[static_cast<std::size_t>(a)] =
        on_base(boundary, node_set.X.col(a), body.normal().col(closest.triangle));
  }
}

double rough_spacing(const BodySurface& body, double count) {
  return std::cbrt(body.volume() / count);
}

void refuse_too_many(double nodes, const char* option) {
  if (nodes > most_nodes)
    throw ModelError({.fact = fmt::format("{:.0f} nodes are requested, and at most {:.0f} are possible",
                                          nodes, most_nodes),
                      .where = fmt::format("nodes; {}", option),
                      .why = "their lists are numbered with 32 bits",
                      .remedy = "use fewer nodes (--nodes) or a larger --spacing"});
}

}  // namespace

double spacing_for_count(const BodySurface& body, Index count, const Sizing& sizing) {
  const auto requested = static_cast<double>(count);
  return measure(body, sizing, rough_spacing(body, requested)).contents(sizing).spacing(requested);
}

Index count_for_spacing(const BodySurface& body, double spacing_mm, const Sizing& sizing) {
  refuse_too_many(Contents{body.volume(), body.area()}.count(spacing_mm), "--spacing");  // more if graded
  // Measured with fifty thousand nodes, which is fine enough.
  const double count = measure(body, sizing, std::max(spacing_mm, rough_spacing(body, 5e4)))
                           .contents(sizing)
                           .count(spacing_mm);
  refuse_too_many(count, "--spacing");
  return std::lround(count);
}

NodeSetSize node_set_size(const BodySurface& body, const Sizing& sizing, const NodeSetOptions& options,
                          double least_mm) {
  double patch_edge = sizing.least();
  if (const double h = options.spacing_mm; h > 0.0) {
    patch_edge = std::min(1.0, std::max(patch_edge, least_mm / h));
    return {count_for_spacing(body, h, sizing.with_edge_spacing(patch_edge)), h, patch_edge};
  }
  const auto requested = static_cast<double>(options.count);
  refuse_too_many(requested, "--nodes");
  // A far spacing is never less than an even one.
  const double rough = rough_spacing(body, requested);
  if (sizing.patch_edge_length() > requested * std::max(patch_edge * rough, least_mm))
    throw patch_edge_too_fine(sizing);
  const Measured measured = measure(body, sizing, rough);
  double h = measured.contents(sizing).spacing(requested);
  // A coarser spacing at the edge leaves more nodes for the rest, and reduces its spacing: hence iterated.
  for (int pass = 0; pass < 20 && patch_edge < 1.0 && patch_edge * h < 0.999 * least_mm; ++pass) {
    patch_edge = std::min(1.0, least_mm / h);
    h = measured.contents(sizing.with_edge_spacing(patch_edge)).spacing(requested);
  }
  return {options.count, h, patch_edge};
}

NodeSet make_node_set(const BodySurface& body, const Boundary& boundary, const Sizing& sizing,
                      const NodeSetOptions& options, const NodeSetSize& size) {
  NodeSet node_set;
  const Index count = size.count;
  const double h = node_set.far_spacing = size.far_spacing;
  const Spacing spacing = [&](const Vec3& x) { return h * sizing(x); };

  const double at_patch = sizing.finer(boundary.centre);
  const Points bonded_patch =
      sizing.even() ? patch_nodes(body, boundary, h) : graded_patch_nodes(body, boundary, [&](double r) {
        return h * sizing.at(std::max(boundary.radius - r, 0.0), at_patch);
      });
  const auto found = facets_of(body, sizing, h, bound(facets_per_node, static_cast<double>(count)));
  if (!found) throw patch_edge_too_fine(sizing);
  const double free_area = free_area_of(body, boundary, sizing, *found, h);
  std::vector<Vec3> placed;
  for (const auto& x : bonded_patch.colwise()) placed.push_back(x);
  node_set.patch_node_count = bonded_patch.cols();
  if (options.base_outline)
    for (const Vec3& x : outline_of_base(body, boundary, spacing)) placed.push_back(x);
  node_set.fixed_count = static_cast<Index>(placed.size());
  const Index outline = node_set.fixed_count - node_set.patch_node_count;
  const Index free_surface = std::max<Index>(std::lround(free_area / (h * h)), outline);
  const Index inner = count - bonded_patch.cols() - free_surface;
  if (inner < 8)
    throw ModelError(
        {.fact = fmt::format("{} nodes leave {} for the inside", count, std::max<Index>(inner, 0)),
         .where = "nodes",
         .why =
             fmt::format("the contact patch needs {} and the surface {}", bonded_patch.cols(), free_surface),
         .remedy = "use more nodes (--nodes) or a smaller --spacing"});

  std::mt19937_64 random(options.seed);
  const auto on_surface =
      surface_candidates(body, *found, boundary, candidates_per_node * free_surface, sizing, h, random);
  for (const Vec3& x : thin_out(on_surface, placed, free_surface - outline, 1.07, spacing))
    placed.push_back(x);
  node_set.surface_count = static_cast<Index>(placed.size());

  const Index requested = count - node_set.surface_count;
  const auto inside = inner_candidates(body, candidates_per_node * requested, sizing, h, random);
  if (static_cast<Index>(inside.size()) < requested)
    throw ModelError(
        {.fact = fmt::format("only {} of {} inner nodes could be placed", inside.size(), requested),
         .where = "nodes",
         .why = "the body is thinner than a node spacing almost everywhere",
         .remedy = "use more nodes (--nodes) or a smaller --spacing"});
  const std::vector<Vec3> surface_nodes = placed;
  for (const Vec3& x : thin_out(inside, surface_nodes, requested, 1.12, spacing)) placed.push_back(x);
  node_set.X = to_points(placed);
  node_set.spacing.resize(node_set.X.cols());
  for (Index a = 0; a < node_set.X.cols(); ++a) node_set.spacing[a] = spacing(node_set.X.col(a));
  spread_out(body, boundary, spacing, h * sizing.steepest(), node_set);
  if (options.jitter > 0.0) shake(body, options.jitter, random, node_set);

  mark_base(body, boundary, node_set);
  return node_set;
}

Evenness measure_evenness(const NodeSet& node_set, const Points& places) {
  const Neighbours tree(node_set.X);
  const Index n = node_set.X.cols();
  Eigen::ArrayXd nearest(n), empty(places.cols());
  tbb::parallel_for(Index{0}, n, [&](Index a) {
    if (a % 256 == 0) stop_if_requested();
    nearest[a] = tree.distance_to_nearest(node_set.X.col(a), static_cast<int>(a)) / node_set.spacing[a];
  });
  tbb::parallel_for(Index{0}, places.cols(), [&](Index k) {
    if (k % 256 == 0) stop_if_requested();
    const int a = tree.nearest(places.col(k), 1).front();
    empty[k] = (node_set.X.col(a) - places.col(k)).norm() / node_set.spacing[a];
  });
  Evenness result;
  result.mean = nearest.mean();
  result.spread = std::sqrt((nearest - result.mean).square().mean()) / result.mean;
  result.minimum = nearest.minCoeff();
  if (places.cols() > 0) result.fill = empty.maxCoeff();
  return result;
}

}  // namespace dimple
