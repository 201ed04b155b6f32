#include "preprocess/supports/place_support.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "io/stop.hpp"

namespace dimple {
namespace {

// Least pivot ratio of a place computed with seven others; below it the place is computed by itself. Also the
// bound for nodes on one wall of a fold, nearly in a plane: with 1e-5 some bodies found no equilibrium.
constexpr double surely_conditioned = 1e-3;

}  // namespace

SupportNodes::SupportNodes(const Discretisation& m, const SupportOptions& o)
    : model(m), options(o), tree(m.X), radius(o.radius_factor * m.spacing) {
  std::map<int, std::vector<int>> of_octave;
  for (Index a = 0; a < m.node_count(); ++a) of_octave[std::ilogb(radius[a])].push_back(static_cast<int>(a));
  for (auto& [octave, nodes] : of_octave) {
    const double largest = radius(nodes).maxCoeff();
    octaves.push_back({Neighbours(m.X(Eigen::all, nodes)), std::move(nodes), largest});
  }
  pinned.assign(static_cast<std::size_t>(m.node_count()), 0);
  if (o.interpolation <= 0.0) return;
  for (const auto* set : {&m.base, &m.bonded_patch})
    for (const Index a : *set) pinned[static_cast<std::size_t>(a)] = 1;
}
void SupportNodes::reaching(const Vec3& x, double growth, std::vector<int>& result, double extent) const {
  result.clear();
  thread_local std::vector<int> found;
  for (const Octave& octave : octaves) {
    octave.tree.within_unordered(x, octave.largest_radius * growth + extent, found);
    for (const int k : found)
      if (const int a = octave.nodes[static_cast<std::size_t>(k)]; reaches(a, x, growth, extent))
        result.push_back(a);
  }
  std::sort(result.begin(), result.end());
}
void NodesAround::reaching(const Vec3& x, const SupportNodes& node_set, double growth,
                           const std::function<bool(int)>& connected, bool only_connected,
                           std::vector<int>& result) {
  if (node.empty()) {
    node_set.reaching(middle, 1.001 * largest_support_growth, node, 1.001 * extent);
    known.assign(node.size(), Known::no);
  }
  result.clear();
  for (std::size_t k = 0; k < node.size(); ++k) {
    if (!node_set.reaches(node[k], x, growth)) continue;
    if (only_connected && known[k] == Known::no)
      known[k] = connected(node[k]) ? Known::connected : Known::hidden;
    if (!only_connected || known[k] == Known::connected) result.push_back(node[k]);
  }
}

PlaceSupport support_of(const Vec3& x, const SupportNodes& node_set, std::span<const int> near,
                        NodesAround& around, const std::function<bool(int)>& connected) {
  PlaceSupport result;
  stop_if_requested();
  result.nodes.assign(near.begin(), near.end());
  std::erase_if(result.nodes, [&](int a) { return !node_set.reaches(a, x, 1.0); });
  const auto find = [&](bool only_connected) {
    for (result.growth = 1.0; result.growth <= largest_support_growth; result.growth *= 1.1) {
      if (result.growth > 1.0 || result.unconnected)
        around.reaching(x, node_set, result.growth, connected, only_connected, result.nodes);
      if (result.nodes.size() < enough_nodes) continue;
      result.mls = mls_shape_functions(x, node_set.model.X, result.nodes, node_set.radius, result.growth,
                                       node_set.options, node_set.pinned, result.phi, result.dphi);
      if (result.mls.ok() && (!only_connected || result.mls.pivot_ratio > surely_conditioned)) return true;
    }
    return false;
  };
  result.ok = find(static_cast<bool>(connected));
  if (!result.ok && connected) {
    result.unconnected = true;
    result.ok = find(false);
  }
  return result;
}

PlaceSupport support_of(const Vec3& x, const SupportNodes& node_set, std::span<const int> near,
                        const std::function<bool(int)>& connected) {
  NodesAround around{x, 0.0, {}, {}};
  return support_of(x, node_set, near, around, connected);
}

NodesNear nodes_near(const Points& places, const SupportNodes& node_set, const Eigen::VectorXd& margin,
                     const Connected& connected) {
  NodesNear result;
  result.offset.assign(static_cast<std::size_t>(places.cols()) + 1, 0);
  if (places.cols() == 0) return result;
  const Neighbours tree(places);
  const double largest_margin = margin.size() > 0 ? margin.maxCoeff() : 0.0;
  const Vec3 lower = places.rowwise().minCoeff(), upper = places.rowwise().maxCoeff();
  // Only nodes around these places: with all nodes for every slab of points the time would grow as N^2.
  const double slack = 1.0 + 1e-9;
  std::vector<int> around;
  node_set.reaching(0.5 * (lower + upper), slack, around,
                    slack * (0.5 * (upper - lower).norm() + largest_margin));
  std::vector<std::vector<int>> of_node(around.size());
  tbb::parallel_for(std::size_t{0}, around.size(), [&](std::size_t k) {
    if (k % 256 == 0) stop_if_requested();
    const int a = around[k];
    const Vec3 x = node_set.model.X.col(a);
    const double reach = node_set.radius[a] + largest_margin;
    if (((x - lower).array() < -reach).any() || ((x - upper).array() > reach).any()) return;
    std::vector<int>& found = of_node[k];
    thread_local std::vector<int> all;
    tree.within_unordered(x, reach, all);
    for (const int q : all)
      if (const double within = node_set.radius[a] + (margin.size() > 0 ? margin[q] : 0.0);
          (places.col(q) - x).squaredNorm() < within * within && (!connected || connected(a, q)))
        found.push_back(q);
  });
  for (const auto& found : of_node)
    for (const int q : found) ++result.offset[static_cast<std::size_t>(q) + 1];
  for (std::size_t q = 1; q < result.offset.size(); ++q) result.offset[q] += result.offset[q - 1];
  result.node.resize(result.offset.back());
  std::vector<std::size_t> next(result.offset.begin(), result.offset.end() - 1);
  for (std::size_t k = 0; k < of_node.size(); ++k)
    for (const int q : of_node[k]) result.node[next[static_cast<std::size_t>(q)]++] = around[k];
  return result;
}

bool surely_good(const MlsOfEight& eight, std::size_t place) {
  return eight.reached[place] >= static_cast<int>(enough_nodes) &&
         eight.pivot_ratio[place] > surely_conditioned;
}

}  // namespace dimple
