#include "preprocess/node_cloud.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <queue>
#include <random>

#include "io/error.hpp"
#include "preprocess/neighbours.hpp"

namespace dimple {
namespace {

constexpr int candidates_per_node = 5;
constexpr int sweeps = 40;

// std::uniform_real_distribution may differ between standard libraries; these bits do not.
double uniform(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1.0p-53;
}

double lateral_distance(const Boundary& boundary, const Vec3& x) {
  const Vec3 d = x - boundary.centre;
  return (d - d.dot(boundary.push) * boundary.push).norm();
}

// The part of the surface that the tool touches; a wall beneath the rim does not count.
bool near_circle(const Boundary& boundary, const Vec3& x, double margin) {
  return lateral_distance(boundary, x) < boundary.radius + margin &&
         std::abs((x - boundary.centre).dot(boundary.push)) < 2.0 * boundary.radius;
}

Points to_points(const std::vector<Vec3>& v) {
  Points result(3, static_cast<Index>(v.size()));
  for (std::size_t k = 0; k < v.size(); ++k) result.col(static_cast<Index>(k)) = v[k];
  return result;
}

std::vector<Vec3> surface_candidates(const BodySurface& body, const Boundary& boundary, Index count,
                                     double spacing, std::mt19937_64& random) {
  std::vector<Vec3> result;
  std::vector<double> cumulated(static_cast<std::size_t>(body.triangles().cols()));
  double area = 0.0;
  for (Index t = 0; t < body.triangles().cols(); ++t)
    cumulated[static_cast<std::size_t>(t)] = area += body.triangle_area()[t];
  for (Index k = 0; k < count; ++k) {
    const double at = (static_cast<double>(k) + uniform(random)) / static_cast<double>(count) * area;
    const auto t =
        std::min<Index>(std::upper_bound(cumulated.begin(), cumulated.end(), at) - cumulated.begin(),
                        body.triangles().cols() - 1);
    double u = uniform(random), v = uniform(random);
    if (u + v > 1.0) u = 1.0 - u, v = 1.0 - v;
    const Vec3 a = body.vertex().col(body.triangles()(0, t)), b = body.vertex().col(body.triangles()(1, t)),
               c = body.vertex().col(body.triangles()(2, t));
    const Vec3 x = a + u * (b - a) + v * (c - a);
    if (!near_circle(boundary, x, 0.5 * spacing)) result.push_back(x);
  }
  return result;
}

std::vector<Vec3> inner_candidates(const BodySurface& body, Index count, double spacing,
                                   std::mt19937_64& random) {
  const Vec3 lower = body.lower(), size = body.upper() - lower;
  std::vector<Vec3> result;
  // A body fills some share of its box; one that fills less than a thousandth is refused below.
  const Index most = 1000 * count;
  for (Index batch = 0; batch < most && static_cast<Index>(result.size()) < count; batch += 4096) {
    std::vector<Vec3> place(4096);
    for (Vec3& x : place)
      x = lower + Vec3(uniform(random), uniform(random), uniform(random)).cwiseProduct(size);
    std::vector<char> good(place.size());
    tbb::parallel_for(std::size_t{0}, place.size(), [&](std::size_t k) {
      good[k] = body.contains(place[k]) && body.closest(place[k]).distance > 0.4 * spacing;
    });
    for (std::size_t k = 0; k < place.size() && static_cast<Index>(result.size()) < count; ++k)
      if (good[k]) result.push_back(place[k]);
  }
  return result;
}

// Weighted sample elimination: removes the most crowded candidate until `count` are left; `fixed` ones only
// crowd. Yuksel, Sample elimination for generating Poisson disk sample sets, CGF 34 (2015) 25-32, with
// exponent 8.
std::vector<Vec3> thin_out(const std::vector<Vec3>& candidates, const std::vector<Vec3>& fixed, Index count,
                           double reach) {
  const std::size_t m = candidates.size();
  if (static_cast<Index>(m) <= count) return candidates;
  std::vector<Vec3> all = candidates;
  all.insert(all.end(), fixed.begin(), fixed.end());
  const Points points = to_points(all);
  const Neighbours tree(points);

  std::vector<std::vector<std::pair<int, double>>> near(m);
  std::vector<double> crowding(m, 0.0);
  tbb::parallel_for(std::size_t{0}, m, [&](std::size_t i) {
    std::vector<int> found;
    tree.within(points.col(static_cast<Index>(i)), reach, found);
    for (const int j : found) {
      if (j == static_cast<int>(i)) continue;
      const double d = (points.col(static_cast<Index>(i)) - points.col(j)).norm();
      const double w = std::pow(1.0 - d / reach, 8);
      crowding[i] += w;
      if (j < static_cast<int>(m)) near[i].push_back({j, w});
    }
  });

  using Entry = std::pair<double, std::size_t>;
  std::priority_queue<Entry> queue;
  for (std::size_t i = 0; i < m; ++i) queue.push({crowding[i], i});
  std::vector<bool> gone(m, false);
  for (Index left = static_cast<Index>(m); left > count;) {
    const auto [w, i] = queue.top();
    queue.pop();
    if (gone[i] || w != crowding[i]) continue;  // an older entry
    gone[i] = true;
    --left;
    for (const auto& [j, weight] : near[i]) {
      const auto jj = static_cast<std::size_t>(j);
      if (gone[jj]) continue;
      crowding[jj] -= weight;
      queue.push({crowding[jj], jj});
    }
  }
  std::vector<Vec3> result;
  for (std::size_t i = 0; i < m; ++i)
    if (!gone[i]) result.push_back(candidates[i]);
  return result;
}

// Jacobi sweeps of a soft repulsion that ends at 1.7 spacings; the surface's nodes are put back onto it.
void spread_out(const BodySurface& body, const Boundary& boundary, NodeCloud& cloud) {
  const double h = cloud.spacing, reach = 1.7 * h;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    const Neighbours tree(cloud.X);
    const double step = 0.35 * h * (sweep < sweeps / 2 ? 1.0 : 0.5);
    Points next = cloud.X;
    tbb::parallel_for(cloud.circle_count, cloud.X.cols(), [&](Index a) {
      const Vec3 x = cloud.X.col(a);
      const bool on_surface = a < cloud.surface_count;
      thread_local std::vector<int> found;
      tree.within(x, reach, found);
      Vec3 push = Vec3::Zero();
      bool surface_near = false;
      for (const int b : found) {
        if (b == a) continue;
        // Inner nodes must not press surface nodes along the surface by lying beneath them unevenly.
        if (on_surface && b >= cloud.surface_count) continue;
        const Vec3 d = x - cloud.X.col(b);
        const double distance = std::max(d.norm(), 1e-6 * h), s = 1.0 - distance / reach;
        push += d / distance * (s * s * s);
        surface_near = surface_near || (b < cloud.surface_count && distance < 1.2 * h);
      }
      Vec3 move = step * push;
      if (const double length = move.norm(); length > 0.2 * h) move *= 0.2 * h / length;
      if (on_surface) {
        const Vec3 there = body.closest(x + move).place;
        if (!near_circle(boundary, there, 0.5 * h)) next.col(a) = there;
      } else if (!surface_near || body.contains(x + move)) {
        next.col(a) = x + move;
      }
    });
    cloud.X = next;
  }
}

}  // namespace

double spacing_for_count(const BodySurface& body, Index count) {
  double low = 0.0, high = std::cbrt(body.volume()) + std::sqrt(body.area());
  for (int k = 0; k < 100; ++k) {
    const double h = 0.5 * (low + high);
    (body.volume() / (h * h * h) + 0.5 * body.area() / (h * h) > static_cast<double>(count) ? low : high) = h;
  }
  return 0.5 * (low + high);
}

Index count_for_spacing(const BodySurface& body, double spacing_mm) {
  const double h = spacing_mm;
  return std::lround(body.volume() / (h * h * h) + 0.5 * body.area() / (h * h));
}

NodeCloud make_node_cloud(const BodySurface& body, const Boundary& boundary, const CloudOptions& options) {
  NodeCloud cloud;
  const Index count = options.spacing_mm > 0.0 ? count_for_spacing(body, options.spacing_mm) : options.count;
  cloud.spacing = options.spacing_mm > 0.0 ? options.spacing_mm : spacing_for_count(body, count);
  const double h = cloud.spacing;

  const Points circle = circle_nodes(body, boundary, h);
  const double circle_area = std::numbers::pi * std::pow(boundary.radius + 0.5 * h, 2);
  const Index free_surface = std::lround(std::max(body.area() - circle_area, 0.0) / (h * h));
  const Index inner = count - circle.cols() - free_surface;
  if (inner < 8)
    throw ModelError(
        {.fact = fmt::format("{} nodes leave {} for the inside", count, std::max<Index>(inner, 0)),
         .where = "node cloud",
         .why = fmt::format("the circle takes {} and the surface {}", circle.cols(), free_surface),
         .remedy = "ask for more nodes (--nodes) or a smaller --spacing"});

  std::mt19937_64 random(options.seed);
  std::vector<Vec3> placed;
  for (const auto& x : circle.colwise()) placed.push_back(x);
  cloud.circle_count = circle.cols();

  const auto on_surface = surface_candidates(body, boundary, candidates_per_node * free_surface, h, random);
  for (const Vec3& x : thin_out(on_surface, placed, free_surface, 1.07 * h)) placed.push_back(x);
  cloud.surface_count = static_cast<Index>(placed.size());

  const Index wanted = count - cloud.surface_count;
  const auto inside = inner_candidates(body, candidates_per_node * wanted, h, random);
  if (static_cast<Index>(inside.size()) < wanted)
    throw ModelError(
        {.fact = fmt::format("only {} places for {} inner nodes were found", inside.size(), wanted),
         .where = "node cloud",
         .why = "the body is thinner than a node spacing almost everywhere",
         .remedy = "ask for more nodes (--nodes) or a smaller --spacing"});
  const std::vector<Vec3> surface_nodes = placed;
  for (const Vec3& x : thin_out(inside, surface_nodes, wanted, 1.12 * h)) placed.push_back(x);
  cloud.X = to_points(placed);
  spread_out(body, boundary, cloud);

  cloud.base.assign(static_cast<std::size_t>(cloud.X.cols()), false);
  for (Index a = cloud.circle_count; a < cloud.surface_count; ++a) {
    const auto closest = body.closest(cloud.X.col(a));
    cloud.base[static_cast<std::size_t>(a)] =
        on_base(boundary, cloud.X.col(a), body.normal().col(closest.triangle));
  }
  return cloud;
}

Evenness measure_evenness(const NodeCloud& cloud, const Points& places) {
  const Neighbours tree(cloud.X);
  const Index n = cloud.X.cols();
  Eigen::ArrayXd nearest(n);
  for (Index a = 0; a < n; ++a)
    nearest[a] = tree.distance_to_nearest(cloud.X.col(a), static_cast<int>(a)) / cloud.spacing;
  Evenness result;
  result.mean = nearest.mean();
  result.spread = std::sqrt((nearest - result.mean).square().mean()) / result.mean;
  result.minimum = nearest.minCoeff();
  for (const auto& x : places.colwise())
    result.fill = std::max(result.fill, tree.distance_to_nearest(x) / cloud.spacing);
  return result;
}

}  // namespace dimple
